"""CAN: buses through python-can, with a fix in every error, and signals in frames of the user's database.

A database is a DBC or another file that cantools reads; it turns frames into quantities, and numbers into frames.
"""

from __future__ import annotations

import difflib
import math
import time
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.can_file import load_can_database
from ohmward.logs.units import unit_of
from ohmward.onboard.message import Handover, ScaledSignal, Wiring, read_in_thread, signal_line
from ohmward.optional import require
from ohmward.quantities import quantity_of

#: Error class "bus off" in the identifier of an error frame, linux/can/error.h: the controller has left the bus.
_BUS_OFF = 0x40

#: Time without accepting a frame after which a bus has failed [s].
_SEND_S = 0.02

#: Filter that passes only an identifier that nobody may use, for buses that are only written to.
NO_FRAMES = [{"can_id": 0x1FFFFFFF, "can_mask": 0x1FFFFFFF, "extended": True}]

#: Time between two checks of the reading thread for its end [s].
_RECEIVE_S = 0.2


def require_wiring(dbc: str, signals: Mapping[str, object], example: str) -> None:
    """Raise InputError for settings without a database or a signal; example: of a signal."""
    if not dbc:
        raise InputError('dbc is missing; name the database of the bus: dbc = "robot.dbc"')
    if not signals:
        raise InputError(f"signals is empty; name some: signals = {{{example}}}")


@dataclass(frozen=True)
class CanPort:
    """A bus as python-can names it."""

    interface: str = "socketcan"  #: kind of adapter: "socketcan", "slcan", "pcan", "virtual" or another of python-can
    channel: str = "can0"  #: name of the bus
    bitrate: int | None = None  #: bit rate of the adapter; for socketcan `ip link` sets it
    fd: bool = False  #: also CAN FD frames

    def open(self, filters: list[dict[str, Any]] | None = None) -> Any:
        """Open the bus.

        Raises:
            OhmwardError: it cannot be opened; the message says what to do.
            MissingPackageError: python-can is not installed.
        """
        can = require("can", "the CAN bus")

        given: dict[str, Any] = {} if self.bitrate is None else {"bitrate": self.bitrate}
        given |= {"fd": True} if self.fd else {}
        if self.interface == "socketcan":  # in the kernel; python-can's own would keep error frames back
            given |= {"can_filters": filters}
        try:
            return can.Bus(interface=self.interface, channel=self.channel, **given)
        except PermissionError as error:
            raise OhmwardError(
                f"no permission for {self.interface} {self.channel}; add the user to the device's group (dialout)"
            ) from error
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            fix = "is the adapter plugged in, and do interface and channel name it?"
            if self.interface == "socketcan":
                bitrate = self.bitrate or 500_000
                fix = f"bring it up: ip link set {self.channel} up type can bitrate {bitrate} restart-ms 100"
            raise OhmwardError(f"{self.interface} {self.channel} cannot be opened ({error}); {fix}") from error

    def send(self, bus: Any, frames: Iterable[tuple[int, bool, bytes]]) -> None:
        """Send frames: identifier, extended or not, data.

        Raises:
            OhmwardError: the bus does not take them.
        """
        message = require("can", "the CAN bus").Message
        for identifier, extended, data in frames:
            try:
                bus.send(message(0.0, identifier, extended, data=data, is_fd=self.fd), timeout=_SEND_S)
            except Exception as error:  # drivers raise all kinds of errors
                raise self.failed(error) from error

    def failed(self, error: Exception) -> OhmwardError:
        """The error of a bus that was open."""
        return OhmwardError(f"{self.channel} has failed ({error}); is the adapter plugged in and the link up?")


@asynccontextmanager
async def frames_of(
    port: CanPort, filters: list[dict[str, Any]] | None = None
) -> AsyncIterator[Handover[tuple[Any, float]]]:
    """Frames of a bus, messages of python-can, with the monotonic times of their receipt.

    They are read in a thread; reading fails if the bus fails or goes off.
    """

    def read() -> tuple[Any, float] | None:
        message = bus.recv(_RECEIVE_S)
        if message is None or message.is_remote_frame:
            return None
        if message.is_error_frame:
            if message.arbitration_id & _BUS_OFF:
                raise OhmwardError(
                    f"{port.channel} is bus-off: check wiring, the two 120 ohm terminators and the bitrate; "
                    f"ip link set {port.channel} type can restart-ms 100 lets it come back by itself"
                )
            return None
        return message, time.monotonic()

    with port.open(filters) as bus:
        async with read_in_thread(port.channel, read, port.failed, _RECEIVE_S) as frames:
            yield frames


