"""Fewer samples that draw the same picture: what a screen of so many pixel columns can show, and no spike less.

M4 of Jugel, Jerzak, Hackenbroich and Markl, "M4: A Visualization-Oriented Time Series Data Aggregation",
VLDB 2014: the first, last, lowest and highest sample of each pixel column draw the same line as all samples.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def m4(x: np.ndarray, y: np.ndarray, columns: int) -> np.ndarray:
    """Indices (k,) of the samples to keep, ascending, k <= 5 columns.

    x: (n,) ascending; y: (n,), NaN is a gap: the first NaN of a column is kept too.
    A series of at most 4 columns samples is kept whole.
    """
    if x.size <= 4 * columns:
        return np.arange(x.size)
    kept = [_column_samples(y[i:j]) + i for i, j in pairwise(column_edges(x, columns)) if i < j]
    return np.concatenate(kept)


def envelope(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A band that contains the given one, as (x, low, high) of at most 2 columns samples.

    x: (n,) ascending; low, high: (n,).  Each column spans from its first to its last x, from its lowest low to its
    highest high; a column without any finite sample is NaN, a gap narrower than a column closes.
    A band of at most 2 columns samples is kept whole.
    """
    if x.size <= 2 * columns:
        return x, low, high
    boxes = [(i, j) for i, j in pairwise(column_edges(x, columns)) if i < j]
    ends = np.array([x[[i, j - 1]] for i, j in boxes]).ravel()
    lowest = np.array([np.fmin.reduce(low[i:j]) for i, j in boxes])
    highest = np.array([np.fmax.reduce(high[i:j]) for i, j in boxes])
    return ends, np.repeat(lowest, 2), np.repeat(highest, 2)


def column_edges(x: np.ndarray, columns: int) -> np.ndarray:
    """Indices (columns + 1,) that split ascending x (n,) into columns of equal width; some may be empty."""
    inner = np.linspace(x[0], x[-1], columns + 1)[1:-1]
    return np.concatenate([[0], np.searchsorted(x, inner), [x.size]])


def _column_samples(y: np.ndarray) -> np.ndarray:
    gaps = np.isnan(y)
    finite = np.flatnonzero(~gaps)
    if finite.size == 0:
        return np.array([0])
    kept = [finite[0], finite[-1], np.nanargmin(y), np.nanargmax(y)]
    return np.unique([*kept, np.argmax(gaps)] if gaps.any() else kept)
