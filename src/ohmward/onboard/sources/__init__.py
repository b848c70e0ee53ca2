"""Sources of measurements, by the `kind` in the settings."""

from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.replay import ReplaySource
from ohmward.onboard.sources.simulation import SimulationSource

#: Any of them.
AnySource = JsonLinesSource | ReplaySource | SimulationSource

SOURCES: dict[type, str] = {JsonLinesSource: "json-lines", ReplaySource: "replay", SimulationSource: "simulation"}
