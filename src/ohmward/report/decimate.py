"""Fewer samples that draw the same picture: what a screen of so many pixel columns can show, and no spike less.

M4 of Jugel, Jerzak, Hackenbroich and Markl, "M4: A Visualization-Oriented Time Series Data Aggregation",
VLDB 2014: the first, last, lowest and highest sample of each pixel column draw the same line as all samples.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from ohmward.report.figure import Series

DOT_PX: Final = 4
"""Diameter of a sample drawn as a point."""


def samples(series: Series, log_y: bool, width_px: int, height_px: int) -> np.ndarray:
    """Indices of the samples that draw `series` in an area of this size as all of them would."""
    if series.style != "points":
        return m4(series.x, series.y, width_px)
    y = np.log10(series.y) if log_y and series.axis == "left" else series.y
    return scatter(series.x, y, width_px // DOT_PX, height_px // DOT_PX)


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


def scatter(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Indices (k,) of samples that dot the same cells of a columns by rows grid, the lowest and the highest included.

    x, y: (n,), samples whose y is NaN are left out; k <= columns rows + 2.  So many samples are kept whole.
    """
    seen = np.flatnonzero(~np.isnan(y))
    if seen.size <= columns * rows:
        return seen
    cell = _cells(x[seen], columns) * rows + _cells(y[seen], rows)
    first = np.unique(cell, return_index=True)[1]
    return np.unique(seen[[*first, np.argmin(y[seen]), np.argmax(y[seen])]])


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


def _cells(values: np.ndarray, count: int) -> np.ndarray:
    """Which of `count` equal cells between the lowest and the highest value each of them is in."""
    low, high = values.min(), values.max()
    return np.minimum((values - low) / (high - low or 1.0) * count, count - 1).astype(int)
