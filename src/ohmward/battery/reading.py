"""A sample made safe for a filter: bad numbers replaced by the last good ones, and said so. Never stops or raises."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ohmward.battery.estimate import Flag, Sample
from ohmward.battery.thevenin import Input
from ohmward.trace import isfinite, where

#: Room temperature stands in as long as no thermometer has spoken.
ROOM_DEGC = 25.0


class Reading(NamedTuple):
    """A sample made safe: every number finite, and what was wrong with it.

    dt_s: step [s], >= 0.
    mean: mean current over the step and temperature.
    now: current of this instant and temperature.
    change_A: current now minus current before.
    known: 1 where both currents of the step are measured and close enough in time, else 0.
    flags: sum of `Flag`.
    """

    dt_s: Any
    mean: Input
    now: Input
    change_A: Any
    known: Any
    flags: Any


def read(sample: Sample, current_before_A: Any, temperature_before_degC: Any, gap_s: float) -> Reading:
    """The sample with everything that is not a number replaced by what was last known, and said so.

    gap_s: a longer step says nothing about the current between its two samples.
    """
    time_good = isfinite(sample.dt_s) & (sample.dt_s >= 0)
    dt_s = where(time_good, sample.dt_s, 0.0)
    current_good = isfinite(sample.current_A)
    current = where(current_good, sample.current_A, current_before_A)
    temperature = where(isfinite(sample.temperature_degC), sample.temperature_degC, temperature_before_degC)
    gap = dt_s > gap_s
    flags = (
        where(current_good, 0.0, float(Flag.NO_CURRENT))
        + where(time_good, 0.0, float(Flag.BAD_TIME))
        + where(gap, float(Flag.GAP), 0.0)
    )
    mean = Input(0.5 * (current + current_before_A), temperature)
    known = where(current_good & ~gap, 1.0, 0.0)
    return Reading(dt_s, mean, Input(current, temperature), current - current_before_A, known, flags)


def finite_or(value: float, otherwise: float) -> float:
    """The value, or something else where it is no number."""
    return float(value) if math.isfinite(value) else otherwise
