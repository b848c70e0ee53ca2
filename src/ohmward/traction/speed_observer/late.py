"""Speeds that come late: how the predicted speed has changed since they were true."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import clip, maximum

_TINY_S = 1e-9


class History(NamedTuple):
    """The last steps, newest first.

    dt_s: (steps,) how long each was.
    change_m_s: (steps,) what the model added to the speed in it.
    """

    dt_s: np.ndarray
    change_m_s: np.ndarray


def empty_history(steps: int) -> History:
    """Nothing has happened yet."""
    return History(np.zeros(steps), np.zeros(steps))


def remember(history: History, dt_s: Any, change_m_s: Any) -> History:
    """The history with one more step, the oldest forgotten."""
    if len(history.dt_s) == 0:
        return history
    return History(
        np.array([dt_s, *history.dt_s[:-1]]),
        np.array([change_m_s, *history.change_m_s[:-1]]),
    )


def change_since(history: History, age_s: Any) -> Any:
    """What the model added to the speed [m/s] in the last `age_s`, even within a step."""
    change: Any = 0.0
    left = maximum(age_s, 0.0)
    for dt_s, step in zip(history.dt_s, history.change_m_s, strict=True):
        change = change + step * clip(left / maximum(dt_s, _TINY_S), 0.0, 1.0)
        left = left - dt_s
    return change
