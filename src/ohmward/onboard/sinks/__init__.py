"""Sinks of states, by the `kind` in the settings."""

from typing import get_args

from ohmward.onboard.sinks.can import CanSink
from ohmward.onboard.sinks.control import ControlSink
from ohmward.onboard.sinks.foxglove import FoxgloveSink
from ohmward.onboard.sinks.json_lines import JsonLinesSink
from ohmward.onboard.sinks.mqtt import MqttSink
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.sinks.ros2 import Ros2Sink
from ohmward.onboard.sinks.server import InfluxSink, PostgresqlSink
from ohmward.onboard.sinks.store import StoreSink
from ohmward.onboard.sinks.terminal import TerminalSink
from ohmward.onboard.sinks.webhook import WebhookSink

#: Any sink.
AnySink = (
    CanSink
    | ControlSink
    | FoxgloveSink
    | InfluxSink
    | JsonLinesSink
    | MqttSink
    | PageSink
    | PostgresqlSink
    | Ros2Sink
    | StoreSink
    | TerminalSink
    | WebhookSink
)

#: Kind of each sink, which is its name unless the setup gives another one.
SINKS: dict[type, str] = {sink: sink.name for sink in get_args(AnySink)}
