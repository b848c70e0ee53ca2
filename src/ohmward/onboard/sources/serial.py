"""Serial line from a microcontroller: frames of `NAME_frame.c` in an exported library, or lines of text."""

from __future__ import annotations

import errno
import math
import os
import re
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass, field
from typing import Any

from ohmward.checks import require_between
from ohmward.errors import InputError, OhmwardError
from ohmward.logs.objects_file import cells_of_line, numbers_of_line
from ohmward.onboard.line_reader import LONGEST_LINE
from ohmward.onboard.message import Handover, Message, Put, Signals, Wiring, read_in_thread
from ohmward.onboard.part import FaultyInput
from ohmward.onboard.serial_frame import MOST_VALUES, FrameClock, FrameReader, SerialFrame
from ohmward.onboard.sources.json_lines import wired_and_own
from ohmward.optional import require
from ohmward.quantities import QUANTITIES

#: What stands before the numbers of a line for Teleplot (`>V:13.2§V`), or of a log of ESP-IDF (`I (1234) bms: V=13.2`).
_BEFORE = re.compile(r"^(>|[VDIWE] \(\d+\) [^:]+: )")

#: Time between two checks of the reading thread for its end [s].
_END_READ_S = 0.1


@dataclass(frozen=True)
class SerialSource:
    """Frames of a line, or the numbers that a board prints."""

    port: str  #: serial device, or a URL of pyserial such as "socket://192.168.1.7:4000"
    #: message number -> names of its values in order; "" skips a value. Without messages the board prints lines: JSON
    #: objects, `V=13.2 I=-4.1`, `V\t13200`, or rows of numbers, which are named "1", "2", ... by their places
    messages: dict[str, tuple[str, ...]] = field(default_factory=dict)
    baud: int = 921_600  #: baud rate; USB ignores it
    #: quantity -> one of these names; other names may be quantities themselves
    signals: Signals = field(default_factory=dict)
    name: str = "serial"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("baud", self.baud, 50, 1e8)
        for number in self.messages:
            if not (number.isdecimal() and int(number) < 256):
                raise InputError(f"messages: {number!r} is not the number of a message, 0 to 255")
        names = {name for found in self.messages.values() for name in found}
        for name in self._wiring().signals:
            if self.messages and name not in names:
                raise InputError(
                    f"signals: {name!r} is no value of the messages, which have {', '.join(sorted(names))}"
                )

    def _wiring(self) -> Wiring:
        """The signals, and other values whose names are quantities."""
        names = {name for found in self.messages.values() for name in found if name}
        wired = Wiring(self.signals).signals
        own: Signals = {n: n for n in names - wired.keys() if not self.signals or n.partition(".")[0] in QUANTITIES}
        return Wiring(own | self.signals)

    async def run(self, put: Put) -> None:
        """Put the messages of the line until it fails."""
        messages = self._of_frames() if self.messages else self._of_text()
        async with self.line() as line:
            while True:
                for data, received_s in await line.take():
                    for message in messages(data, received_s):
                        put(message)

    def _of_frames(self) -> Callable[[bytes, float], Iterator[Message]]:
        """Messages from received bytes of frames, and the time of their receipt."""
        wiring, frames, clock = self._wiring(), FrameReader(), FrameClock()
        names = {int(number): found for number, found in self.messages.items()}
        faulty = FaultyInput(self.name, "frames with a wrong CRC or of another length; are baud and messages right?")
        lost = FaultyInput(self.name, "frames were lost on the line or before it")

        def messages(data: bytes, received_s: float) -> Iterator[Message]:
            for frame in frames.feed(data):
                if message := self.message(frame, names, wiring, clock, received_s):
                    yield message
                else:
                    faulty.count()
            faulty.count(frames.faulty)
            lost.count(frames.lost)
            frames.faulty = frames.lost = 0

        return messages

    def _of_text(self) -> Callable[[bytes, float], Iterator[Message]]:
        """Messages from received bytes of text, and the time of their receipt."""
        wiring, lines = Wiring(self.signals), PrintedLines()
        faulty = FaultyInput(self.name, "lines without numbers, or rows of another length; is baud right?")

        def messages(data: bytes, received_s: float) -> Iterator[Message]:
            for numbers in lines.feed(data):
                if values := wired_and_own(numbers, wiring):
                    yield Message(math.nan, received_s, self.name, values)
            faulty.count(lines.faulty)
            lines.faulty = 0

        return messages

    def message(
        self,
        frame: SerialFrame,
        names: dict[int, tuple[str, ...]],
        wiring: Wiring,
        clock: FrameClock,
        received_s: float,
    ) -> Message | None:
        """The message of a frame; None if it does not have one value for each name."""
        stamp_s = clock.stamp_s(frame.time_us)
        of_frame = names.get(frame.number, ())
        if len(of_frame) != len(frame.values):
            return None
        return Message(stamp_s, received_s, self.name, wiring.values(dict(zip(of_frame, frame.values, strict=True))))

    @asynccontextmanager
    async def line(self) -> AsyncIterator[Handover[tuple[bytes, float]]]:
        """Bytes of the line, read in a thread, with the monotonic times of their receipt."""

        def read() -> tuple[bytes, float] | None:
            data = line.read(1)
            data += line.read(line.in_waiting) if data else b""
            return (data, time.monotonic()) if data else None

        def failed(error: Exception) -> OhmwardError:
            return OhmwardError(f"{self.port} has failed ({error}); is it plugged in?")

        with closing(self._open()) as line:
            async with read_in_thread(self.port, read, failed, _END_READ_S) as received:
                yield received

    def _open(self) -> Any:
        serial = require("serial", "the serial line")
        try:
            return serial.serial_for_url(self.port, baudrate=self.baud, timeout=_END_READ_S)
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            if number == errno.EACCES:
                fix = "no permission: sudo usermod -aG dialout $USER, and log in again"
            else:
                there = [port.device for port in require("serial.tools.list_ports", "the serial line").comports()]
                fix = f"there are: {', '.join(there)}" if there else "no port is there: is it plugged in?"
            reason = os.strerror(number) if number else str(error)
            raise OhmwardError(f"{self.port} cannot be opened ({reason}); {fix}") from error


class PrintedLines:
    """Numbers of the lines that a board prints, from bytes as they come, in pieces of any size.

    The numbers of the first line are left out, which may have begun before anybody listened, and those of a row that
    is not as long as the one before it: bytes were lost.

    Attributes:
        faulty: number of lines that were left out.
        headers: number of columns -> their names, for each header that was printed.
    """

    def __init__(self) -> None:
        self.faulty = 0
        self.headers: dict[int, list[str]] = {}
        self._rest, self._width, self._first = b"", 0, True

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """Values by name of each line that these bytes complete."""
        *lines, rest = re.split(rb"[\r\n]+", self._rest + data)
        self._rest = rest[:LONGEST_LINE]
        return [found for line in lines if line.strip() and (found := self._numbers(line.decode(errors="replace")))]

    def _numbers(self, line: str) -> dict[str, Any]:
        line = _BEFORE.sub("", line).replace("§", " ")
        numbers = numbers_of_line(line)
        if not numbers and len(cells := cells_of_line(line)) <= MOST_VALUES and all(map(str.isprintable, cells)):
            self.headers[len(cells)] = [cell.strip() for cell in cells]
        was_first, self._first = self._first, False
        if was_first:
            return {}
        width = len(numbers) if "1" in numbers else self._width
        fits, self._width = self._width in (0, width), width
        if not (numbers and fits):
            self.faulty += 1
            return {}
        return numbers
