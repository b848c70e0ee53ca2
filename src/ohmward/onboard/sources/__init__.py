"""Sources of measurements, by the `kind` in the settings."""

from ohmward.onboard.sources.json_lines import JsonLinesSource
from ohmward.onboard.sources.replay import ReplaySource

#: Any of them.
AnySource = JsonLinesSource | ReplaySource

SOURCES: dict[type, str] = {JsonLinesSource: "json-lines", ReplaySource: "replay"}
