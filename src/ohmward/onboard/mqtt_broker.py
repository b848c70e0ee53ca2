"""Connection to an MQTT broker through paho, with a fix in every error; the password comes from a secret."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_between
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.message import Handover
from ohmward.onboard.secrets import check_secret_name, is_loopback, secret
from ohmward.optional import require

#: Keep-alive interval of MQTT, and longest wait for the broker's answer to a connection [s].
KEEP_ALIVE_S = 10
_ANSWER_S = 5.0


class Payload(NamedTuple):
    """A payload of a topic, and the monotonic time of its receipt."""

    topic: str
    payload: bytes
    received_s: float
    retained: bool = False  #: True if the broker has kept it from before the subscription


@dataclass(frozen=True)
class MqttBroker:
    """A broker."""

    #: host and port of the broker
    host: str = "localhost"
    port: int = 1883
    username: str | None = None  #: if the broker requires one
    password: str | None = None  #: secret of that user
    tls: bool = False  #: encrypt, and check the broker's certificate
    ca_file: str | None = None  #: path of the certificate authority's file, if not one of the system's

    def __post_init__(self) -> None:
        require_between("port", self.port, 1, 65535)
        if self.password is not None:
            check_secret_name("password", self.password)
            if self.username is None:
                raise InputError("password without username; give both")
            if not self.tls and not is_loopback(self.host):
                raise InputError(
                    f"the password would go to {self.host} for everybody on the way to read; write tls = true "
                    "(port 8883), or leave username and password out"
                )
        if self.ca_file and not self.tls:
            raise InputError("ca_file without TLS; write tls = true")

    @asynccontextmanager
    async def connected(self, will: tuple[str, str] | None = None) -> AsyncIterator[tuple[Any, Handover[Payload]]]:
        """A connection, paho's client and what it receives, closed at the end.

        will: topic and retained payload that the broker publishes when the connection is lost.

        Raises:
            OhmwardError: the broker is not there, or refuses.
            MissingPackageError: paho is not installed.
        """
        received: Handover[Payload] = Handover()
        client = self._client(received)
        if will:
            client.will_set(*will, qos=1, retain=True)
        connected = asyncio.Event()
        loop = asyncio.get_running_loop()

        def on_connect(_client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
            if reason.is_failure:
                received.fail(OhmwardError(f"{self._place} refuses ({reason}); check username, password and its ACL"))
            loop.call_soon_threadsafe(connected.set)

        client.on_connect = on_connect
        try:
            await asyncio.to_thread(client.connect, self.host, self.port, KEEP_ALIVE_S)
        except (OSError, ValueError) as error:
            raise OhmwardError(f"no MQTT broker at {self._place} ({error}); is it running there?") from error
        client.loop_start()
        try:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(connected.wait(), _ANSWER_S)
            if not client.is_connected():
                received.fail(
                    OhmwardError(f"{self._place} does not answer as an MQTT broker; check host, port and tls")
                )
                await received.take()
            yield client, received
        finally:
            if will:  # who disconnects by itself has no last will
                client.publish(*will, qos=0, retain=True)  # qos 1 might wait behind others
            client.disconnect()
            await asyncio.to_thread(client.loop_stop)

    @property
    def _place(self) -> str:
        return f"{self.host}:{self.port}"

    def _client(self, received: Handover[Payload]) -> Any:
        """Client of paho, whose thread hands everything over."""
        paho = require("paho.mqtt.client", "MQTT")

        client = paho.Client(paho.CallbackAPIVersion.VERSION2, reconnect_on_failure=False)
        client.connect_timeout = _ANSWER_S
        if self.username is not None:
            client.username_pw_set(self.username, secret("password", self.password) or None)
        if self.tls:
            try:
                client.tls_set(ca_certs=self.ca_file)
            except (OSError, ValueError) as error:
                raise OhmwardError(f"ca_file: {self.ca_file} cannot be used ({error}); give a PEM file") from error
        client.on_message = lambda _client, _data, m: received.put(
            Payload(m.topic, m.payload, time.monotonic(), m.retain)
        )
        client.on_disconnect = lambda _client, _data, _flags, reason, _properties: received.fail(
            OhmwardError(f"the connection to {self._place} is lost ({reason}); is the broker running?")
        )
        return client
