"""Connections to the live page: so many at once, and none that neither asks nor reads holds one for long."""

from __future__ import annotations

import asyncio
from typing import Any

from ohmward.optional import require

#: Connections at once, each a file handle of the process, which has a thousand by default; a browser opens six.
MOST_CONNECTIONS = 400

#: A request has come whole after so long, its body included; over a poor network it takes seconds.
REQUEST_S = 10.0

#: A client that has read nothing for so long, with data waiting for it, is gone.
READ_S = 30.0


class PatientConnection(asyncio.Protocol):
    """Limits of a connection of uvicorn: it ends when its client is too slow, or one too many."""

    connections: Any
    conn: Any
    cycle: Any
    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    #: State of h11 after something that is no HTTP, and states in which it sends an answer.
    error_state: Any
    answerable: tuple[Any, ...]
    _asks: asyncio.TimerHandle | None = None
    _reads: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            self.transport.abort()
        else:
            self._await_request()

    def data_received(self, data: bytes) -> None:
        """Take in a piece of a request."""
        super().data_received(data)
        if self.cycle and self.conn.their_state is self.error_state:  # answered with 400: the page has no more to say
            self.cycle.disconnected = True
        if self.cycle is None or self.cycle.response_complete:
            self._await_request()
        elif self._asks:
            self._asks.cancel()
            self._asks = None

    def send_400_response(self, message: str) -> None:
        """Say that this was no HTTP; a connection whose answer has begun, before the request was whole, only ends."""
        if self.conn.our_state in self.answerable:
            super().send_400_response(message)  # type: ignore[misc]  # of uvicorn
        else:
            self.transport.close()

    def pause_writing(self) -> None:
        """Wait for a client that does not read."""
        super().pause_writing()
        self._reads = self.loop.call_later(READ_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on: it reads."""
        super().resume_writing()
        if self._reads:
            self._reads.cancel()

    def connection_lost(self, error: Exception | None) -> None:
        """End."""
        super().connection_lost(error)
        for timer in (self._asks, self._reads):
            if timer:
                timer.cancel()

    def _await_request(self) -> None:
        """End the connection unless the head of a request comes in time."""
        if self._asks is None:
            self._asks = self.loop.call_later(REQUEST_S, self.transport.abort)


def connection_type() -> Any:
    """The class of a connection for `uvicorn.Config(http=...)`."""
    h11 = require("h11", "the live page")
    h11_impl = require("uvicorn.protocols.http.h11_impl", "the live page")
    states = {"error_state": h11.ERROR, "answerable": (h11.IDLE, h11.SEND_RESPONSE)}
    return type("Connection", (PatientConnection, h11_impl.H11Protocol), states)
