"""ROS 2 in: state of the battery, joints, inertial unit, and odometry from outside."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from ohmward.errors import InputError
from ohmward.logs.bags.layout import Layout
from ohmward.onboard.message import Message, Put
from ohmward.onboard.ros import types
from ohmward.onboard.ros.cdr import read
from ohmward.onboard.ros.messages import FULL
from ohmward.onboard.ros.transport import RosNetwork
from ohmward.quantities import QUANTITIES

#: Time between two looks at the way to other nodes [s].
_LOOK_S = 1.0
#: Words in the names of joints that do not tell which wheel it is.
_OF_JOINTS = {"wheel", "joint", "drive", "motor", "link"}
#: The square of a quaternion of single precision differs from 1 by less; one that differs more is none.
_UNIT = 0.01


@dataclass(frozen=True)
class Ros2Source(RosNetwork):
    """Messages of sensors; an empty topic is not subscribed to."""

    node: str = "ohmward_sensors"  #: name of the node
    battery_state: str = ""  #: topic of `sensor_msgs/BatteryState`
    joint_states: str = ""  #: topic of `sensor_msgs/JointState`, whose velocities are those of wheels
    #: wheel -> joint, where `front_left_wheel_joint` is not the wheel `front_left`
    joints: dict[str, str] = field(default_factory=dict)
    #: topic of `sensor_msgs/Imu`, with x forward as the robot's; its attitude, where it has one, is the pitch
    imu: str = ""
    odometry: str = ""  #: topic of `nav_msgs/Odometry` that does not come from the wheels: visual, lidar, GNSS
    live: bool = True  #: false where a bag is played: nothing of it is kept for the robot
    name: str = "ros2"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.topics().values()):
            raise InputError('no topic: give battery_state = "/battery", joint_states, imu or odometry')

    async def run(self, put: Put) -> None:
        """Receive until the way to the other nodes is lost."""
        transport = await asyncio.to_thread(self.open)
        loop = asyncio.get_running_loop()
        try:
            for topic, type_, values in self._topics():
                if topic:
                    receive = partial(self._receive, loop, put, type_, values)
                    await asyncio.to_thread(transport.subscribe, topic, type_, receive)
            while True:
                await asyncio.sleep(_LOOK_S)
                transport.check()
        finally:
            await asyncio.to_thread(transport.close)

    def message(self, type_: str, payload: bytes, received_s: float) -> Message | None:
        """The message of ROS as one of signals; None where it cannot be read or has none."""
        values_of = next(values for _, of, values in self._topics() if of == type_)
        try:
            layout, numbers = read(type_, payload)
        except ValueError:
            return None
        values = values_of(layout, numbers)
        stamp_s = numbers["header.stamp.sec"] + 1e-9 * numbers["header.stamp.nanosec"]
        return Message(stamp_s if stamp_s > 0.0 else math.nan, received_s, self.name, values) if values else None

    def _receive(self, loop: asyncio.AbstractEventLoop, put: Put, type_: str, values: object, payload: bytes) -> None:
        """Hand a message over to the loop, from a thread of the transport."""
        found = self.message(type_, payload, time.monotonic())
        if found and not loop.is_closed():
            loop.call_soon_threadsafe(put, found)

    def topics(self) -> dict[str, str]:
        """Topics by setting."""
        return {name: getattr(self, name) for name in ("battery_state", "joint_states", "imu", "odometry")}

    def _topics(self) -> tuple[tuple[str, str, Callable[[Layout, dict[str, float]], dict[str, float]]], ...]:
        """Topic, type and translation of each message."""
        return (
            (self.battery_state, types.BATTERY_STATE, _battery),
            (self.joint_states, types.JOINT_STATE, self._wheels),
            (self.imu, types.IMU, _body),
            (self.odometry, types.ODOMETRY, _speed),
        )

    def _wheels(self, layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
        """Speeds of the wheels by their names."""
        wheels = {joint: wheel for wheel, joint in self.joints.items()}
        values = {}
        for path, joint in layout.texts.items():
            speed = numbers.get(f"velocity{path.removeprefix('name')}")
            if not path.startswith("name[") or speed is None or (wheels and joint not in wheels):
                continue
            values[f"wheel_speed_rad_s.{wheels.get(joint) or wheel_of(joint)}"] = speed
        return values


def wheel_of(joint: str) -> str:
    """The wheel of a joint by its name: `front_left_wheel_joint` turns `front_left`."""
    return "_".join(word for word in joint.split("_") if word not in _OF_JOINTS) or joint


def _of_table(type_: str, numbers: dict[str, float]) -> dict[str, float]:
    """Quantities that the table finds in a message of this type; the first covariance of an absent sensor is -1."""
    return {
        quantity.name: numbers[quantity.ros_field]
        for quantity in QUANTITIES.values()
        if quantity.ros_type == type_
        and numbers.get(f"{quantity.ros_field.partition('.')[0]}_covariance[0]", math.nan) != -1.0
    }


def _battery(layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
    values = _of_table(types.BATTERY_STATE, numbers)
    cells = {path: v for path, v in numbers.items() if path.startswith("cell_voltage[")}
    values |= {f"cell_voltage_V.{path[len('cell_voltage[') : -1]}": v for path, v in cells.items()}
    if numbers["power_supply_status"]:
        values["battery_full"] = float(numbers["power_supply_status"] == FULL)
    return {signal: value for signal, value in values.items() if math.isfinite(value)}


def _body(layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
    """Yaw rate, acceleration and pitch."""
    values = _of_table(types.IMU, numbers)
    pitch_rad = pitch_of(*(numbers[f"orientation.{axis}"] for axis in "xyzw"))
    if numbers["orientation_covariance[0]"] != -1.0 and math.isfinite(pitch_rad):
        values["pitch_rad"] = pitch_rad
    return values


def pitch_of(x: float, y: float, z: float, w: float) -> float:
    """Pitch [rad], > 0 with the nose up, from the quaternion of an attitude; nan where it is none.

    It is the angle between the x axis of the unit and the horizon, sin(pitch) = 2 (x z - w y): REP-103 counts a turn
    about y, to the left, as positive where the nose goes down. The zero of a message that was never filled, and the
    identity of one that was only initialised, are no attitudes; a filter never shows either to the last bit.
    """
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) <= _UNIT or x == y == z == 0.0:
        return math.nan
    return math.asin(min(max(2.0 * (x * z - w * y) / norm, -1.0), 1.0))


def _speed(layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
    """Speed and, where it is told, its standard deviation."""
    values = _of_table(types.ODOMETRY, numbers)
    if (variance := numbers["twist.covariance[0]"]) > 0.0:
        values["speed_std_m_s"] = math.sqrt(variance)
    return values
