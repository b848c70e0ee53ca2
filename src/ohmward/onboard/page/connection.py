"""Connections to the live page: limited in number, and closed if the client neither sends requests nor reads."""

from __future__ import annotations

import asyncio
from typing import Any

from ohmward.optional import require

#: Connections at once, each a file handle of the process, which has a thousand by default; a browser opens six.
MOST_CONNECTIONS = 400

#: Time within which a whole request must come, its body included; over a poor network it takes seconds.
REQUEST_S = 10.0

#: Time after which a client that reads none of the data waiting for it counts as gone.
READ_S = 30.0


def connection_type() -> Any:
    """The class of a connection for `uvicorn.Config(http=...)`; it ends if its client is too slow, or one too many."""
    h11 = require("h11", "the live page")
    protocol: Any = require("uvicorn.protocols.http.h11_impl", "the live page").H11Protocol

    class Connection(protocol):
        asks: asyncio.TimerHandle | None = None
        reads: asyncio.TimerHandle | None = None

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            if len(self.connections) > MOST_CONNECTIONS:
                self.transport.abort()
            else:
                self.await_request()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.cycle and self.conn.their_state is h11.ERROR:  # answered with 400: the page sends nothing more
                self.cycle.disconnected = True
            if self.cycle is None or self.cycle.response_complete:
                self.await_request()
            elif self.asks:
                self.asks.cancel()
                self.asks = None

        def send_400_response(self, message: str) -> None:
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                super().send_400_response(message)
            else:  # an answer began before the request was complete
                self.transport.close()

        def pause_writing(self) -> None:
            super().pause_writing()
            self.reads = self.loop.call_later(READ_S, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            if self.reads:
                self.reads.cancel()

        def connection_lost(self, error: Exception | None) -> None:
            super().connection_lost(error)
            for timer in (self.asks, self.reads):
                if timer:
                    timer.cancel()

        def await_request(self) -> None:
            """End the connection unless the head of a request comes in time."""
            if self.asks is None:
                self.asks = self.loop.call_later(REQUEST_S, self.transport.abort)

    return Connection
