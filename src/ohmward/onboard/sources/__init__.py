"""Sources of measurements, by the `kind` in the settings."""

from ohmward.onboard.sources.can import CanSource
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.mqtt import MqttSource
from ohmward.onboard.sources.replay import ReplaySource
from ohmward.onboard.sources.ros2 import Ros2Source
from ohmward.onboard.sources.serial import SerialSource
from ohmward.onboard.sources.simulation import SimulationSource

#: Any source.
AnySource = CanSource | JsonLinesSource | MqttSource | ReplaySource | Ros2Source | SerialSource | SimulationSource

SOURCES: dict[type, str] = {
    CanSource: "can",
    JsonLinesSource: "json-lines",
    MqttSource: "mqtt",
    ReplaySource: "replay",
    Ros2Source: "ros2",
    SerialSource: "serial",
    SimulationSource: "simulation",
}
