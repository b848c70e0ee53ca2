"""Messages of sources, their signals, and the queue from a driver's thread to the event loop.

Signals belong to the battery or the drive, or are estimates of a microcontroller; a quantity of the table that no
estimator uses accompanies the next sample of the battery or drive. A source repeats a few kinds of messages, so each
kind, identified by the names of its signals, is sorted only once.
"""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from ohmward.checks import require_finite
from ohmward.errors import InputError, OhmwardError
from ohmward.quantities import BODY, GROUPS, QUANTITIES, Quantity, quantity_of
from ohmward.traction.inbox import WHEELS
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.robot import Robot


class Message(NamedTuple):
    """Values that a source measured at one time."""

    stamp_s: float  #: time of the measurement on the source's own clock; nan where it has none
    received_s: float  #: monotonic time of its receipt
    source: str  #: name of the source
    #: signal -> value in the unit of its name; nan and signals that are left out were not measured
    values: Mapping[str, float]
    publisher: str = ""  #: publisher whose clock gave the stamp, if the source hears several
    #: date of the measurement, seconds since 1970, by the robot's own calendar, from ROS or a log; nan if the wall
    #: clock of this machine applies
    date_s: float = math.nan
    #: its time of receipt sets the time of a simulation, which stands still until the next such message
    sets_time: bool = False


#: Takes a message in; returns at once and never raises. The queue behind it is bounded.
Put = Callable[[Message], None]


@dataclass(frozen=True)
class ScaledSignal:
    """A number of a source that becomes a quantity: value = scale * number + offset."""

    name: str  #: as the source calls it: "BMS.Current" of a DBC, "/battery/current" of a topic, "I" of a JSON object
    #: conversion to the unit of the quantity
    scale: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        require_finite("scale", self.scale)
        require_finite("offset", self.offset)
        if self.scale == 0.0:
            raise InputError("scale must not be 0: leave the signal out where it is not measured")


def signal_line(quantity: str, signal: ScaledSignal) -> str:
    """Line of a setup, below `signals`, that wires a quantity."""
    scale = f", scale = {signal.scale:.8g}" if signal.scale != 1.0 else ""
    offset = f", offset = {signal.offset:.8g}" if signal.offset else ""
    name = json.dumps(signal.name, ensure_ascii=False)  # TOML quotes a text as JSON does
    given = f"{{name = {name}{scale}{offset}}}" if scale or offset else name
    return f'"{quantity}" = {given}'


#: Signals of a source in its settings: quantity -> name, or name with scale and offset.
Signals = dict[str, str | ScaledSignal]


#: Between the names of numbers that are added.
PLUS = " + "


class Wiring:
    """The signals of a source, looked up by the names that the source gives them.

    A signal whose name is "A + B" is the sum of these numbers, as of the currents of batteries in parallel: it is
    measured whenever each of them has come again.

    Args:
        signals: as in the settings of the source.

    Raises:
        InputError: unknown quantity.
    """

    def __init__(self, signals: Signals):
        self.signals: dict[str, list[tuple[str, float, float]]] = {}
        self.sums: dict[str, dict[str, float]] = {}  #: quantity that is a sum -> its numbers, inf before they come
        for quantity, given in signals.items():
            quantity_of(quantity)
            signal = given if isinstance(given, ScaledSignal) else ScaledSignal(given)
            parts = signal.name.split(PLUS)
            for name in parts:
                self.signals.setdefault(name, []).append((quantity, signal.scale, signal.offset / len(parts)))
            if len(parts) > 1:
                self.sums[quantity] = dict.fromkeys(parts, math.inf)

    def values(self, numbers: Mapping[str, object]) -> dict[str, float]:
        """Quantities from a source's numbers by its own names; nan for what is no number, unknown names left out."""
        found: dict[str, float] = {}
        for name, number in numbers.items():
            for quantity, scale, offset in self.signals.get(name, ()):
                found[quantity] = scale * as_number(number) + offset
                if parts := self.sums.get(quantity):
                    parts[name] = found.pop(quantity)
                    if math.inf not in parts.values():
                        found[quantity] = sum(parts.values())
                        parts.update(dict.fromkeys(parts, math.inf))
        return found


def json_value(text: bytes) -> object:
    """Parsed value of a JSON text; None if the text is invalid."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def as_number(value: object) -> float:
    """The value as a float; nan if it is not a number."""
    if type(value) is float:
        return value
    if isinstance(value, bool | int | float):
        try:
            return float(value)
        except OverflowError:
            return math.nan
    return math.nan


T = TypeVar("T")

#: Largest number of waiting items, the oldest are dropped: 2 s of a full CAN bus at 1 Mbit/s.
_LONGEST = 20_000


class Handover(Generic[T]):
    """Queue made in the event loop; `put` and `fail` may be called from any thread, `take` from the loop.

    Attributes:
        lost: number of items dropped because too many were waiting.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[T] = deque(maxlen=_LONGEST)
        self._something = asyncio.Event()
        self._error: Exception | None = None
        self.lost = 0

    def put(self, item: T) -> None:
        """Hand an item over."""
        self.lost += len(self._waiting) == _LONGEST
        self._waiting.append(item)
        self._wake()

    def fail(self, error: Exception) -> None:
        """Let `take` raise the error once everything before it is taken; only the first error counts."""
        self._error = self._error or error
        self._wake()

    async def take(self) -> list[T]:
        """All waiting items, at least one."""
        while not self._waiting:
            if self._error:
                raise self._error
            self._something.clear()
            if not self._waiting and not self._error:
                await self._something.wait()
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def _wake(self) -> None:
        if not self._something.is_set() and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._something.set)


