"""Delayed speeds: the change of the predicted speed since they were true."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.trace import clip, maximum
from ohmward.trace.expression import Scalar

#: Keeps a step of no length from dividing by zero [s].
_TINY_S = 1e-9


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
        change = change + step_m_s * clip(left_s / maximum(dt_s, _TINY_S), 0.0, 1.0)
        left_s = left_s - dt_s
    return change
