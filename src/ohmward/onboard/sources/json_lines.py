"""JSON lines on standard input or a socket: one object a line, `{"time_s": 1.5, "battery_current_A": -3.2}`.

Whoever connects to a socket stamps with a clock of its own, so each connection has one; a sender that connects again
has the same.
"""

from __future__ import annotations

import asyncio
import difflib
import itertools
import math
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TextIO

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.line_reader import BACKLOG, LONGEST_LINE, LineReader, Visitors, cannot_listen
from ohmward.onboard.message import Message, Put, Signals, Wiring, as_number, json_value
from ohmward.onboard.part import LOG, EndedError, FaultyInput
from ohmward.onboard.secrets import host_and_port
from ohmward.quantities import QUANTITIES, quantity_of

#: Similarity of a key to the name of a quantity, from 0 to 1, above which it counts as misspelt.
_NEARLY = 0.8

#: Unknown keys that are looked at: a robot has fewer, a sender that invents names must not fill the log.
_UNKNOWN_KEYS = 100


@dataclass(frozen=True)
class JsonLinesSource:
    """JSON objects, one a line."""

    address: str = "-"  #: "-" for standard input, else HOST:PORT or the path of a Unix socket
    time: str = "time_s"  #: key of the time stamp [s]; without one the time of receipt is used
    #: quantity -> key; other keys may be quantities themselves, arrays with a value per wheel or cell
    signals: Signals = field(default_factory=dict)
    #: wait for a connection at the address instead of connecting to it. Anyone who reaches the address can send: use
    #: 127.0.0.1, a Unix socket or the robot's own network
    listen: bool = False
    name: str = "json-lines"  #: in diagnostics

    def __post_init__(self) -> None:
        Wiring(self.signals)
        self._host_and_port()
        if self.listen and self.address == "-":
            raise InputError('listen needs an address: address = "127.0.0.1:4710", or the path of a socket')

    async def run(self, put: Put) -> None:
        """Read lines until the other side ends."""
        faulty = FaultyInput(self.name, "lines are no JSON object with a quantity")
        wiring = Wiring(self.signals)

        def take(line: bytes, publisher: str = "") -> bool:
            if message := self.message(line, wiring, time.monotonic(), publisher):
                put(message)
            else:
                faulty.count(example=line.strip())
            return message is not None

        if self.listen:
            await self._serve(take, faulty)
        elif self.address == "-" and is_at_once(sys.stdin):
            # a file, which no event loop can wait for
            while line := await asyncio.to_thread(sys.stdin.buffer.readline, LONGEST_LINE):
                take(line)
        else:
            await self._read(take, faulty)
        if self.address == "-":
            raise EndedError("standard input has ended")
        raise OhmwardError(f"{self.address} has closed the connection; is its process running?")

    async def _read(self, take: Callable[[bytes], object], faulty: FaultyInput) -> None:
        """Take the lines of the address until it ends."""
        ended: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

        def end(error: Exception | None) -> None:
            if not ended.done():
                ended.set_result(error)

        with closing(await self._connect(lambda: LineReader(take, faulty.count, end))):
            if error := await ended:
                raise error

    async def _serve(self, take: Callable[[bytes, str], bool], faulty: FaultyInput) -> None:
        """Listen, and read from whoever connects."""
        left_out = FaultyInput(self.name, "connections were closed: too many at once, those without a message first")
        visitors = Visitors(left_out.count)
        publishers: dict[asyncio.BaseTransport, str] = {}

        def begin(transport: asyncio.BaseTransport) -> None:
            publishers[transport] = _publisher(transport, publishers.values())
            visitors.arrive(transport)

        def reader() -> LineReader:
            def end(error: Exception | None) -> None:
                if found.transport:
                    visitors.leave(found.transport)
                    del publishers[found.transport]
                if error:
                    LOG.info("source %s: a connection was lost (%s)", self.name, error)

            def take_known(line: bytes) -> None:
                if found.transport and take(line, publishers[found.transport]):
                    visitors.know(found.transport)

            found = LineReader(take_known, faulty.count, end, begin)
            return found

        with closing(visitors):
            async with await self._server(reader) as server:
                await server.serve_forever()

    async def _server(self, reader: Callable[[], LineReader]) -> asyncio.Server:
        loop, (host, port) = asyncio.get_running_loop(), self._host_and_port()
        try:
            if port:
                return await loop.create_server(reader, host, port, backlog=BACKLOG)
            if (left_behind := Path(self.address)).is_socket():  # by an earlier process
                left_behind.unlink()
            return await loop.create_unix_server(reader, self.address, backlog=BACKLOG)
        except OSError as error:
            raise cannot_listen(self.address, error) from error

    def message(self, line: bytes, wiring: Wiring, received_s: float, publisher: str = "") -> Message | None:
        """The message of a line of a publisher; None if it is no JSON object or has no quantity."""
        found = json_value(line)
        if not isinstance(found, dict):
            return None
        values = wired_and_own(found, wiring)
        stamp_s = as_number(found.get(self.time, math.nan))
        return Message(stamp_s, received_s, self.name, values, publisher) if values else None

    def _host_and_port(self) -> tuple[str, int]:
        """Host and port of the address; the port is 0 for the path of a socket, or standard input."""
        is_path = "/" in self.address or ":" not in self.address
        return ("", 0) if is_path else host_and_port("address", self.address)

    async def _connect(self, reader: Callable[[], LineReader]) -> asyncio.BaseTransport:
        loop, (host, port) = asyncio.get_running_loop(), self._host_and_port()
        if self.address == "-":
            return (await loop.connect_read_pipe(reader, sys.stdin))[0]
        try:
            if port:
                return (await loop.create_connection(reader, host, port))[0]
            return (await loop.create_unix_connection(reader, self.address))[0]
        except OSError as error:
            raise OhmwardError(
                f"no connection to {self.address} ({error.strerror or error}); is it listening? "
                "If it connects to this process instead: listen = true"
            ) from error


