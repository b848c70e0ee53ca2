"""Sinks of states, by the `kind` in the settings."""

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

SINKS: dict[type, str] = {
    CanSink: "can",
    ControlSink: "control",
    InfluxSink: "influxdb",
    FoxgloveSink: "foxglove",
    JsonLinesSink: "json-lines",
    MqttSink: "mqtt",
    PageSink: "page",
    PostgresqlSink: "postgresql",
    Ros2Sink: "ros2",
    StoreSink: "store",
    TerminalSink: "terminal",
    WebhookSink: "webhook",
}
