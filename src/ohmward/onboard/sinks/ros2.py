"""ROS 2 out: state of the battery, odometry, speed in spite of slip, and diagnostics."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass

from ohmward.battery.battery import Battery
from ohmward.battery.file import load_battery
from ohmward.checks import require_between
from ohmward.onboard.feed import Feed
from ohmward.onboard.robot_state import OF_CHARGE, Level, RobotState
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.ros.messages import Frames
from ohmward.onboard.ros.transport import RosNetwork
from ohmward.quantities import names_of

#: Of the states that waited for the network so many are sent once it is there, as a writer keeps that many: readers of
#: poses and speeds want those of now.
KEPT = 10


@dataclass(frozen=True)
class Ros2Sink(RosNetwork):
    """States as messages; an empty topic leaves its message out."""

    #: topics
    battery_state: str = "battery_state"
    odometry: str = "ohmward/odometry"
    twist: str = "ohmward/twist"
    diagnostics: str = "/diagnostics"
    #: of REP-105; the base is the robot's centre of gravity
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    battery: str | None = None  #: path of the battery file, for capacity, technology, number of cells and serial number
    interval_s: float = 0.02  #: least time between two messages of odometry and twist, >= 0
    #: the same of the state of the battery and of diagnostics, which are for people and behaviour trees
    slow_s: float = 0.5
    robot: str = "robot"  #: name of the robot, as the hardware in diagnostics
    name: str = "ros2"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between("interval_s", self.interval_s, 0.0, 3600.0)
        require_between("slow_s", self.slow_s, 0.0, 3600.0)

    def topics(self) -> dict[str, str]:
        """Topics by setting."""
        return {name: getattr(self, name) for name in ("battery_state", "odometry", "twist", "diagnostics")}

    async def run(self, feed: Feed) -> None:
        """Publish until the feed ends."""
        battery = load_battery(self.battery) if self.battery else None
        transport = await asyncio.to_thread(self.open)
        translation = Translation(self, battery)
        try:
            feed.put_back((await feed.batch())[-KEPT:])
            async for state in feed:
                transport.check()
                for topic, type_, payload in translation.messages(state):
                    transport.publish(topic, type_, payload)
        finally:
            await asyncio.to_thread(transport.close)


class Translation:
    """States as serialised messages, the slow ones from time to time.

    Args:
        sink: topics, frames and rates.
        battery: its label, where it is known.
    """

    def __init__(self, sink: Ros2Sink, battery: Battery | None = None):
        self.sink, self.battery = sink, battery
        self._frames = Frames(sink.odom_frame, sink.base_frame)
        self._measured: dict[str, float] = {}
        self._slow_s = self._drive_s = -math.inf

    def messages(self, state: RobotState) -> Iterator[tuple[str, str, bytes]]:
        """Topic, type and bytes of each message about a state."""
        sink = self.sink
        self._measured |= {name: v for name, v in state.sample.items() if name.partition(".")[0] in names_of("battery")}
        if state.drive_time_s > self._drive_s:
            self._drive_s = state.drive_time_s
            if sink.odometry and state.pose:
                yield sink.odometry, types.ODOMETRY, serialize(types.ODOMETRY, messages.odometry(state, self._frames))
            if sink.twist and state.slip:
                yield sink.twist, types.TWIST, serialize(types.TWIST, messages.twist(state, self._frames))
        if 0.0 <= state.time_s - self._slow_s < sink.slow_s:
            return
        self._slow_s = state.time_s
        if sink.battery_state and self._measured:
            found = messages.battery_state(state, self._reporting(state), self.battery, self._frames)
            if found["power_supply_status"] != messages.FULL:
                self._measured.pop("battery_full", None)  # until the charger says so again
            yield sink.battery_state, types.BATTERY_STATE, serialize(types.BATTERY_STATE, found)
        if sink.diagnostics:
            array = messages.diagnostics(state, sink.robot)
            yield sink.diagnostics, types.DIAGNOSTICS, serialize(types.DIAGNOSTICS, array)

    def _reporting(self, state: RobotState) -> dict[str, float]:
        """Latest values of the battery's sensors, nan for one that is silent or tells nothing true.

        A charge that has become unknown says so of its sensors at once, their conditions at the next look.
        """
        useless = {condition.name for condition in state.diagnostics if condition.level >= Level.ERROR}
        if state.battery is None and math.isfinite(state.battery_time_s):
            useless |= {name for name in self._measured if name.partition(".")[0] in {*OF_CHARGE, "battery_full"}}
        return {signal: math.nan if signal in useless else value for signal, value in self._measured.items()}