def wired_and_own(found: Mapping[str, object], wiring: Wiring) -> dict[str, float]:
    """Values by signal, for keys that are wired, and for others that are quantities."""
    own = {key: value for key, value in found.items() if key not in wiring.signals}
    return own_names(own) | wiring.values(found)


def own_names(found: dict[str, object]) -> dict[str, float]:
    """Values by signal, for keys that are quantities; an array has one value for each wheel, motor or cell."""
    values: dict[str, float] = {}
    for key, value in found.items():
        if isinstance(value, list):
            if key in QUANTITIES:
                for k, number in enumerate(value):
                    if signal := _signal(key, k):
                        values[signal] = as_number(number)
        elif (isinstance(value, bool | int | float) or value is None) and (signal := _signal(key)):
            values[signal] = as_number(value)
    return values


def _publisher(transport: asyncio.BaseTransport, others: Collection[str]) -> str:
    """Name of the publisher behind a connection: its host and the lowest number that no open connection has."""
    peer = transport.get_extra_info("peername")
    host = peer[0] if isinstance(peer, tuple) else ""
    return next(name for number in itertools.count() if (name := f"{host} {number}") not in others)


@lru_cache(maxsize=1024)
def _name_misspelt(name: str) -> None:
    """Log once a key that is nearly the name of a quantity, among the first `_UNKNOWN_KEYS` that are none.

    name: the key, with # for every number: a pack has a key for each cell.
    """
    if _name_misspelt.cache_info().misses > _UNKNOWN_KEYS:
        return
    if near := difflib.get_close_matches(name, QUANTITIES, n=1, cutoff=_NEARLY):
        LOG.warning(
            "the key %r is no quantity and left out; did you mean %s? Units are part of the names", name, near[0]
        )


@lru_cache(maxsize=1024)
def _signal(key: str, number: int | None = None) -> str:
    """The signal of a key, with the number of a wheel, motor or cell; "" if there is no such signal."""
    if key.partition(".")[0] not in QUANTITIES:
        _name_misspelt(re.sub(r"\d+", "#", key.partition(".")[0]))
        return ""
    signal = key if number is None else f"{key}.{number}"
    try:
        quantity_of(signal)
    except InputError:
        return ""
    return signal


def is_at_once(stream: TextIO) -> bool:
    """True for a file on disk and /dev/null, read without waiting; false for a pipe, socket or terminal."""
    try:
        mode = os.fstat(stream.fileno()).st_mode
        return stat.S_ISREG(mode) or (stat.S_ISCHR(mode) and not stream.isatty())
    except (OSError, ValueError):
        return False
