"""Measurements that are missing or that cannot be true: skipped without a branch, and counted."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief, Innovation, nis
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import isfinite, where


class GateCounts(NamedTuple):
    """How many measurements went which way; numbers without unit.

    accepted: used.
    rejected: finite, but with a NIS above the threshold. Many in a row are the filter's fault, not the sensor's.
    missing: not a number, or infinite.
    """

    accepted: float = 0.0
    rejected: float = 0.0
    missing: float = 0.0


def gate(
    prior: Any, posterior: Any, innovation: Innovation, counts: GateCounts, threshold: float = math.inf
) -> tuple[Any, GateCounts]:
    """The posterior where the measurement passes the gate nu' S^-1 nu <= threshold, else the prior; and the counts.

    Args:
        prior: before the measurement: a belief, or any NamedTuples of arrays and numbers.
        posterior: after it, of the same shape.
        innovation: of the measurement.
        counts: so far.
        threshold: on the NIS, the chi-square quantile with m degrees of freedom (`consistency.gate_threshold`); by
            default only missing measurements are skipped.
    """
    accepted = passes(innovation, threshold)
    return choose(accepted, posterior, prior), count(counts, innovation, accepted)


def passes(innovation: Innovation, threshold: float = math.inf) -> Any:
    """Whether the NIS is at most the threshold; false for a measurement that is not a number or infinite."""
    return _is_there(innovation) & (nis(innovation) <= threshold)


def count(counts: GateCounts, innovation: Innovation, accepted: Any) -> GateCounts:
    """The counts with one more measurement."""
    finite = where(_is_there(innovation), 1.0, 0.0)
    used = where(accepted, 1.0, 0.0)
    return GateCounts(counts.accepted + used, counts.rejected + finite - used, counts.missing + 1 - finite)


def apply_gain(prior: Belief, innovation: Innovation, K: np.ndarray) -> Belief:
    """The prior corrected with the gain K (n, m): the filter's own, or zeros where the measurement is not used.

    Choosing the gain costs n choices, choosing between prior and posterior n (n + 3) / 2. The covariance is the plain
    difference P - K S K'.
    """
    cov = prior.cov - K @ innovation.cov @ K.T
    return Belief(prior.mean + K @ innovation.value, mirror_lower(cov))


def choose(condition: Any, a: Any, b: Any) -> Any:
    """`a` where the scalar condition holds, else `b`, element by element through NamedTuples, arrays and numbers."""
    if isinstance(a, tuple):
        return type(a)(*(choose(condition, x, y) for x, y in zip(a, b, strict=True)))
    if isinstance(a, np.ndarray):
        return np.array([choose(condition, x, y) for x, y in zip(a, b, strict=True)])
    return where(condition, a, b)


def _is_there(innovation: Innovation) -> Any:
    """Whether every element is finite: a sum is not as soon as one of its terms is not."""
    return isfinite(sum(innovation.value))
