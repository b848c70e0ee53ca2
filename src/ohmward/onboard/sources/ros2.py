"""ROS 2 source: battery state, joints, inertial unit, and external odometry or speed."""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from ohmward.checks import require_length
from ohmward.errors import InputError
from ohmward.logs.bags.recording import Layout
from ohmward.onboard.clock import DATED_S, LEAP_S
from ohmward.onboard.message import Message, Put
from ohmward.onboard.ros import types
from ohmward.onboard.ros.cdr import read, read_path
from ohmward.onboard.ros.messages import FULL
from ohmward.onboard.ros.transport import RosNetwork, SharedNode, Transport, require_topics
from ohmward.quantities import QUANTITIES
from ohmward.traction.robot.urdf import rotation

#: Type of the message on each topic, by its setting.
TOPICS = {
    "battery_state": types.BATTERY_STATE,
    "joint_states": types.JOINT_STATE,
    "imu": types.IMU,
    "odometry": types.ODOMETRY,
    "twist": types.TWIST,
    "home_path": types.PATH,
}
#: Time between two checks of the connection to other nodes [s].
_WAY_CHECK_S = 1.0
#: Words in the names of joints that do not identify the wheel.
_OF_JOINTS = {"wheel", "joint", "drive", "motor", "link"}
#: Largest delay of /clock [s of its own time].
_CLOCK_LATE_S = 5.0
#: Services below the name of the node, of type `std_srvs/Trigger`: name, event that it reports, and answer.
SERVICES = (
    ("battery_full", "battery_full", "the battery is full"),
    ("battery_changed", "battery_changed", "another battery is in: its charge starts from the next voltage"),
    ("reset_pose", "pose_reset", "the pose restarts at the origin of odom"),
)
#: The squared norm of a single-precision unit quaternion differs from 1 by less; one that differs more is invalid.
_UNIT = 0.01


