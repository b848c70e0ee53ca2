"""A sample made safe for an observer: what cannot be true is replaced by what was last known, and said so."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import exp, maximum, minimum, where
from ohmward.traction.speed_observer.estimate import SlipFlag, SlipSample

#: A longer step is a clock that was set, not a robot that waited.
LONGEST_STEP_S = 3600.0

#: A motor current that is not measured is held, and fades.
HOLD_S = 0.5


class CleanSlipSample(NamedTuple):
    """A sample with every number finite that is used.

    dt_s: step [s], >= 0.
    moving_s: part of it that the model is believed for.
    unknown_s: the rest of it; 0 while the robot stands.
    current_A: (driven,) over the step.
    guessed: (driven,) 1 where that is not measured, else 0.
    wheel_speed_rad_s: (wheels,), 0 where it is not measured.
    measured: (wheels,) whether it is.
    pitch_rad: as measured.
    flags: sum of `SlipFlag`.
    """

    dt_s: Any
    moving_s: Any
    unknown_s: Any
    current_A: np.ndarray
    guessed: np.ndarray
    wheel_speed_rad_s: np.ndarray
    measured: np.ndarray
    pitch_rad: Any
    flags: Any


def is_step(dt_s: Any) -> Any:
    """Whether so much time can lie between two samples."""
    return (dt_s >= 0.0) & (dt_s <= LONGEST_STEP_S)


def sanitize(
    sample: SlipSample, before_A: np.ndarray, gap_s: float, current_limit_A: float, wheel_speed_limit_rad_s: float
) -> CleanSlipSample:
    """The sample made safe; before_A: (driven,) the last currents."""
    driven = len(before_A)
    time_good = is_step(sample.dt_s)
    dt_s = where(time_good, sample.dt_s, 0.0)
    known = [within(i, current_limit_A) for i in sample.current_A]
    kept = exp(-dt_s / HOLD_S)
    current = [where(good, i, kept * b) for good, i, b in zip(known, sample.current_A, before_A, strict=True)]
    measured = [within(w, wheel_speed_limit_rad_s) for w in sample.wheel_speed_rad_s]
    flags = (
        where(time_good, 0.0, float(SlipFlag.BAD_TIME))
        + where(dt_s > gap_s, float(SlipFlag.GAP), 0.0)
        + where(every(known), 0.0, float(SlipFlag.NO_CURRENT))
        + where(every(measured[:driven]), 0.0, float(SlipFlag.NO_ENCODER))
    )
    return CleanSlipSample(
        dt_s,
        minimum(dt_s, gap_s),
        dt_s - minimum(dt_s, gap_s),
        np.array(current),
        np.array([where(good, 0.0, 1.0) for good in known]),
        np.array([where(good, w, 0.0) for good, w in zip(measured, sample.wheel_speed_rad_s, strict=True)]),
        np.array(measured),
        sample.pitch_rad,
        flags,
    )


def within(value: Any, limit: float) -> Any:
    """Whether it is a number of at most this size."""
    return (value >= -limit) & (value <= limit)


def every(conditions: Any) -> Any:
    """Whether all of them hold."""
    result, *others = conditions
    for condition in others:
        result = result & condition
    return result


def some(conditions: Any) -> Any:
    """Whether one of them holds."""
    result, *others = conditions
    for condition in others:
        result = result | condition
    return result


def largest(values: Any) -> Any:
    """The largest of them."""
    result: Any = -math.inf
    for value in values:
        result = maximum(result, value)
    return result
