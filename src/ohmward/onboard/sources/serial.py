"""Serial line from a microcontroller: frames of `NAME_frame.c` in an exported library."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from ohmward.checks import require_between
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.message import Handover, Message, Put, Signals, Wiring, read_in_thread
from ohmward.onboard.part import FaultyInput
from ohmward.onboard.serial_frame import FrameClock, FrameReader, SerialFrame
from ohmward.optional import require
from ohmward.quantities import QUANTITIES

#: Time between two checks of the reading thread for its end [s].
_END_READ_S = 0.1


@dataclass(frozen=True)
class SerialSource:
    """Frames of a line."""

    port: str  #: serial device, or a URL of pyserial such as "socket://192.168.1.7:4000"
    #: message number -> names of its values in order; "" skips a value
    messages: dict[str, tuple[str, ...]]
    baud: int = 921_600  #: baud rate; USB ignores it
    #: quantity -> one of these names; other names may be quantities themselves
    signals: Signals = field(default_factory=dict)
    name: str = "serial"  #: in diagnostics

    def __post_init__(self) -> None:
        require_between("baud", self.baud, 50, 1e8)
        if not self.messages:
            raise InputError('messages is empty; name the values of one: messages = {1 = ["battery_current_A", "soc"]}')
        for number in self.messages:
            if not (number.isdecimal() and int(number) < 256):
                raise InputError(f"messages: {number!r} is not the number of a message, 0 to 255")
        names = {name for found in self.messages.values() for name in found}
        for name in self._wiring().signals:
            if name not in names:
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
        wiring, frames, clock = self._wiring(), FrameReader(), FrameClock()
        names = {int(number): found for number, found in self.messages.items()}
        faulty = FaultyInput(self.name, "frames with a wrong CRC or of another length; are baud and messages right?")
        lost = FaultyInput(self.name, "frames were lost on the line or before it")
        async with self.line() as line:
            while True:
                for data, received_s in await line.take():
                    for frame in frames.feed(data):
                        if message := self.message(frame, names, wiring, clock, received_s):
                            put(message)
                        else:
                            faulty.count()
                    faulty.count(frames.faulty)
                    lost.count(frames.lost)
                    frames.faulty = frames.lost = 0

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
        line = self._open()

        def read() -> tuple[bytes, float] | None:
            data = line.read(1)
            data += line.read(line.in_waiting) if data else b""
            return (data, time.monotonic()) if data else None

        def failed(error: Exception) -> OhmwardError:
            return OhmwardError(f"{self.port} has failed ({error}); is it plugged in?")

        try:
            async with read_in_thread(self.port, read, failed, _END_READ_S) as received:
                yield received
        finally:
            line.close()

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
