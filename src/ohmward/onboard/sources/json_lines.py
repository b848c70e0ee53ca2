"""JSON lines on standard input or a socket: one object a line, `{"time_s": 1.5, "battery_current_A": -3.2}`."""

from __future__ import annotations

import asyncio
import json
import math
import os
import stat
import sys
import time
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TextIO

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.faulty import FaultyInput
from ohmward.onboard.message import Message, Put, Signals, Wiring, as_number
from ohmward.onboard.part import LOG, EndedError
from ohmward.onboard.quantities import QUANTITIES, quantity_of

#: Longest line that is read [bytes]; a longer one is left out.
LONGEST_LINE = 1 << 16

#: Lines of a burst that are read before others have their turn: some milliseconds.
AT_ONCE = 16


@dataclass(frozen=True)
class JsonLinesSource:
    """Objects by lines.

    Attributes:
        address: "-" for standard input, else HOST:PORT or the path of a Unix socket.
        listen: wait at the address for whoever connects, instead of connecting to it. Whoever reaches the address can
            send: listen at 127.0.0.1, at a socket, or in a network that is the robot's own.
        time: key of the time stamp [s]; without it the time is that of the receipt.
        signals: quantity -> key; without any, keys are quantities themselves, arrays one for each wheel or cell.
        name: in diagnostics.
    """

    address: str = "-"
    time: str = "time_s"
    signals: Signals = field(default_factory=dict)
    listen: bool = False
    name: str = "json-lines"

    def __post_init__(self) -> None:
        Wiring(self.signals)
        if ":" in self.address and "/" not in self.address and not self._host_and_port()[1]:
            raise InputError(f"address must be -, HOST:PORT or the path of a socket, got {self.address!r}")
        if self.listen and self.address == "-":
            raise InputError('listen needs an address: address = "127.0.0.1:4710", or the path of a socket')

    async def run(self, put: Put) -> None:
        """Read lines until the other side ends."""
        faulty = FaultyInput(self.name, "lines are no JSON object with a quantity")
        if self.listen:
            await self._serve(put, faulty)
        if self.address == "-" and is_file(sys.stdin):
            await self._read_file(put, faulty)
        reader, writer = await self._streams()
        try:
            await self._read(reader, put, faulty)
        finally:
            if writer:
                writer.close()
        if self.address == "-":
            raise EndedError("standard input has ended")
        raise OhmwardError(f"{self.address} has closed the connection; is its process running?")

    async def _read(self, reader: asyncio.StreamReader, put: Put, faulty: FaultyInput) -> None:
        """Put the lines of one stream until it ends; of a line that is too long all is left out."""
        wiring, rest, skipping = Wiring(self.signals), b"", False
        while data := await reader.read(LONGEST_LINE):
            *lines, rest = (rest + data).split(b"\n")
            await self._put_lines(lines[1:] if skipping else lines, wiring, put, faulty)
            skipping = skipping and not lines
            if len(rest) > LONGEST_LINE:
                faulty.count()
                rest, skipping = b"", True
        await self._put_lines([rest] if rest and not skipping else [], wiring, put, faulty)

    async def _put_lines(self, lines: list[bytes], wiring: Wiring, put: Put, faulty: FaultyInput) -> None:
        for k, line in enumerate(lines, 1):
            if message := self.message(line, wiring, time.monotonic()):
                put(message)
            else:
                faulty.count()
            if k % AT_ONCE == 0:
                await asyncio.sleep(0)

    async def _read_file(self, put: Put, faulty: FaultyInput) -> None:
        """Put the lines of standard input where it is a file, which no event loop waits for."""
        wiring = Wiring(self.signals)
        while line := await asyncio.to_thread(sys.stdin.buffer.readline, LONGEST_LINE):
            if message := self.message(line, wiring, time.monotonic()):
                put(message)
            else:
                faulty.count()
        raise EndedError("standard input has ended")

    async def _serve(self, put: Put, faulty: FaultyInput) -> None:
        """Listen, and read from whoever connects, any number at once."""

        async def read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            try:
                await self._read(reader, put, faulty)
            except OSError as error:
                LOG.info("source %s: a connection was lost (%s)", self.name, error)
            finally:
                writer.close()

        host, port = self._host_and_port()
        try:
            if port:
                server = await asyncio.start_server(read, host, port, limit=LONGEST_LINE)
            else:
                await asyncio.to_thread(_remove_socket, self.address)
                server = await asyncio.start_unix_server(read, self.address, limit=LONGEST_LINE)
        except OSError as error:
            raise OhmwardError(
                f"{self.address} cannot be listened at ({error.strerror}); choose another port"
            ) from error
        async with server:
            await server.serve_forever()

    def message(self, line: bytes, wiring: Wiring, received_s: float) -> Message | None:
        """The message of a line; None where it is no JSON object or has no quantity."""
        try:
            found = json.loads(line)
        except (ValueError, RecursionError):
            return None
        if not isinstance(found, dict):
            return None
        values = wiring.values(found) if self.signals else own_names(found)
        stamp_s = as_number(found.get(self.time, math.nan))
        return Message(stamp_s, received_s, self.name, values) if values else None

    def _host_and_port(self) -> tuple[str, int]:
        """Host and port of the address; the port is 0 where it is none."""
        host, _, port = self.address.rpartition(":")
        number = int(port) if host and port.isdecimal() and len(port) < 6 and "/" not in self.address else 0
        return host, number if number < 65536 else 0

    async def _streams(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter | None]:
        """The reader, and the writer of a socket, which closes it when it is let go."""
        if self.address == "-":
            reader = asyncio.StreamReader(limit=LONGEST_LINE)
            protocol = asyncio.StreamReaderProtocol(reader)
            await asyncio.get_running_loop().connect_read_pipe(lambda: protocol, sys.stdin)
            return reader, None
        host, port = self._host_and_port()
        try:
            if port:
                return await asyncio.open_connection(host, port, limit=LONGEST_LINE)
            return await asyncio.open_unix_connection(self.address, limit=LONGEST_LINE)
        except OSError as error:
            raise OhmwardError(
                f"no connection to {self.address} ({error.strerror or error}); is it listening?"
            ) from error


def own_names(found: dict[str, object]) -> dict[str, float]:
    """Values by signal where the keys are those of quantities; of an array one value for each wheel, motor or cell."""
    values: dict[str, float] = {}
    for key, value in found.items():
        if key.partition(".")[0] not in QUANTITIES:
            continue
        if isinstance(value, list) and "." not in key:
            values |= {f"{key}.{k}": as_number(number) for k, number in enumerate(value)}
        elif isinstance(value, bool | int | float) or value is None:
            values[key] = as_number(value)
    return {signal: value for signal, value in values.items() if _is_signal(signal)}


@lru_cache(maxsize=1024)
def _is_signal(signal: str) -> bool:
    try:
        quantity_of(signal)
    except InputError:
        return False
    return True


def is_file(stream: TextIO) -> bool:
    """True where a stream is a file on disk and not a pipe or a terminal."""
    try:
        return stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
    except (OSError, ValueError):
        return False


def _remove_socket(path: str) -> None:
    """Remove the socket that a process of before has left, and nothing else."""
    found = Path(path)
    if found.is_socket():
        found.unlink()
