"""Sources of measurements, by the `kind` in the settings."""

from ohmward.onboard.sources.can import CanSource
from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.mqtt import MqttSource
from ohmward.onboard.sources.replay import ReplaySource
from ohmward.onboard.sources.serial import SerialSource
from ohmward.onboard.sources.simulation import SimulationSource

#: Any of them.
AnySource = CanSource | JsonLinesSource | MqttSource | ReplaySource | SerialSource | SimulationSource

SOURCES: dict[type, str] = {
    CanSource: "can",
    JsonLinesSource: "json-lines",
    MqttSource: "mqtt",
    ReplaySource: "replay",
    SerialSource: "serial",
    SimulationSource: "simulation",
}
