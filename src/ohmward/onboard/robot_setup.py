"""The setup of a robot, `robot.toml` of `ohmward run`: its battery, its wheels, sources and sinks."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import product

from ohmward.checks import require_between
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

    name: str = "robot"  #: of the robot: in topics, rows of the store, the page
    battery: str | None = None  #: path of the battery file; without it no charge and no range
    #: path of the robot file or the name of a packaged robot; without it no speed, slip and pose
    robot: str | None = None
    consumption: str | None = None  #: path of the consumption table, which learns; by default in the state's folder
    #: folder of what survives a loss of power: snapshots and tables; `ohmward-state` unless given. Where all sources
    #: are replays and simulations, nothing is kept unless it is given.
    state: str | None = None
    learn: bool = False  #: let the battery file learn from day to day, in that folder
    #: refuse to start while a source or sink cannot; by default the process starts with what it has
    strict: bool = False
    delay_s: float = 0.0  #: messages wait so long for others with an earlier time, >= 0
    counts_per_turn: float | None = None  #: of the encoders, where they send counts
    alarms: AlarmLimits = field(default_factory=AlarmLimits)  #: when somebody has to hear of something
    #: where measurements come from and where estimates go, each with its `kind`
    source: tuple[AnySource, ...] = ()
    sink: tuple[AnySink, ...] = ()

    def __post_init__(self) -> None:
        require_between("delay_s", self.delay_s, 0.0, 10.0)
        if self.battery is None and self.robot is None:
            raise InputError('nothing to estimate: give battery = "battery.toml", robot = "robot.toml" or both')
        for kind, parts in (("source", self.source), ("sink", self.sink)):
            twice = [name for name, count in Counter(part.name for part in parts).items() if count > 1]
            if twice:
                raise InputError(f"two {kind}s are called {twice[0]!r}; give each a name of its own: name = ...")
        for source, sink in product(self.source, self.sink):
            if isinstance(source, Ros2Source) and isinstance(sink, Ros2Sink):
                _require_others_topics(source, sink)


def _require_others_topics(source: Ros2Source, sink: Ros2Sink) -> None:
    """Raise InputError where a source of ROS hears a sink of the same process."""
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
)
