"""Messages of sources, their signals, and the way of items from a thread of a driver to the event loop."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from ohmward.checks import require_finite
from ohmward.errors import InputError, OhmwardError
from ohmward.quantities import quantity_of


class Message(NamedTuple):
    """Values that a source measured at one time."""

    stamp_s: float  #: time of the measurement on the source's own clock; nan where it has none
    received_s: float  #: monotonic time at which it came
    source: str  #: name of the source
    #: signal -> value in the unit of its name; nan and signals that are left out were not measured
    values: Mapping[str, float]
    publisher: str = ""  #: whose clock the stamp is of, where a source hears several
    #: date of the measurement, seconds since 1970, by the robot's own calendar: that of ROS, of a log; nan where the
    #: wall clock of this machine counts
    date_s: float = math.nan
    #: its receipt is the time of a simulation now, which stands still until the next such message
    sets_time: bool = False


#: Takes a message in; returns at once and never raises. The queue behind it is bounded.
Put = Callable[[Message], None]


@dataclass(frozen=True)
class ScaledSignal:
    """A number of a source that becomes a quantity: value = scale * number + offset."""

    name: str  #: as the source calls it: "BMS.Current" of a DBC, "/battery/current" of a topic, "I" of a JSON object
    #: to the unit of the quantity
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


class Wiring:
    """The signals of a source, looked up by the names that the source gives them.

    Args:
        signals: as in the settings of the source.

    Raises:
        InputError: a quantity that there is not.
    """

    def __init__(self, signals: Signals):
        self.signals: dict[str, list[tuple[str, float, float]]] = {}
        for quantity, given in signals.items():
            quantity_of(quantity)
            signal = given if isinstance(given, ScaledSignal) else ScaledSignal(given)
            self.signals.setdefault(signal.name, []).append((quantity, signal.scale, signal.offset))

    def values(self, numbers: Mapping[str, object]) -> dict[str, float]:
        """Quantities from the numbers of a source by its own names; nan where there is none, unknown names left out."""
        found: dict[str, float] = {}
        for name, number in numbers.items():
            for quantity, scale, offset in self.signals.get(name, ()):
                found[quantity] = scale * as_number(number) + offset
        return found


def json_value(text: bytes) -> object:
    """The value of a JSON text; None where it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def as_number(value: object) -> float:
    """The value as a number; nan where it is none."""
    if type(value) is float:
        return value
    if isinstance(value, bool | int | float):
        try:
            return float(value)
        except OverflowError:
            return math.nan
    return math.nan


T = TypeVar("T")

#: Of items that wait the newest so many are kept: 2 s of a full CAN bus at 1 Mbit/s.
_LONGEST = 20_000


class Handover(Generic[T]):
    """Made in the event loop; `put` and `fail` come from any thread, `take` from the loop.

    Attributes:
        lost: number of items that were left out because too many waited.
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
        """Let `take` raise the error, the first one, once everything before it is taken."""
        self._error = self._error or error
        self._wake()

    async def take(self) -> list[T]:
        """All items that wait, at least one."""
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
    """Items that `read` gives, called again and again in a thread until the end.

    name: of what is read.
    read: waits at most `wait_s` for an item; None where none has come.
    failed: the error that `take` raises for one of `read`, if that says no fix itself; nothing more is read then.
    """
    handover, end = Handover[T](), threading.Event()

    def work() -> None:
        while not end.is_set():
            try:
                item = read()
            except Exception as error:  # drivers raise of every kind
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
