"""The last steps of the way, so that a pose increment that comes late meets the motion that it saw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.trace import clip, cos, maximum, sin
from ohmward.trace.expression import Scalar

#: Keeps a step of no length from dividing by zero [s].
_TINY_S = 1e-9


class Trail(NamedTuple):
    """Dead reckoning that no measurement corrects."""

    dt_s: np.ndarray  #: (steps,) length of each of the last steps, newest first
    moved: np.ndarray  #: (3, steps) change of x, y and yaw in each, in the frame of its own start
    yaw_rad: Scalar  #: at its end


class SeenWay(NamedTuple):
    """The way between two instants."""

    increment: np.ndarray  #: (3,) forward, left and turn, in the frame of its start
    known_s: Scalar  #: time of it that is remembered


def empty_trail(steps: int) -> Trail:
    """Trail of a filter that starts."""
    return Trail(np.zeros(steps), np.zeros((3, steps)), 0.0)


def extend(trail: Trail, twist: np.ndarray, dt_s: Scalar) -> Trail:
    """The trail with one more step of this twist (3,), the oldest forgotten."""
    if len(trail.dt_s) == 0:
        return trail
    turn = twist[2] * dt_s
    middle = trail.yaw_rad + turn / 2.0
    forward, left = twist[0] * dt_s, twist[1] * dt_s
    step = [forward * cos(middle) - left * sin(middle), forward * sin(middle) + left * cos(middle), turn]
    moved = np.array([[new, *row[:-1]] for new, row in zip(step, trail.moved, strict=True)])
    return Trail(np.array([dt_s, *trail.dt_s[:-1]]), moved, trail.yaw_rad + turn)


def way(trail: Trail, length_s: Scalar, age_s: Scalar) -> SeenWay:
    """The way of `length_s` that ended `age_s` ago; a step that begins or ends within is counted in part."""
    end, end_s = moved_since(trail, age_s)
    start, start_s = moved_since(trail, age_s + length_s)
    dx, dy, turn = start - end
    yaw = trail.yaw_rad - start[2]
    c, s = cos(yaw), sin(yaw)
    return SeenWay(np.array([c * dx + s * dy, c * dy - s * dx, turn]), start_s - end_s)


def moved_since(trail: Trail, age_s: Scalar) -> tuple[np.ndarray, Scalar]:
    """Change (3,) of x, y and yaw in the last `age_s`, and how much of that time is remembered [s]."""
    moved: np.ndarray = np.zeros(3)
    left_s = maximum(age_s, 0.0)
    known_s: Scalar = 0.0
    for dt_s, step in zip(trail.dt_s, trail.moved.T, strict=True):
        share = clip(left_s / maximum(dt_s, _TINY_S), 0.0, 1.0)
        moved = moved + step * share
        known_s = known_s + dt_s * share
        left_s = left_s - dt_s
    return moved, known_s
