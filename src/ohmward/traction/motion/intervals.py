"""Usual interval of each channel of a sensor, learnt as its values come: what is slower than the samples, not missing.

A sensor that comes at its own rate leaves samples without a value. For its usual interval the last value still holds;
later it is missing. The interval follows the gaps between values: quickly up to the longest of them, slowly down, so
that jitter makes no value missing; one gap in which the sensor failed lengthens it by a quarter at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.trace import clip, maximum, where
from ohmward.trace.expression import Scalar

#: Keeps a time of no length, a robot that stands or no sample at all from dividing by zero.
LEAST_DIVISOR = 1e-9


class History(NamedTuple):
    """The last steps, newest first."""

    dt_s: np.ndarray  #: (steps,) length of each
    change_m_s: np.ndarray  #: (steps,) predicted change of the speed in it


def empty_history(steps: int) -> History:
    """History of a filter that starts."""
    return History(np.zeros(steps), np.zeros(steps))


def remember(history: History, dt_s: Scalar, change_m_s: Scalar) -> History:
    """The history with one more step, the oldest forgotten."""
    if len(history.dt_s) == 0:
        return history
    return History(np.array([dt_s, *history.dt_s[:-1]]), np.array([change_m_s, *history.change_m_s[:-1]]))


def change_since(history: History, age_s: Scalar) -> Scalar:
    """Predicted change [m/s] of the speed in the last `age_s`, a step that it begins in counted in part."""
    change: Scalar = 0.0
    left_s: Scalar = maximum(age_s, 0.0)
    for dt_s, step_m_s in zip(history.dt_s, history.change_m_s, strict=True):
        change = change + step_m_s * clip(left_s / maximum(dt_s, LEAST_DIVISOR), 0.0, 1.0)
        left_s = left_s - dt_s
    return change


#: Age [s] of a channel that has never had a value.
NEVER_S = 1e9

#: Factors by which one gap between two values shortens and lengthens the usual interval at most.
SHORTER, LONGER = 0.99, 1.25

#: Share of the usual interval for which a value holds; below 1, so that a value that fails is missing.
HOLD_SHARE = 0.99

#: So many values in a row may be lost on a link from a sensor that works.
LOST = 3

#: Time [s] for which the first value holds, until a second one tells the interval: sensors of 5 Hz are usual.
FIRST_INTERVAL_S = 0.25


class Intervals(NamedTuple):
    """Clocks of channels, each (channels,)."""

    age_s: np.ndarray  #: time since the last value; `NEVER_S` and more before the first
    usual_s: np.ndarray  #: usual time between two values; 0 before the second


def never(channels: int) -> Intervals:
    """Clocks of channels that have not had a value."""
    return Intervals(np.full(channels, NEVER_S), np.zeros(channels))


def advance(before: Intervals, measured: np.ndarray, dt_s: Scalar) -> Intervals:
    """The clocks after a step; measured: (channels,) conditions that there is a value at its end."""
    gap_s = before.age_s + dt_s
    followed = clip(gap_s, SHORTER * before.usual_s, LONGER * before.usual_s)
    learnt = where(np.array([usual > 0.0 for usual in before.usual_s]), followed, gap_s)
    return Intervals(
        age_s=where(measured, 0.0, gap_s),
        usual_s=where(measured & was_seen(before), learnt, before.usual_s),
    )


def was_seen(intervals: Intervals) -> np.ndarray:
    """Conditions (channels,) that there has been a value."""
    return np.array([age < NEVER_S for age in intervals.age_s])


def holds(intervals: Intervals) -> np.ndarray:
    """Conditions (channels,) that the last value still holds."""
    usual_s = where(np.array([usual > 0.0 for usual in intervals.usual_s]), intervals.usual_s, FIRST_INTERVAL_S)
    return np.array([age < HOLD_SHARE * usual for age, usual in zip(intervals.age_s, usual_s, strict=True)])


def share_measured(before: Intervals, after: Intervals, dt_s: Scalar) -> np.ndarray:
    """Share of the time since the last value over which a mean is taken (channels,); 0 before the second value.

    All of it where up to LOST values were lost on the way, as counts run on; beyond, the usual interval.

    before, after: clocks before and after the step.
    """
    gap_s = before.age_s + dt_s
    lost = np.array([gap <= (LOST + 1) * usual for gap, usual in zip(gap_s, after.usual_s, strict=True)])
    return where(lost, 1.0, after.usual_s / maximum(gap_s, LEAST_DIVISOR))
