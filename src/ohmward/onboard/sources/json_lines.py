"""JSON lines on standard input or a socket: one object a line, `{"time_s": 1.5, "battery_current_A": -3.2}`."""

from __future__ import annotations

import asyncio
import json
import math
import sys
import time
from dataclasses import dataclass, field

from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.message import Message, Put, Signals, Wiring, as_number
from ohmward.onboard.part import EndedError
from ohmward.onboard.quantities import QUANTITIES, quantity_of

#: Longest line that is read [bytes]; a longer one is left out.
LONGEST_LINE = 1 << 16


@dataclass(frozen=True)
class JsonLinesSource:
    """Objects by lines.

    Attributes:
        address: "-" for standard input, else HOST:PORT or the path of a Unix socket to connect to.
        time: key of the time stamp [s]; without it the time is that of the receipt.
        signals: quantity -> key; without any, keys are quantities themselves, arrays one for each wheel or cell.
        name: in diagnostics.
    """

    address: str = "-"
    time: str = "time_s"
    signals: Signals = field(default_factory=dict)
    name: str = "json-lines"

    def __post_init__(self) -> None:
        Wiring(self.signals)
        host, colon, port = self.address.rpartition(":")
        if colon and "/" not in self.address and not (host and port.isdigit() and 0 < int(port) < 65536):
            raise InputError(f"address must be -, HOST:PORT or the path of a socket, got {self.address!r}")

    async def run(self, put: Put) -> None:
        """Read lines until the other side ends."""
        reader = await self._reader()
        wiring = Wiring(self.signals)
        while line := await _line(reader):
            if message := self.message(line, wiring, time.monotonic()):
                put(message)
        if self.address == "-":
            raise EndedError("standard input has ended")
        raise OhmwardError(f"{self.address} has closed the connection; is its process running?")

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

    async def _reader(self) -> asyncio.StreamReader:
        if self.address == "-":
            reader = asyncio.StreamReader(limit=LONGEST_LINE)
            protocol = asyncio.StreamReaderProtocol(reader)
            await asyncio.get_running_loop().connect_read_pipe(lambda: protocol, sys.stdin)
            return reader
        host, colon, port = self.address.rpartition(":")
        try:
            if colon and "/" not in self.address:
                return (await asyncio.open_connection(host, int(port), limit=LONGEST_LINE))[0]
            return (await asyncio.open_unix_connection(self.address, limit=LONGEST_LINE))[0]
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


def _is_signal(signal: str) -> bool:
    try:
        quantity_of(signal)
    except InputError:
        return False
    return True


async def _line(reader: asyncio.StreamReader) -> bytes:
    """The next line, empty at the end; of one that is too long the rest up to its end is left out."""
    try:
        return await reader.readuntil(b"\n")
    except asyncio.IncompleteReadError as end:
        return end.partial
    except asyncio.LimitOverrunError as long:
        await reader.readexactly(long.consumed)
        await _line(reader)
        return b"\n"
