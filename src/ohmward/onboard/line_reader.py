"""Lines of a connection, as they come: a protocol of asyncio, which wakes the process half as often as a stream."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

#: Longest line that is read [bytes]; a longer one is left out.
LONGEST_LINE = 1 << 16

#: Lines of a burst that are read before others have their turn: some milliseconds.
AT_ONCE = 16


class LineReader(asyncio.Protocol):
    """Lines of one connection, one after the other.

    Args:
        take: takes a line without its end; never raises.
        left_out: is called for a line that is too long.
        end: is called once, after the last line, with the error that ended the connection, if one did.
    """

    def __init__(
        self, take: Callable[[bytes], None], left_out: Callable[[], None], end: Callable[[Exception | None], None]
    ):
        self._take, self._left_out, self._end = take, left_out, end
        self._waiting: deque[bytes] = deque()
        self._rest, self._skipping = b"", False
        self._busy, self._closed = False, False
        self._error: Exception | None = None
        self.transport: asyncio.ReadTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        assert isinstance(transport, asyncio.ReadTransport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Take in what has come; of a line that is too long all is left out."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines and self._skipping:
            del lines[0]
            self._skipping = False
        if len(self._rest) > LONGEST_LINE:
            if not self._skipping:
                self._left_out()
            self._rest, self._skipping = b"", True
        self._waiting.extend(lines)
        if not self._busy:
            self._take_some()

    def connection_lost(self, error: Exception | None) -> None:
        """Take what is left, and end."""
        self._closed, self._error = True, error
        if not self._busy:
            self._take_some()

    def _take_some(self) -> None:
        """Take a few lines; while some are left, nothing more is read."""
        for _ in range(min(AT_ONCE, len(self._waiting))):
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