@dataclass(frozen=True)
class Ros2Source(RosNetwork):
    """Messages of sensors; an empty topic is not subscribed to."""

    battery_state: str = ""  #: topic of `sensor_msgs/BatteryState`
    joint_states: str = ""  #: topic of `sensor_msgs/JointState` with the wheel speeds
    #: wheel -> joint, for names other than `front_left_wheel_joint` of the wheel `front_left`; steering -> the joint
    #: whose position is the steering angle
    joints: dict[str, str] = field(default_factory=dict)
    imu: str = ""  #: topic of `sensor_msgs/Imu`; its orientation, if any, gives the pitch
    #: roll, pitch and yaw [rad] of the IMU in the robot's frame, as in the URDF of its link: turned about z last
    imu_rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
    odometry: str = ""  #: topic of `nav_msgs/Odometry` from a source other than the wheels: visual, lidar, GNSS
    #: topic of `geometry_msgs/TwistWithCovarianceStamped` from such a source, x along the robot: many GNSS drivers give
    #: east and north instead
    twist: str = ""
    #: topic of `nav_msgs/Path` from the robot to the place where it charges, as a planner publishes it: the way home
    home_path: str = ""
    #: false for a played bag or a simulation: time comes from /clock, or the newest stamp if nobody publishes it, and
    #: no state is kept
    live: bool = True
    name: str = "ros2"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.topics().values()):
            raise InputError('no topic: give battery_state = "/battery", joint_states, imu, odometry or twist')
        require_topics(self.topics())
        require_length("imu_rpy", self.imu_rpy, 3, "roll, pitch and yaw of the inertial unit")

    async def run(self, put: Put) -> None:
        """Receive until the connection to the other nodes is lost."""
        async with SharedNode(self).opened() as transport:
            await self.run_on(transport, put)

    async def run_on(self, transport: Transport, put: Put) -> None:
        """Receive through the node of this transport."""
        loop, clock = asyncio.get_running_loop(), None if self.live else RosTime()
        waiting: deque[Message] = deque()

        def put_all() -> None:
            while waiting:
                put(waiting.popleft())

        def hand_over(message: Message | None) -> None:
            if message and not loop.is_closed():
                waiting.append(message)
                if len(waiting) == 1:  # else they are about to be put
                    loop.call_soon_threadsafe(put_all)

        publishers: dict[str, dict[bytes, str]] = {}

        def receive(topic: str, type_: str, payload: bytes, publisher: bytes) -> None:
            names = publishers.setdefault(topic, {})
            name = names.setdefault(publisher, f"{topic} (publisher {len(names) + 1})" if names else topic)
            message = self.message(type_, payload, time.monotonic(), topic, clock)
            hand_over(message and message._replace(publisher=name))

        def event(signal: str, sentence: str) -> str:
            now_s = time.monotonic() if clock is None else clock.now_s
            for value in (1.0, 0.0):  # it has happened, and may happen again
                hand_over(Message(math.nan, now_s, self.name, {signal: value}, "services"))
            return sentence

        for name, topic in self.topics().items():
            if topic:
                type_ = TOPICS[name]
                await asyncio.to_thread(transport.subscribe, topic, type_, partial(receive, topic, type_))
        if clock is not None:
            await asyncio.to_thread(transport.subscribe, "/clock", types.CLOCK, partial(receive, "/clock", types.CLOCK))
        for name, signal, sentence in SERVICES:
            await asyncio.to_thread(transport.serve, f"{self.node}/{name}", partial(event, signal, sentence))
        while True:
            await asyncio.sleep(_WAY_CHECK_S)
            transport.check()

    def message(
        self, type_: str, payload: bytes, received_s: float, topic: str = "", clock: RosTime | None = None
    ) -> Message | None:
        """A message of ROS converted to signals; None if it cannot be read or has none.

        clock: of a simulation or a bag, used instead of `received_s`.
        """
        try:
            layout, numbers = (None, read_path(payload)) if type_ == types.PATH else read(type_, payload)
        except ValueError:
            return None
        if type_ == types.CLOCK:
            assert clock is not None
            now_s = clock.set(_time(numbers, "clock"))
            return Message(now_s, now_s, self.name, {}, topic, now_s, sets_time=True)
        values = self._translations[type_](layout, numbers)
        stamp_s = _time(numbers, "header.stamp") or math.nan
        if clock is not None:
            received_s = clock.received(stamp_s, topic)
        if not values or math.isnan(received_s):
            return None
        now_s = time.time() if clock is None else received_s
        is_date = abs(stamp_s - now_s) < DATED_S
        return Message(stamp_s, received_s, self.name, values, topic, stamp_s if is_date else math.nan)

    def topics(self) -> dict[str, str]:
        """Topics by setting."""
        return {name: getattr(self, name) for name in TOPICS}

    @cached_property
    def _translations(self) -> dict[str, Callable[[Any, dict[str, float]], dict[str, float]]]:
        return {
            types.BATTERY_STATE: _battery,
            types.JOINT_STATE: self._wheels,
            types.IMU: self._body,
            types.ODOMETRY: _speed,
            types.TWIST: _speed,
            types.PATH: _home,
        }

    @cached_property
    def _wheel_of(self) -> dict[str, str]:
        """Wheel of each joint that has a name of its own."""
        return {joint: wheel for wheel, joint in self.joints.items()}

    @cached_property
    def _mounted(self) -> np.ndarray:
        """(3, 3) from the frame of the inertial unit to that of the robot."""
        return rotation(*self.imu_rpy)

    def _wheels(self, layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
        """Wheel speeds by the names of the wheels, and the steering angle."""
        wheels = self._wheel_of
        values = {}
        for path, joint in layout.texts.items():
            number = path.removeprefix("name")
            if wheels.get(joint) == "steering" and (angle_rad := numbers.get(f"position{number}")) is not None:
                values["steering_rad"] = angle_rad
                continue
            speed = numbers.get(f"velocity{number}")
            if not path.startswith("name[") or speed is None or (wheels and joint not in wheels):
                continue
            values[f"wheel_speed_rad_s.{wheels.get(joint) or wheel_of(joint)}"] = speed
        return values

    def _body(self, layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
        """Yaw rate, acceleration and pitch of the robot from the inertial unit, which may be mounted turned."""
        if any(self.imu_rpy):
            for path in ("angular_velocity", "linear_acceleration"):
                turned = self._mounted @ [numbers[f"{path}.{axis}"] for axis in "xyz"]
                numbers |= {f"{path}.{axis}": float(value) for axis, value in zip("xyz", turned, strict=True)}
        values = _of_table(types.IMU, numbers)
        x, y, z, w = (numbers[f"orientation.{axis}"] for axis in "xyzw")
        pitch_rad = pitch_of(x, y, z, w, self._mounted[0].tolist())
        if numbers["orientation_covariance[0]"] != -1.0 and math.isfinite(pitch_rad):
            values["pitch_rad"] = pitch_rad
        return values


class RosTime:
    """Time of a simulation or a bag: that of /clock, but no earlier than the stamps received.

    /clock may be late by a fraction of a second, which is several seconds at ten times the rate; a stamp further ahead
    is from another clock. If nobody publishes /clock, the newest stamp gives the time, until a topic begins again.

    Attributes:
        now_s: seconds since 1970, or since the simulation began; nan before the first message.
    """

    def __init__(self) -> None:
        self.now_s = self._clock_s = math.nan
        self._stamps: dict[str, tuple[float, float]] = {}  # least and last of each topic

    def set(self, clock_s: float) -> float:
        """The time after a message of /clock; it goes back if the simulation or the bag restarts."""
        restarts = clock_s < self._clock_s - LEAP_S
        self._clock_s = clock_s
        if restarts or not self.now_s - 2.0 * _CLOCK_LATE_S < clock_s <= self.now_s:
            self.now_s = clock_s
        return self.now_s

    def received(self, stamp_s: float, topic: str = "") -> float:
        """The time of receipt of a message with this stamp."""
        without_clock = math.isnan(self._clock_s)
        if without_clock and self._begins_again(stamp_s, topic):
            self.now_s = stamp_s
        ahead_s = DATED_S if without_clock else _CLOCK_LATE_S
        if math.isnan(self.now_s) or self.now_s < stamp_s < self.now_s + ahead_s:
            self.now_s = stamp_s
        return self.now_s

    def _begins_again(self, stamp_s: float, topic: str) -> bool:
        """True if the stamps of a topic go back to where they began, as those of a bag in a loop."""
        least_s, last_s = self._stamps.get(topic, (stamp_s, stamp_s))
        again = stamp_s < min(least_s + LEAP_S, last_s - LEAP_S)
        if again:
            self._stamps.clear()
        self._stamps[topic] = min(least_s, stamp_s), stamp_s
        return again


def _time(numbers: dict[str, float], path: str) -> float:
    """Time [s] of a field of type `builtin_interfaces/Time`."""
    return numbers[f"{path}.sec"] + 1e-9 * numbers[f"{path}.nanosec"]


@lru_cache(maxsize=1024)
def wheel_of(joint: str) -> str:
    """The wheel of a joint, from its name: `front_left_wheel_joint` turns `front_left`."""
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


def _home(_: Any, numbers: dict[str, float]) -> dict[str, float]:
    """Length of the way home; none for a path of no pose, which planners send where they find no way."""
    return {"home_distance_m": numbers["length_m"]} if math.isfinite(numbers["length_m"]) else {}


def pitch_of(x: float, y: float, z: float, w: float, nose: Sequence[float] = (1.0, 0.0, 0.0)) -> float:
    """Pitch [rad], > 0 with the nose up, from the quaternion of the unit's attitude; nan if it is not an attitude.

    It is the angle between the robot's nose and the horizon; n is the direction of the nose in the frame of the unit:

    sin(pitch) = 2 (x z - w y) n_x + 2 (y z + w x) n_y + (w^2 - x^2 - y^2 + z^2) n_z

    REP-103 counts a rotation about y, which points left, as positive if the nose goes down. The zero of a message that
    was never filled, and the identity of one that was only initialised, are not attitudes; a filter never gives either
    to the last bit.
    """
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) <= _UNIT or x == y == z == 0.0:
        return math.nan
    height = 2.0 * (x * z - w * y) * nose[0] + 2.0 * (y * z + w * x) * nose[1]
    height += (w * w - x * x - y * y + z * z) * nose[2]
    return math.asin(min(max(height / norm, -1.0), 1.0))


def _speed(layout: Layout, numbers: dict[str, float]) -> dict[str, float]:
    """Speed and, if given, its standard deviation."""
    values = _of_table(types.ODOMETRY, numbers)
    if (variance := numbers["twist.covariance[0]"]) > 0.0:
        values["speed_std_m_s"] = math.sqrt(variance)
    return values
