"""A sample made safe for the RC estimators: every number finite, and what was wrong with it said in flags."""

from __future__ import annotations

from typing import Any, NamedTuple

from ohmward.battery.estimate import Flag, Sample
from ohmward.trace import isfinite, where


class Reading(NamedTuple):
    """What a step works with.

    dt_s: step [s], >= 0.
    before_A, mean_A, now_A: current at the start of the step, its mean (linear in between), and at the end.
    known: 1.0 where the current was measured and the step is no gap, else 0.0.
    voltage_V: measured, nan where it was not.
    flags: sum of `Flag`.
    """

    dt_s: Any
    before_A: Any
    mean_A: Any
    now_A: Any
    known: Any
    voltage_V: Any
    flags: Any


def read(sample: Sample, before_A: Any, gap_s: float) -> Reading:
    """The reading of a sample; a current that is not a number is the one before, a bad time is no time.

    before_A: current of the sample before [A], finite.
    gap_s: longer steps are gaps; nothing is known of the current inside.
    """
    time_good = isfinite(sample.dt_s) & (sample.dt_s >= 0)
    dt_s = where(time_good, sample.dt_s, 0.0)
    current_good = isfinite(sample.current_A)
    now_A = where(current_good, sample.current_A, before_A)
    gap = dt_s > gap_s
    flags = (
        where(time_good, 0.0, float(Flag.BAD_TIME))
        + where(current_good, 0.0, float(Flag.NO_CURRENT))
        + where(gap, float(Flag.GAP), 0.0)
        + where(isfinite(sample.voltage_V), 0.0, float(Flag.NO_VOLTAGE))
    )
    known = where(current_good & (dt_s <= gap_s), 1.0, 0.0)
    return Reading(dt_s, before_A, 0.5 * (before_A + now_A), now_A, known, sample.voltage_V, flags)
