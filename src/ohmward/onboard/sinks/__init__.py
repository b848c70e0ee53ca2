"""Sinks of states, by the `kind` in the settings."""

from ohmward.onboard.sinks.json_lines import JsonLinesSink

#: Any of them.
AnySink = JsonLinesSink

SINKS: dict[type, str] = {JsonLinesSink: "json-lines"}
