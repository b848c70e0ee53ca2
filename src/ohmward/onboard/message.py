"""Messages of sources, and the signals that they are made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ohmward.checks import require_finite
from ohmward.errors import InputError
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
