"""Sources of measurements, by the `kind` in the settings."""

from typing import get_args

from ohmward.onboard.sources.can import CanSource
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.mqtt import MqttSource
from ohmward.onboard.sources.replay import ReplaySource
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.onboard.sources.serial import SerialSource
from ohmward.onboard.sources.simulation import SimulationSource

#: Any source.
AnySource = CanSource | JsonLinesSource | MqttSource | ReplaySource | Ros2Source | SerialSource | SimulationSource

#: Kind of each source, which is its name unless the setup gives another one.
SOURCES: dict[type, str] = {source: source.name for source in get_args(AnySource)}
