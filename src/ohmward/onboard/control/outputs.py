"""Commands to the drives: frames of the user's database on CAN, or a JSON object by MQTT."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.can_bus import NO_FRAMES, CanPort
from ohmward.onboard.can_database import CanDatabase, CanEncoder
from ohmward.onboard.control.loop import Send
from ohmward.onboard.message import ScaledSignal
from ohmward.onboard.mqtt_broker import MqttBroker


@dataclass(frozen=True)
class CanOutput(CanPort):
    """Frames on a bus.

    Attributes:
        interface, channel, bitrate, fd: of the bus.
        dbc: path of the database.
        signals: "torque_Nm.WHEEL" or "wheel_speed_rad_s.WHEEL", "enable", "counter" -> "MESSAGE.SIGNAL".
    """

    dbc: str = ""
    signals: dict[str, str | ScaledSignal] = field(default_factory=dict)

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: of the numbers that there are."""
        for name in self.signals:
            if name not in names:
                raise InputError(f"can.signals: {name!r} is no number for the drives; there are: {', '.join(names)}")
        encoder = CanEncoder(CanDatabase(self.dbc), self.signals)
        bus = self.open(NO_FRAMES)
        try:
            yield lambda numbers: self.send(bus, encoder.frames(numbers))
        finally:
            bus.shutdown()

    def __post_init__(self) -> None:
        if not self.dbc:
            raise InputError('dbc is missing; name the database of the bus: dbc = "robot.dbc"')
        if "enable" not in self.signals:
            raise InputError(
                'signals has no "enable"; wire the signal that lets the drives turn: enable = "Drive.Enable"'
            )


@dataclass(frozen=True)
class MqttOutput(MqttBroker):
    """A JSON object of all numbers at a topic, not retained.

    Attributes:
        host, port, username, password, tls, ca_file: of the broker.
        topic: of the commands.
    """

    topic: str = "ohmward/robot/drives"

    @asynccontextmanager
    async def opened(self, names: list[str]) -> AsyncIterator[Send]:
        """The function that sends; names: of the numbers that there are."""
        async with self.connected() as (client, _):

            def send(numbers: Mapping[str, float]) -> None:
                if client.publish(self.topic, json.dumps(dict(numbers)), qos=0).rc:
                    raise OhmwardError(f"{self.host}:{self.port} takes no commands")

            yield send
