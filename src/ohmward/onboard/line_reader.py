"""Lines of a connection, as they come, and limits on the number of connections to an address.

The reader is a protocol of asyncio, which wakes the process half as often as a stream.
"""

from __future__ import annotations

import asyncio
import math
import os
from collections import deque
from collections.abc import Callable

from ohmward.errors import OhmwardError

#: Longest line that is read [bytes]; a longer one is left out.
LONGEST_LINE = 1 << 16

#: Most connections to an address that have sent nothing valid yet, and that have: each is a file handle of the process,
#: which has a thousand by default.
MOST_STRANGERS, MOST_KNOWN = 32, 64

#: Most connections that the operating system hands over at once; each takes a handle before it can be refused.
BACKLOG = 16

#: Lines of a burst that are read before others have their turn: some milliseconds.
LINES_AT_ONCE = 16


def cannot_listen(place: str, error: OSError) -> OhmwardError:
    """Error that names an address and the reason why nobody can listen at it."""
    reason = os.strerror(error.errno) if error.errno and error.errno > 0 else error
    return OhmwardError(f"{place} cannot be listened at ({reason}); end the process that does, or choose another port")


class LineReader(asyncio.Protocol):
    """Lines of one connection, one after the other.

    Args:
        take: takes a line without its end; never raises.
        left_out: is called for a line that is too long.
        end: is called once, after the last line, with the error that ended the connection, or None.
        begin: is called once, with the connection.
    """

    def __init__(
        self,
        take: Callable[[bytes], object],
        left_out: Callable[[], None],
        end: Callable[[Exception | None], None],
        begin: Callable[[asyncio.BaseTransport], None] | None = None,
    ):
        self._take, self._left_out, self._end, self._begin = take, left_out, end, begin
        self._waiting: deque[bytes] = deque()
        self._rest, self._skipping = b"", False
        self._busy, self._closed = False, False
        self._error: Exception | None = None
        self.transport: asyncio.ReadTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.ReadTransport)
        self.transport = transport
        if self._begin:
            self._begin(transport)

    def data_received(self, data: bytes) -> None:
        """Take in received data; a line that is too long is left out entirely."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines and self._skipping:
            del lines[0]
            self._skipping = False
        for line in lines:
            if len(line) > LONGEST_LINE:
                self._left_out()
            else:
                self._waiting.append(line)
        if len(self._rest) > LONGEST_LINE:
            if not self._skipping:
                self._left_out()
            self._rest, self._skipping = b"", True
        if not self._busy:
            self._take_some()

    def connection_lost(self, error: Exception | None) -> None:
        """Take what is left, and end."""
        self._closed, self._error = True, error
        if not self._busy:
            self._take_some()

    def _take_some(self) -> None:
        """Take a few lines; while some are left, nothing more is read."""
        for _ in range(min(LINES_AT_ONCE, len(self._waiting))):
            self._take(self._waiting.popleft())
        was_busy, self._busy = self._busy, bool(self._waiting)
        if self._busy:
            if not was_busy and self.transport and not self._closed:
                self.transport.pause_reading()
            asyncio.get_running_loop().call_soon(self._take_some)
        elif self._closed:
            if self._rest and not self._skipping:
                self._take(self._rest)
            self._end(self._error)
        elif was_busy and self.transport:
            self.transport.resume_reading()


class Visitors:
    """Connections to an address that anybody may reach, in bounded numbers.

    A stranger becomes known by what it sends. If there are too many strangers the oldest is closed; if there are too
    many known ones, the one silent for longest: no number of idle or dead connections keeps others out.

    Args:
        wait_s: time after which a stranger is closed.
        left_out: is called for each that is closed so.
    """

    def __init__(self, left_out: Callable[[], None], wait_s: float = math.inf):
        self._left_out, self._wait_s = left_out, wait_s
        self._strangers: dict[asyncio.BaseTransport, asyncio.TimerHandle | None] = {}
        self._known: dict[asyncio.BaseTransport, None] = {}

    def arrive(self, transport: asyncio.BaseTransport) -> None:
        """Take a stranger in."""
        if len(self._strangers) >= MOST_STRANGERS:
            self._refuse(next(iter(self._strangers)))
        timed = self._wait_s < math.inf
        self._strangers[transport] = (
            asyncio.get_running_loop().call_later(self._wait_s, self._refuse, transport) if timed else None
        )

    def know(self, transport: asyncio.BaseTransport) -> None:
        """Mark a connection as known, by what it has just sent."""
        self.leave(transport)
        if len(self._known) >= MOST_KNOWN:
            self._refuse(next(iter(self._known)))
        self._known[transport] = None

    def leave(self, transport: asyncio.BaseTransport) -> None:
        """Forget a connection that has ended."""
        self._known.pop(transport, None)
        if timer := self._strangers.pop(transport, None):
            timer.cancel()

    def close(self) -> None:
        """Close them all."""
        for transport in (*self._strangers, *self._known):
            self.leave(transport)
            transport.close()

    def _refuse(self, transport: asyncio.BaseTransport) -> None:
        self.leave(transport)
        self._left_out()
        transport.close()
