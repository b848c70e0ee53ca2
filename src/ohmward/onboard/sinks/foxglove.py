"""Live view in Foxglove, Lichtblick and PlotJuggler: the messages of ROS 2 on a WebSocket, with their definitions."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass
from typing import Any, ClassVar

from ohmward.checks import require_between
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.ros.types import definition_text
from ohmward.onboard.secrets import is_loopback
from ohmward.onboard.sinks.ros2 import Ros2Sink, Translation
from ohmward.optional import require


@dataclass(frozen=True)
class FoxgloveSink:
    """A server for viewers, who connect to ws://HOST:PORT and cannot send anything."""

    takes_all: ClassVar[bool] = True  #: takes all states; each message has a rate of its own
    #: address to listen on; loopback only, since the protocol has no token: forward the port with `ssh -L
    #: 8765:localhost:8765 robot`
    host: str = "127.0.0.1"
    port: int = 8765  #: TCP port
    battery: str | None = None  #: path of the battery file, for capacity, technology, number of cells and serial number
    interval_s: float = 0.05  #: least time between two odometry and twist messages, >= 0
    name: str = "foxglove"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("port", self.port, 0, 65535)
        if not is_loopback(self.host):
            raise InputError(
                f"host must be a loopback address, got {self.host!r}: the protocol of Foxglove knows no token; from "
                f"elsewhere, forward the port: ssh -L {self.port}:localhost:{self.port} robot"
            )

    async def run(self, feed: Feed) -> None:
        """Serve until the feed ends."""
        foxglove = require("foxglove", "the Foxglove sink")
        logging.getLogger("foxglove.websocket").setLevel(logging.CRITICAL)  # a stranger at the port is an error there
        translation = Translation(Ros2Sink(interval_s=self.interval_s, battery=self.battery))
        context = foxglove.Context()
        try:
            server = foxglove.start_server(name="ohmward", host=self.host, port=self.port, context=context)
        except Exception as error:  # the package's errors have no common type
            raise OhmwardError(f"port {self.port} cannot be used ({error}); choose another one: port = ...") from error
        channels: dict[str, Any] = {}
        try:
            while states := await feed.batch(1):
                (state,) = states
                for topic, type_, payload in translation.messages(state):
                    if topic not in channels:
                        text = definition_text(type_).encode()
                        schema = foxglove.Schema(name=type_, encoding="ros2msg", data=text)
                        channels[topic] = foxglove.Channel(
                            f"/{topic.strip('/')}", schema=schema, message_encoding="cdr", context=context
                        )
                    channels[topic].log(payload, log_time=round(state.unix_s * 1e9))
        finally:
            await asyncio.to_thread(server.stop)
