"""Curves along SoC that stand on knots: straight between them, constant beyond."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ohmward.trace import clip


def hat(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N, K) weights of the values on the knots (K,) at x (N,)."""
    x = np.clip(x, knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = (x - knots[left]) / (knots[left + 1] - knots[left])
    weights = np.zeros((x.size, knots.size))
    rows = np.arange(x.size)
    weights[rows, left] = 1 - share
    weights[rows, left + 1] += share
    return weights


def between_knots(values: Sequence[Any] | np.ndarray, knots: np.ndarray, x: Any) -> Any:
    """The curve through values (K,) at x; values and x may be traced."""
    found = values[0]
    for k, (left, right) in enumerate(zip(knots.tolist(), knots[1:].tolist(), strict=False)):
        found = found + (values[k + 1] - values[k]) * clip((x - left) * (1.0 / (right - left)), 0.0, 1.0)
    return found


def correlation(knots: np.ndarray, length: float) -> np.ndarray:
    """(K, K) correlation between knots of a Gauss-Markov process along SoC: e^-1 at a distance of `length`."""
    return np.exp(-np.abs(knots[:, None] - knots) / length)
