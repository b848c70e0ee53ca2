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


class PatientConnection(asyncio.Protocol):
    """Limits of a connection of uvicorn: it ends if its client is too slow, or if there are too many connections."""

    connections: Any
    conn: Any
    cycle: Any
    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    #: State of h11 after invalid HTTP, and states in which it can send an answer.
    error_state: Any
    answerable: tuple[Any, ...]
    _asks: asyncio.TimerHandle | None = None
    _reads: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin, unless there are too many connections."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            self.transport.abort()
        else:
            self._await_request()

    def data_received(self, data: bytes) -> None:
        """Take in a piece of a request."""
        super().data_received(data)
        if self.cycle and self.conn.their_state is self.error_state:  # answered with 400: the page sends nothing more
            self.cycle.disconnected = True
        if self.cycle is None or self.cycle.response_complete:
            self._await_request()
        elif self._asks:
            self._asks.cancel()
            self._asks = None

    def send_400_response(self, message: str) -> None:
        """Answer that this was not HTTP; if an answer began before the request was complete, only close."""
        if self.conn.our_state in self.answerable:
            super().send_400_response(message)  # type: ignore[misc]  # of uvicorn
        else:
            self.transport.close()

    def pause_writing(self) -> None:
        """Wait for a client that does not read, for `READ_S` at most."""
        super().pause_writing()
        self._reads = self.loop.call_later(READ_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on with a client that reads again."""
        super().resume_writing()
        if self._reads:
            self._reads.cancel()

    def connection_lost(self, error: Exception | None) -> None:
        """End, and cancel the timers."""
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
