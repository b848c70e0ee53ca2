"""Sinks of states, by the `kind` in the settings."""

from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.sinks.terminal import TerminalSink

#: Any of them.
AnySink = JsonLinesSink | TerminalSink

SINKS: dict[type, str] = {JsonLinesSink: "json-lines", TerminalSink: "terminal"}
