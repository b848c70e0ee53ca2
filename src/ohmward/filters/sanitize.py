"""Sanitise a sample: one way to replace impossible values of a sensor or a clock, so that no filter sees them.

A value is credible where it is finite and within the range of its sensor and of the measured quantity. Where it is not,
the last credible one is held, and decays where it cannot be assumed to last. A time step is credible between zero and a
longest one; of a step longer than a gap nothing is known but its duration. Nothing here raises or branches, and every
replacement has its condition, from which `flags_of` makes flags.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import reduce
from operator import and_, or_
from typing import Any, NamedTuple

from ohmward.trace import Condition, Scalar, exp, where


class CleanStep(NamedTuple):
    """Time between two samples."""

    dt_s: Scalar  #: step [s], >= 0; 0 where it is not credible
    credible: Condition  #: the condition that a running clock can produce it
    gap: Condition  #: the condition that it is longer than a gap: nothing is known of that time


def sanitize_step(dt_s: Scalar, longest_s: float, gap_s: float) -> CleanStep:
    """The time step between two samples, 0 where no running clock can produce it.

    longest_s: a longer step is a clock that was set, not a time that passed.
    gap_s: longest step that the samples at its ends still describe.
    """
    credible = is_step(dt_s, longest_s)
    clean_s = where(credible, dt_s, 0.0)
    return CleanStep(clean_s, credible, clean_s > gap_s)


def is_step(dt_s: Scalar, longest_s: float) -> Condition:
    """True where this time [s] can lie between two samples; false for nan.

    longest_s: infinity where no step is too long.
    """
    return dt_s >= 0.0 if longest_s == math.inf else between(dt_s, 0.0, longest_s)


def within(value: Scalar, limit: float) -> Condition:
    """True where a value is a number of at most this size; limit: finite, or an infinite value passes."""
    return abs(value) <= limit


def between(value: Scalar, low: float, high: float) -> Condition:
    """True where a value is a number in [low, high]."""
    return (value >= low) & (value <= high)


def hold(value: Scalar, credible: Scalar, last: Scalar, dt_s: Scalar = 0.0, fade_s: float | None = None) -> Scalar:
    """The value where it is credible, else the last credible one.

    dt_s: step since then [s].
    fade_s: time constant with which the last one decays [s]; None where it is held.
    """
    return where(credible, value, last if fade_s is None else last * exp(-dt_s / fade_s))


def every(conditions: Iterable[Any]) -> Condition:
    """True where all conditions hold; there must be one."""
    return reduce(and_, conditions)


def some(conditions: Iterable[Any]) -> Condition:
    """True where at least one condition holds; there must be one."""
    return reduce(or_, conditions)
