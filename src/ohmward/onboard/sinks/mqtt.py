"""MQTT sink: the robot's state as one JSON object, single numbers as topics of their own, and a last will."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

from ohmward.errors import InputError, OhmwardError
from ohmward.json_values import plain
from ohmward.onboard.feed import Feed
from ohmward.onboard.mqtt_broker import MqttBroker
from ohmward.onboard.page.metrics import home_assistant
from ohmward.onboard.page.view import view
from ohmward.onboard.robot_state import RobotState, number_at, plain_state, require_path

#: Time that the broker has to acknowledge what was sent [s].
_ACKNOWLEDGE_S = 10.0
#: Number of states sent before the broker has to acknowledge.
_STATES_AT_ONCE = 100


@dataclass(frozen=True)
class MqttSink(MqttBroker):
    """States to a broker, retained, each acknowledged by it; unacknowledged ones wait in the feed."""

    identity: ClassVar[str] = "topic"  #: setting by which receivers tell robots apart
    #: the state is sent to TOPIC/state, alarms to TOPIC/alarms when one begins or ends, "online" to TOPIC/status, and
    #: "offline" once the connection is lost
    topic: str = "ohmward/robot"
    #: numbers of the state with a topic of their own: "battery.soc" goes to TOPIC/battery/soc
    numbers: tuple[str, ...] = ()
    home_assistant: str = ""  #: discovery prefix of Home Assistant, by default "homeassistant" there; empty for none
    robot: str = "robot"  #: name of the device in Home Assistant
    interval_s: float = 1.0  #: least time between two states, >= 0
    name: str = "mqtt"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.topic or set("+#\0") & set(self.topic):
            raise InputError(f"topic must be a topic without + and #, got {self.topic!r}")
        for path in self.numbers:
            require_path(path)

    async def run(self, feed: Feed) -> None:
        """Publish states until the feed ends."""
        status = f"{self.topic}/status"
        async with self.connected((status, "offline")) as (client, _):
            client.publish(status, "online", qos=1, retain=True)
            for topic, about in self.discovery():
                client.publish(topic, json.dumps(about), qos=1, retain=True)
            alarms: tuple[str, ...] | None = None
            while states := await feed.batch(_STATES_AT_ONCE):
                sent: list[tuple[RobotState, list[Any]]] = []
                for state in states:
                    if (names := tuple(alarm.name for alarm in state.alarms)) != alarms:
                        client.publish(f"{self.topic}/alarms", json.dumps(plain(state.alarms)), qos=1, retain=True)
                        alarms = names
                    sent.append((state, [client.publish(t, p, qos=1, retain=True) for t, p in self.payloads(state)]))
                await asyncio.to_thread(_acknowledged, [info for _, infos in sent for info in infos])
                if missing := [state for state, infos in sent if not all(map(_has_arrived, infos))]:
                    feed.put_back(missing)
                    raise OhmwardError(f"{self.host}:{self.port} does not acknowledge; is the broker running?")

    async def try_out(self) -> None:
        """Connect without publishing anything."""
        async with self.connected() as (_, received):
            await received.take()

    def discovery(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Topics and objects by which Home Assistant finds the robot."""
        if self.home_assistant:
            for topic, about in home_assistant(self.topic, self.robot):
                yield f"{self.home_assistant}/{topic}", about

    def payloads(self, state: RobotState) -> Iterator[tuple[str, str]]:
        """Topics and payloads of a state; an unknown number has an empty payload, which deletes the retained one."""
        yield f"{self.topic}/state", json.dumps(plain_state(state), allow_nan=False)
        if self.home_assistant:
            yield f"{self.topic}/now", json.dumps(view(state), allow_nan=False)
        for path in self.numbers:
            value = number_at(state, path)
            yield f"{self.topic}/{path.replace('.', '/')}", f"{value:.9g}" if math.isfinite(value) else ""


def _acknowledged(infos: list[Any]) -> None:
    """Wait until the broker has acknowledged them all, or fails to acknowledge one in time."""
    for info in infos:
        with suppress(RuntimeError, ValueError):  # not connected
            info.wait_for_publish(_ACKNOWLEDGE_S)
        if not _has_arrived(info):
            return


def _has_arrived(info: Any) -> bool:
    """True if the broker has acknowledged; paho raises for what it could not send."""
    try:
        return bool(info.is_published())
    except (RuntimeError, ValueError):
        return False