@asynccontextmanager
async def read_in_thread(
    name: str, read: Callable[[], T | None], failed: Callable[[Exception], OhmwardError], wait_s: float
) -> AsyncIterator[Handover[T]]:
    """Items returned by `read`, which a thread calls repeatedly until the end.

    name: name of what is read.
    read: waits at most `wait_s` for an item; returns None if none has come.
    failed: turns an error of `read`, unless it is an OhmwardError, into the one that `take` raises; reading then stops.
    """
    handover, end = Handover[T](), threading.Event()

    def work() -> None:
        while not end.is_set():
            try:
                item = read()
            except Exception as error:  # drivers raise all kinds of errors
                handover.fail(error if isinstance(error, OhmwardError) else failed(error))
                return
            if item is not None:
                handover.put(item)

    thread = threading.Thread(target=work, name=f"read {name}", daemon=True)
    thread.start()
    try:
        yield handover
    finally:
        end.set()
        await asyncio.to_thread(thread.join, 2 * wait_s)


#: Number of message kinds remembered; a robot has a dozen, and a sender of random names must not fill the memory.
MOST_KINDS = 256


class MessageParts(NamedTuple):
    """Signals of one kind of message."""

    battery: bool  #: True if any signal is of the battery
    #: argument of `SensorInbox.put`, and the signal of each wheel or motor, "" where there is none
    wheels: tuple[tuple[str, tuple[str, ...]], ...]
    body: tuple[str, ...]  #: signals of the body, whose names are arguments of `SensorInbox.put`
    reported: tuple[str, ...]  #: estimates of a microcontroller
    #: "battery" and "drive" -> signals that no estimator uses -> their names in a state
    beside: Mapping[str, Mapping[str, str]]

    @property
    def drive(self) -> bool:
        """True if the message has any signal of the drive."""
        return bool(self.wheels or self.body)

    def drive_message(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Keyword arguments of `SensorInbox.put`; nan for a wheel that is not in the message."""
        message: dict[str, Any] = {name: values[name] for name in self.body}
        for argument, signals in self.wheels:
            message[argument] = [values[signal] if signal else math.nan for signal in signals]
        return message


class MessageSorter:
    """Sorter of messages to one robot into their parts.

    Args:
        robot: None without a drive.
        counted: True if the inbox takes encoder counts; they are ignored otherwise.
    """

    def __init__(self, robot: Robot | None, counted: bool):
        self._robot = robot
        self._counted = counted
        self._kinds: dict[tuple[str, ...], MessageParts] = {}

    def parts(self, values: Mapping[str, float]) -> MessageParts:
        """The parts of a message with these signals."""
        names = tuple(values)
        found = self._kinds.get(names)
        if found is None:
            if len(self._kinds) >= MOST_KINDS:
                self._kinds.clear()
            found = self._kinds[names] = self._sort(names)
        return found

    def _sort(self, names: Sequence[str]) -> MessageParts:
        body: list[str] = []
        wheels: dict[str, list[str]] = {}
        beside: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
        known = {signal: QUANTITIES[name] for signal in names if (name := signal.partition(".")[0]) in QUANTITIES}
        for signal, quantity in known.items():
            argument = quantity.name.removeprefix("motor_")
            places = places_of(quantity, self._robot)
            wheel = wheel_number(signal, places)
            if quantity.name in BODY:
                body.append(signal)
            elif argument in WHEELS:
                if wheel is not None and (argument != "wheel_counts" or self._counted):
                    wheels.setdefault(argument, [""] * len(places))[wheel] = signal
            elif quantity.group and not quantity.estimated_from:
                name = signal if wheel is None else f"{quantity.name}.{places[wheel]}"
                beside[quantity.group][signal] = name
        return MessageParts(
            any(quantity.group == "battery" for quantity in known.values()),
            tuple((argument, tuple(signals)) for argument, signals in wheels.items()),
            tuple(body),
            tuple(signal for signal in names if signal.startswith("estimate.")),
            beside,
        )


def sender(source: str, publisher: str) -> str:
    """Name of who sends a signal: a source, or one of the publishers that it hears."""
    return f"{publisher} of {source}" if publisher else source


def places_of(quantity: Quantity, robot: Robot | None) -> tuple[str, ...]:
    """Names of the robot's wheels that have a quantity; empty for a quantity of neither wheels nor motors."""
    if robot is None or quantity.owner not in ("wheel", "motor"):
        return ()
    return tuple(place.name for place in robot.places)[: robot.driven if quantity.owner == "motor" else None]


def wheel_number(signal: str, places: Sequence[str]) -> int | None:
    """Index of the wheel that a signal belongs to, from the wheel's name or number; None if there is no such wheel."""
    part = signal.partition(".")[2]
    if part in places:
        return places.index(part)
    return int(part) if part.isdecimal() and int(part) < len(places) else None


def unmeasured_wheels(signals: Iterable[str], robot: Robot) -> list[str]:
    """Names of the driven wheels of which none of the signals gives the speed or the counts."""
    places = [place.name for place in robot.places]
    measured = {wheel_number(s, places) for s in signals if s.startswith(("wheel_speed", "wheel_counts"))}
    if isinstance(robot.chassis, Steered) and 0 in measured:
        return []
    return [place for k, place in enumerate(places[: robot.driven]) if k not in measured]


def no_such_part(signal: str, robot: Robot | None) -> str:
    """Sentence about a signal's wheel or motor that the robot does not have; "" if it has it."""
    quantity = quantity_of(signal)
    places = places_of(quantity, robot)
    if not places or wheel_number(signal, places) is not None:
        return ""
    fix = "leave it out of the source, or correct the robot file"
    return f"the robot has no such {quantity.each}; it has {', '.join(places)}; {fix}"
