"""Innovation gate, and the reset after a time-out: one policy for every filter, without a branch.

- A measurement that is missing, or whose NIS exceeds `gate`, is not used: the prediction stands (`passes`, `choose`).
- `rejected_s` is the time for which all measurements have been rejected (`time_rejected`).
- Where it exceeds `reset_after_s` the filter has `diverged`: the filter is wrong then, not the measurements. It
  inflates a variance (`inflate`), uses the measurement all the same, or distrusts the sensor. Which of these is up to
  each filter; the gate, the timer and their names are the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.filters.belief import Belief, Correction, Innovation, nis
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import Condition, Scalar, isfinite, maximum, where


def passes(innovation: Innovation, threshold: float = math.inf) -> Condition:
    """True where the NIS is at most the threshold; false for a measurement that is not a number or infinite."""
    within = nis(innovation) <= threshold
    if threshold < math.inf:
        return within
    return within & isfinite(sum(innovation.value))  # inf <= inf passes; a sum is finite only if all its terms are


def correct_gated(
    belief: Belief, y: Scalar, correct: Callable[[np.ndarray], Correction], threshold: float = math.inf
) -> tuple[Belief, Scalar]:
    """The belief after a measurement of one number where it passes the gate, and the condition that it does.

    Args:
        belief: before the measurement.
        y: measured; nan where there is none.
        correct: the filter's correction of the belief by a measurement (1,).
        threshold: on the NIS; by default only missing measurements are skipped.
    """
    measured = isfinite(y)
    correction = correct(np.array([where(measured, y, 0.0)]))
    accepted = measured & passes(correction.innovation, threshold)
    return choose(accepted, correction.belief, belief), accepted


def require_gate(gate: float, reset_after_s: float) -> None:
    """Raise `InputError` unless the gate is > 0 and the time-out >= 0."""
    require_positive("gate", gate)
    require_between("reset_after_s", reset_after_s, 0.0, math.inf)


def time_rejected(
    rejected_s: Scalar, dt_s: Scalar, rejected: Scalar, measured: Scalar = True, sparse: bool = False
) -> Scalar:
    """Time [s] for which all measurements have been rejected, this step included.

    Args:
        rejected_s: the same before this step; 0 at the start.
        dt_s: step [s], >= 0.
        rejected: the condition that the measurement is outside its gate; ignored where there is no measurement.
        measured: the condition that there is a measurement.
        sparse: True for a sensor slower than the samples: the time then runs on between two of its measurements. For
            other sensors it stops while there is no measurement, which neither confirms nor contradicts.
    """
    going_on_s = rejected_s + dt_s
    unmeasured_s = where(rejected_s > 0.0, going_on_s, 0.0) if sparse else rejected_s
    return where(measured, where(rejected, going_on_s, 0.0), unmeasured_s)


def inflate(belief: Belief, i: int, variance: Scalar) -> Belief:
    """The belief with `variance` added to element i; a negative one adds nothing."""
    extra = np.zeros_like(belief.cov)
    extra[i, i] = maximum(variance, 0.0)
    return Belief(belief.mean, belief.cov + extra)


def widen(belief: Belief, i: int, variance: Scalar) -> Belief:
    """The belief with the variance of element i raised to at least this one."""
    return inflate(belief, i, variance - belief.cov[i, i])


def restarted_at(belief: Belief, i: int, mean: Scalar, variance: Scalar) -> Belief:
    """The belief with a new mean and variance of element i, independent of all others."""
    means, cov = belief.mean.copy(), belief.cov.copy()
    means[i], cov[i, :], cov[:, i] = mean, 0.0, 0.0
    cov[i, i] = variance
    return Belief(means, cov)


def apply_gain(prior: Belief, innovation: Innovation, K: np.ndarray) -> Belief:
    """The prior corrected with the gain K (n, m): the filter's own, or zeros where the measurement is not used.

    Choosing the gain costs n choices, choosing between prior and posterior n (n + 3) / 2. The covariance is the plain
    difference P - K S K'.
    """
    cov = prior.cov - K @ innovation.cov @ K.T
    return Belief(prior.mean + K @ innovation.value, mirror_lower(cov))


def choose(condition: Scalar, a: Any, b: Any) -> Any:
    """`a` where the scalar condition holds, else `b`, element by element through tuples, arrays and numbers."""
    if isinstance(a, tuple):
        chosen = (choose(condition, x, y) for x, y in zip(a, b, strict=True))
        return tuple(chosen) if type(a) is tuple else type(a)(*chosen)
    return where(condition, a, b)
