"""The setup of a robot, `robot.toml` of `ohmward run`: its battery, its wheels, sources and sinks."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import product

from ohmward.checks import require_between, require_each_not_negative, require_positive
from ohmward.errors import InputError
from ohmward.onboard.alarms import AlarmLimits
from ohmward.onboard.ros.transport import require_others_topics
from ohmward.onboard.ros.zenoh_transport import full_name
from ohmward.onboard.sinks import SINKS, AnySink
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sources import SOURCES, AnySource
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.toml_file import TomlFile


@dataclass(frozen=True)
class Setup:
    """Everything that the process on the robot needs."""

    name: str = "robot"  #: name of the robot in topics, store and page
    battery: str | None = None  #: path of the battery file; without it neither SoC nor range
    #: path of a robot file or name of a packaged robot; without it neither speed, slip nor pose
    robot: str | None = None
    consumption: str | None = None  #: path of the consumption table, which is updated; default: in the folder `state`
    #: folder of snapshots and tables that survive a loss of power; default: `ohmward-state`, or none if all sources are
    #: replays or simulations
    state: str | None = None
    learn: bool = False  #: update the battery file from day to day, in the folder `state`
    strict: bool = False  #: refuse to start if a source or sink cannot; otherwise the process starts with the rest
    delay_s: float = 0.0  #: time to wait for late messages of other sources, >= 0
    counts_per_turn: float | None = None  #: of encoders that send counts, > 0
    cutoff_V: float = 0.0  #: voltage of the battery at which the robot stops, for its range; 0 if nothing monitors it
    #: relative error of the gain of the robot's voltage sensor against that of the battery's test, 0 if it is the same
    #: one; default: the battery file's, 0.002 if that is 0
    voltage_gain_std: float | None = None
    alarms: AlarmLimits = field(default_factory=AlarmLimits)  #: limits beyond which an alarm is raised
    #: origin of the measurements and destination of the estimates, each with its `kind`
    source: tuple[AnySource, ...] = ()
    sink: tuple[AnySink, ...] = ()

    def __post_init__(self) -> None:
        require_between("delay_s", self.delay_s, 0.0, 10.0)
        if self.counts_per_turn is not None:
            require_positive("counts_per_turn", self.counts_per_turn)
        require_each_not_negative("", self, "cutoff_V")
        if self.voltage_gain_std is not None:
            require_between("voltage_gain_std", self.voltage_gain_std, 0.0, 0.1)
        if self.battery is None and self.robot is None:
            raise InputError('nothing to estimate: give battery = "battery.toml", robot = "robot.toml" or both')
        for kind, parts in (("source", self.source), ("sink", self.sink)):
            twice = [name for name, count in Counter(part.name for part in parts).items() if count > 1]
            if twice:
                raise InputError(f"two {kind}s are called {twice[0]!r}; give each a name of its own: name = ...")
        for sink, key in product(self.sink, ("interval_s", "slow_s")):
            require_between(f"{key} of sink {sink.name}", getattr(sink, key, 0.0), 0.0, math.inf)
        for source, sink in product(self.source, self.sink):
            if isinstance(source, Ros2Source) and isinstance(sink, Ros2Sink):
                _require_others_topics(source, sink)


def _require_others_topics(source: Ros2Source, sink: Ros2Sink) -> None:
    """Raise InputError if a source of ROS would receive the messages of a sink of the same process."""
    if source.domain is not None and sink.domain is not None and source.domain != sink.domain:
        return
    heard, sent = (
        {f"{setting} of {kind} {part.name}": full_name(part.namespace, topic) for setting, topic in topics if topic}
        for kind, part, topics in (("source", source, source.topics().items()), ("sink", sink, sink.topics().items()))
    )
    require_others_topics(heard, sent)


SETUP_FILE = TomlFile(
    Setup,
    "ohmward-setup/1",
    "# What runs on this robot: `ohmward run` reads it, `ohmward run --check` tries it.",
    kinds=SOURCES | SINKS,
    made_by="`ohmward setup`",
)