class CanDatabase:
    """Messages and signals of a file, looked up as "MESSAGE.SIGNAL".

    Args:
        path: of a DBC, KCD, SYM or ARXML file.

    Raises:
        InputError: it cannot be read, or describes no messages.
        MissingPackageError: cantools is not installed.
    """

    def __init__(self, path: str):
        self.path = path
        self._frames = {frame.name: frame for frame in load_can_database(path).messages}
        self._by_identifier = {(frame.frame_id, frame.is_extended_frame): frame for frame in self._frames.values()}

    @property
    def signals(self) -> dict[str, Any]:
        """All signals of cantools by "MESSAGE.SIGNAL"."""
        return {f"{frame.name}.{found.name}": found for frame in self._frames.values() for found in frame.signals}

    def decoded(self, frame_id: int, extended: bool, data: bytes) -> dict[str, float] | None:
        """Numbers of a frame by "MESSAGE.SIGNAL"; empty for one that is not in the file, None for a broken one."""
        if (frame := self._by_identifier.get((frame_id, extended))) is None:
            return {}
        try:
            numbers = frame.decode_simple(data, decode_choices=False)
        except Exception:  # too short, an unknown multiplexer, a container: bits can be anything
            return None
        return {f"{frame.name}.{name}": number for name, number in numbers.items()}

    def find(self, name: str) -> tuple[Any, Any]:
        """The message and the signal of cantools of a name.

        Raises:
            InputError: there is none; the message names the nearest.
        """
        message, _, signal = name.partition(".")
        if frame := self._frames.get(message):
            for found in frame.signals:
                if found.name == signal:
                    return frame, found
        near = difflib.get_close_matches(name, self.signals, n=3, cutoff=0.0)
        raise InputError(
            f"{name!r} is not in {Path(self.path).name}; write MESSAGE.SIGNAL, such as {', '.join(near) or 'none'}"
        )


class CanDecoder:
    """Conversion of a bus's frames to quantities.

    Args:
        database: of the signals.
        wiring: quantities by "MESSAGE.SIGNAL".

    Raises:
        InputError: a signal that the database does not have, or one in another unit than its quantity.
    """

    def __init__(self, database: CanDatabase, wiring: Wiring):
        self._database, self._wiring = database, wiring
        self._frames: set[tuple[int, bool]] = set()
        scaled: dict[str, str] = {}
        for name, uses in wiring.signals.items():
            frame, signal = database.find(name)
            for quantity, scale, _ in uses:
                if line := _line_with_scale(name, quantity, scale, signal.unit):
                    scaled[f"{name} is in {signal.unit}"] = line
            self._frames.add((frame.frame_id, frame.is_extended_frame))
        if scaled:
            raise InputError(f"{', '.join(scaled)}; write below signals\n" + "\n".join(scaled.values()))

    @property
    def filters(self) -> list[dict[str, Any]]:
        """Filters of the frames that matter, as python-can takes them."""
        return _filters(self._frames)

    def values(self, frame_id: int, extended: bool, data: bytes) -> dict[str, float] | None:
        """Quantities of a frame; empty for one that is not wired, None for one that cannot be decoded."""
        if (frame_id, extended) not in self._frames:
            return {}
        numbers = self._database.decoded(frame_id, extended, data)
        return None if numbers is None else self._wiring.values(numbers)


class CanEncoder:
    """Conversion of numbers to frames.

    Args:
        database: of the signals.
        signals: name of a number -> "MESSAGE.SIGNAL", or that with scale and offset: number = scale * signal + offset.

    Raises:
        InputError: a signal that the database does not have.
    """

    def __init__(self, database: CanDatabase, signals: Mapping[str, str | ScaledSignal]):
        self._frames: dict[str, tuple[Any, list[tuple[str, Any, ScaledSignal]]]] = {}
        for name, given in signals.items():
            scaled = given if isinstance(given, ScaledSignal) else ScaledSignal(given)
            frame, signal = database.find(scaled.name)
            self._frames.setdefault(frame.name, (frame, []))[1].append((name, signal, scaled))

    @property
    def identifiers(self) -> dict[tuple[int, bool], str]:
        """Identifier, extended or not, of every frame, and its name."""
        return {(frame.frame_id, frame.is_extended_frame): name for name, (frame, _) in self._frames.items()}

    @property
    def filters(self) -> list[dict[str, Any]]:
        """Filters of its own frames, as python-can takes them."""
        return _filters(self.identifiers)

    def frames(self, numbers: Mapping[str, float]) -> list[tuple[int, bool, bytes]]:
        """Identifier, extended or not, and data of every frame whose numbers are all known; signals saturate.

        Other signals of these messages have their initial value, or 0.
        """
        frames = []
        for frame, uses in self._frames.values():
            found = {name: numbers.get(name, math.nan) for name, _, _ in uses}
            if not all(map(math.isfinite, found.values())):
                continue
            data: dict[str, float] = {signal.name: signal.initial or 0 for signal in frame.signals}
            for name, signal, scaled in uses:
                data[signal.name] = _saturated(signal, (found[name] - scaled.offset) / scaled.scale)
            frames.append((frame.frame_id, frame.is_extended_frame, frame.encode(data, strict=False)))
        return frames


def _filters(identifiers: Iterable[tuple[int, bool]]) -> list[dict[str, Any]]:
    return [
        {"can_id": number, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
        for number, extended in identifiers
    ]


def _saturated(signal: Any, value: float) -> float:
    """The nearest value that the bits of a signal and its limits can hold."""
    if signal.is_float:
        return value
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    high = low + (1 << signal.length) - 1
    least, most = sorted((low * signal.scale + signal.offset, high * signal.scale + signal.offset))
    if signal.minimum is not None and signal.maximum is not None and signal.minimum < signal.maximum:
        least, most = max(least, signal.minimum), min(most, signal.maximum)
    return min(max(value, least), most)


def _line_with_scale(name: str, quantity: str, scale: float, unit: str | None) -> str:
    """Line of a setup with the scale from the database's unit to the quantity's; "" if none is needed."""
    own, found = unit_of(quantity_of(quantity).unit), unit_of(unit or "")
    if scale != 1.0 or own is None or found is None or found.dimension != own.dimension:
        return ""
    wired = ScaledSignal(name, found.scale / own.scale, found.offset)
    return "" if wired == ScaledSignal(name) else signal_line(quantity, wired)
