"""Integrals of samples by the trapezoidal rule."""

from __future__ import annotations

import numpy as np


def running_integral(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral from the first sample to each of them, 0 at the first; x: (T,), values: (T,) or (T, N)."""
    widths = np.diff(x).reshape(-1, *[1] * (values.ndim - 1))
    areas = 0.5 * widths * (values[1:] + values[:-1])
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(areas, axis=0)])


def trapezoid_weights(x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(T,) weights of the samples in an integral over the intervals with both ends known (T,)."""
    half = 0.5 * np.diff(x) * (known[1:] & known[:-1])
    return np.concatenate([half, [0.0]]) + np.concatenate([[0.0], half])


def weighted_sum(weights: np.ndarray, values: np.ndarray | float) -> float:
    """Sum of weights (T,) times values (T,), which may be nan where the weight is 0."""
    return float(np.sum(weights * np.where(weights > 0, values, 0.0)))
