"""State of health as single logs show it: one point a log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal

#: A log that narrows the logarithm of a quantity to no less than this by itself says nothing of it.
SAYS_NOTHING_STD = 0.5
DAY_S = 86400.0
_UNKNOWN = Normal(math.nan, math.inf)


class HealthPoint(NamedTuple):
    """State of health as one log shows it."""

    log: str  #: its name
    time_s: float  #: Unix time of the middle of the log [s]
    hours: float  #: its length
    cycles: float  #: full cycles' worth of charge that it moved
    #: ln of the capacity over that when new, from this log alone; std inf where it says nothing
    log_capacity: Normal = _UNKNOWN
    log_resistance: Normal = _UNKNOWN  #: ln of the resistance at 25 degC over that when new, likewise
    temperature_degC: float = math.nan  #: mean, nan where not measured
    full: bool = False  #: True where the battery was full in it

    @property
    def shows_capacity(self) -> bool:
        """True where the log alone says something of the capacity."""
        return self.log_capacity.std < SAYS_NOTHING_STD

    @property
    def shows_resistance(self) -> bool:
        """True where the log alone says something of the resistance."""
        return self.log_resistance.std < SAYS_NOTHING_STD


def logarithm(quantity: Normal, reference: float) -> Normal:
    """Distribution of ln(quantity / reference); of std inf where the quantity is not known."""
    if not (quantity.mean > 0.0 and math.isfinite(quantity.std)):
        return _UNKNOWN
    return Normal(math.log(quantity.mean / reference), quantity.std / quantity.mean)


class Track(NamedTuple):
    """A quantity of several logs in the order of time."""

    days: np.ndarray  #: (n,) since the first log of all
    cycles: np.ndarray  #: (n,) full cycles since then, up to the middle of the log
    #: (n,) natural logarithm over the value when new
    value: np.ndarray
    std: np.ndarray

    @classmethod
    def of(cls, points: Sequence[HealthPoint], quantity: str) -> Track:
        """The logs that say something of this quantity, a field of `HealthPoint`."""
        start_s = min((point.time_s for point in points), default=0.0)
        moved = np.cumsum([point.cycles for point in points])
        rows = [
            ((point.time_s - start_s) / DAY_S, upto - point.cycles / 2, *getattr(point, quantity))
            for point, upto in zip(points, moved, strict=True)
            if getattr(point, quantity).std < SAYS_NOTHING_STD
        ]
        return cls(*np.array(rows, dtype=float).reshape(-1, 4).T)
