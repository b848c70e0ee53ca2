"""MQTT: topics with a number each, or with JSON objects.

What the broker has retained from before the subscription is left out: nobody knows when it was measured, or whether
anybody still measures it. Devices stamp with clocks of their own, so each topic has one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.message import Message, Put, Signals, Wiring, as_number, json_value
from ohmward.onboard.mqtt_broker import MqttBroker, Payload
from ohmward.onboard.part import FaultyInput
from ohmward.onboard.sources.json_lines import LONGEST_LINE, own_names

#: Separator of topic and JSON key in the name of a signal; no topic contains it.
_KEY = "#"


@dataclass(frozen=True)
class MqttSource(MqttBroker):
    """Topics of a broker."""

    #: quantity -> "TOPIC" with a number as payload, or "TOPIC#KEY" of a JSON object
    signals: Signals = field(default_factory=dict)
    topics: tuple[str, ...] = ()  #: topics of JSON objects whose keys are quantities; wildcards + and #
    time: str = "time_s"  #: key of the time stamp in JSON objects [s]; without one the time of receipt is used
    name: str = "mqtt"  #: in diagnostics

    def __post_init__(self) -> None:
        super().__post_init__()
        wiring = Wiring(self.signals)
        if not self.signals and not self.topics:
            raise InputError('no topics; name some: signals = {battery_current_A = "robot/bms#current"}')
        for name in wiring.signals:
            topic = name.partition(_KEY)[0]
            if not topic or "+" in topic:
                raise InputError(f"{name!r} is not the name of one topic; write TOPIC or TOPIC#KEY")

    async def run(self, put: Put) -> None:
        """Put the messages of the topics until the connection is lost."""
        wiring = Wiring(self.signals)
        faulty = FaultyInput(self.name, "payloads are neither a number nor a JSON object with wired keys")
        async with self.connected() as (client, received):
            topics = {name.partition(_KEY)[0] for name in wiring.signals} | set(self.topics)
            result, _ = client.subscribe([(topic, 0) for topic in sorted(topics)])
            if result:
                raise OhmwardError(f"{self.host}:{self.port} takes no subscription to {', '.join(sorted(topics))}")
            while True:
                for payload in await received.take():
                    if payload.retained:
                        continue
                    if message := self.message(payload, wiring):
                        put(message)
                    else:
                        faulty.count()

    def message(self, payload: Payload, wiring: Wiring) -> Message | None:
        """The message of a payload; None if it has no quantity."""
        topic, received_s = payload.topic, payload.received_s
        found = json_value(payload.payload) if len(payload.payload) <= LONGEST_LINE else None
        if not isinstance(found, dict):
            values = wiring.values({topic: found}) if isinstance(found, int | float) else {}
            return Message(math.nan, received_s, self.name, values) if values else None
        values = wiring.values({f"{topic}{_KEY}{key}": value for key, value in found.items()})
        if self.topics:
            values = own_names(found) | values
        stamp_s = as_number(found.get(self.time, math.nan))
        publisher = "" if wiring.sums.keys() & values.keys() else topic
        return Message(stamp_s, received_s, self.name, values, publisher) if values else None
