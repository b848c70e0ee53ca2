"""ROS 2 sink: battery state, odometry, speed corrected for slip, and diagnostics."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ohmward.battery.file import load_battery
from ohmward.checks import require_one_of
from ohmward.onboard.clock import LEAP_S
from ohmward.onboard.evidence import usable
from ohmward.onboard.feed import Feed, Rate
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.ros import messages, types
from ohmward.onboard.ros.cdr import serialize
from ohmward.onboard.ros.transport import RosNetwork, SharedNode, Transport, require_topics
from ohmward.optional import MissingPackageError
from ohmward.quantities import names_of

#: Most states that waited for the network to be sent once it is there, as a writer keeps that many: readers of poses
#: and speeds want current ones.
NEWEST = 10


@dataclass(frozen=True)
class Ros2Sink(RosNetwork):
    """States as messages; an empty topic leaves its message out."""

    takes_all: ClassVar[bool] = True  #: takes all states; each message has a rate of its own
    #: topics
    battery_state: str = "battery_state"
    odometry: str = "ohmward/odometry"
    twist: str = "ohmward/twist"
    diagnostics: str = "/diagnostics"
    #: topic of another battery state, whose percentage is the probability of reaching home, for Nav2's `IsBatteryLow`:
    #: unknown (NaN, which counts as full there) without a way home, 0 while the battery sensors are silent
    home: str = ""
    #: frames of REP 105; the base is at the middle of a two-wheeled robot's driven axle or a steered one's rear axle,
    #: else at the centre of gravity
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    battery: str | None = None  #: path of the battery file, for capacity, technology, number of cells and serial number
    publish_tf: bool = False  #: also send the pose as a transform on /tf; nobody else may send that of these frames
    interval_s: float = 0.02  #: least mean time between two odometry and twist messages, >= 0
    slow_s: float = 0.5  #: least mean time between two battery state and diagnostics messages, >= 0
    #: of the battery state: "mean", or "low" for the low end of the 95 % band, which brings a robot home in time and
    #: falls to 0 while the battery sensors are silent
    percentage: str = "mean"
    robot: str = "robot"  #: name of the robot, the hardware in diagnostics
    name: str = "ros2"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        require_topics(self.topics())
        require_one_of("percentage", self.percentage, ("mean", "low"))

    def topics(self) -> dict[str, str]:
        """Topics by setting."""
        return {name: getattr(self, name) for name in ("battery_state", "odometry", "twist", "diagnostics", "home")}

    async def run(self, feed: Feed) -> None:
        """Publish until the feed ends."""
        async with SharedNode(self).opened() as transport:
            await self.run_on(transport, feed)

    async def run_on(self, transport: Transport, feed: Feed) -> None:
        """Publish through the node of this transport."""
        translation = Translation(self)
        missing: dict[str, str] = {}
        for topic, type_ in self.advertised():
            try:
                await asyncio.to_thread(transport.advertise, topic, type_)
            except MissingPackageError as error:  # of one type of message; the others are sent
                missing[topic] = f"{topic} is not sent: {error}"
        feed.trouble = "; ".join(missing.values())
        feed.put_back((await feed.batch())[-NEWEST:])
        while states := await feed.batch(1):
            transport.check()
            for topic, type_, payload in translation.messages(*states):
                if topic not in missing:
                    transport.publish(topic, type_, payload)

    def advertised(self) -> Iterator[tuple[str, str]]:
        """Topic and type of each message that is sent."""
        of_types = (types.BATTERY_STATE, types.ODOMETRY, types.TWIST, types.DIAGNOSTICS, types.BATTERY_STATE)
        for topic, type_ in zip(self.topics().values(), of_types, strict=True):
            if topic:
                yield topic, type_
        if self.publish_tf:
            yield "/tf", types.TF


class Stamp(NamedTuple):
    """Stamp of a message."""

    time_s: float = -math.inf  #: on the clock of the process, which nobody sets
    date_s: float = -math.inf  #: seconds since 1970


class Translation:
    """States as serialised messages, each at its own rate; their stamps do not go back, see `_is_newer`.

    Args:
        sink: topics, frames, rates and battery file, which is read.

    Raises:
        InputError: the battery file cannot be read.
    """

    def __init__(self, sink: Ros2Sink):
        self.sink = sink
        self._label = load_battery(sink.battery) if sink.battery else None
        self._measured: dict[str, float] = {}
        self._restarts = 0
        self._begin()

    def _begin(self) -> None:
        """Begin all times, at the start and when a simulation or a bag restarts."""
        sink = self.sink
        self._drive_s = -math.inf
        self._drive, self._battery, self._conditions = Rate(sink.interval_s), Rate(sink.slow_s), Rate(sink.slow_s)
        self._stamps: dict[str, Stamp] = {}

    def messages(self, state: RobotState) -> Iterator[tuple[str, str, bytes]]:
        """Topic, type and bytes of each message about a state.

        Stamps are times of measurement and increase: what was measured before the last message is left out. Conditions
        are never left out; those of a state before the last one have the stamp of the last.
        """
        sink = self.sink
        if state.restarts != self._restarts:
            self._restarts = state.restarts
            self._begin()
        self._measured |= {name: v for name, v in state.sample.items() if name.partition(".")[0] in names_of("battery")}
        is_new = state.drive_time_s != self._drive_s and not math.isnan(state.drive_time_s)
        self._drive_s = state.drive_time_s
        of_drive = Stamp(state.drive_time_s, state.date_s("drive"))
        if is_new and self._drive.passes(state.drive_time_s) and self._is_newer("drive", of_drive):
            frames = sink.odom_frame, sink.base_frame
            if sink.odometry and state.pose:
                yield sink.odometry, types.ODOMETRY, serialize(types.ODOMETRY, messages.odometry(state, *frames))
            if sink.publish_tf and state.pose:
                yield "/tf", types.TF, serialize(types.TF, messages.transform(state, *frames))
            if sink.twist and state.slip:
                yield sink.twist, types.TWIST, serialize(types.TWIST, messages.twist(state, sink.base_frame))
        if math.isnan(state.battery_time_s):
            self._measured.clear()  # nothing yet, or not since everything restarted
        if (sink.battery_state or sink.home) and self._measured and self._battery.passes(state.time_s):
            cautious = sink.percentage == "low"
            found = messages.battery_state(state, usable(self._measured, state), self._label, sink.base_frame, cautious)
            if found["power_supply_status"] != messages.FULL:
                self._measured.pop("battery_full", None)  # until the charger says so again
            time_s = state.time_s if state.is_silent("battery") else state.battery_time_s
            of_battery = Stamp(time_s, messages.battery_date_s(state))
            if self._is_newer("battery", of_battery):
                of_home = found | {"percentage": messages.home_probability(state)}
                for topic, content in ((sink.battery_state, found), (sink.home, of_home)):
                    if topic:
                        yield topic, types.BATTERY_STATE, serialize(types.BATTERY_STATE, content)
        if sink.diagnostics and self._conditions.passes(state.time_s):
            self._is_newer("conditions", Stamp(state.time_s, state.unix_s))
            conditions = messages.diagnostics(state, sink.robot, self._stamps["conditions"].date_s, sink.full_name)
            yield sink.diagnostics, types.DIAGNOSTICS, serialize(types.DIAGNOSTICS, conditions)

    def _is_newer(self, what: str, stamp: Stamp) -> bool:
        """True if a stamp is later than all before it, or far back because the clock of its dates was set.

        What was queued and comes late is far back, too, but also on the clock of the process.
        """
        last = self._stamps.get(what, Stamp())
        was_set = stamp.time_s > last.time_s and stamp.date_s <= last.date_s - LEAP_S
        if stamp.date_s <= last.date_s and not was_set:
            return False
        self._stamps[what] = Stamp(max(stamp.time_s, last.time_s), stamp.date_s)
        return True
