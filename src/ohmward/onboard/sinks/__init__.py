"""Sinks of states, by the `kind` in the settings."""

from ohmward.onboard.sinks.can import CanSink
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sinks.terminal import TerminalSink

#: Any of them.
AnySink = CanSink | ControlSink | JsonLinesSink | MqttSink | PageSink | Ros2Sink | TerminalSink

SINKS: dict[type, str] = {
    CanSink: "can",
    ControlSink: "control",
    JsonLinesSink: "json-lines",
    MqttSink: "mqtt",
    PageSink: "page",
    Ros2Sink: "ros2",
    TerminalSink: "terminal",
}
