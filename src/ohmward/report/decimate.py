"""Decimation: fewer samples that draw the same picture on a screen of so many pixel columns, spikes included.

M4 of Jugel, Jerzak, Hackenbroich and Markl, "M4: A Visualization-Oriented Time Series Data Aggregation",
VLDB 2014: the first, last, lowest and highest sample of each pixel column draw the same line as all samples.
"""

from __future__ import annotations

from typing import Final

import numpy as np

DOT_PX: Final = 4
"""Diameter of a sample drawn as a point."""
FINEST: Final = 256_000
"""Columns for which a figure keeps the samples of a long line: a million samples stay whole, and may be zoomed into."""
_COLUMNS_AT_ONCE: Final = 20_000
"""Columns decimated at once: bounds the memory that ten million samples take."""


def m4(x: np.ndarray, y: np.ndarray, columns: int) -> np.ndarray:
    """Indices (k,) of the samples to keep, ascending, k <= 5 columns.

    x: (n,) ascending; y: (n,), NaN is a gap: the first NaN of a column is visible too.
    A series of at most 4 columns samples is taken whole.
    """
    if x.size <= 4 * columns:
        return np.arange(x.size)
    edges = np.unique(column_edges(x, columns))
    blocks = (edges[k : k + _COLUMNS_AT_ONCE + 1] for k in range(0, edges.size - 1, _COLUMNS_AT_ONCE))
    return np.concatenate([block[0] + _column_samples(y[block[0] : block[-1]], block - block[0]) for block in blocks])


def finest(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Line (x, y) of at most 5 samples for each of `FINEST` columns, its ends among them.

    If `FINEST` is 2^k times the number of columns drawn, `m4` finds the same samples in it as in all.
    """
    visible = m4(x, y, FINEST)
    if visible.size == x.size:
        return x, y
    visible = np.union1d(visible, [0, x.size - 1])
    return x[visible], y[visible]


def envelope(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Band (x, low, high) of at most 2 columns samples that contains the given one.

    x: (n,) ascending; low, high: (n,).  Each column spans from its first to its last x, from its lowest low to its
    highest high; a column without any finite sample is NaN, a gap narrower than a column closes.
    A band of at most 2 columns samples is unchanged.
    """
    if x.size <= 2 * columns:
        return x, low, high
    edges = np.unique(column_edges(x, columns))
    ends = x[np.stack([edges[:-1], edges[1:] - 1], axis=1)].ravel()
    lowest, highest = np.fmin.reduceat(low, edges[:-1]), np.fmax.reduceat(high, edges[:-1])
    return ends, np.repeat(lowest, 2), np.repeat(highest, 2)


def scatter(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Indices (k,) of samples with dots in the same cells of a grid as all, the lowest and the highest included.

    x, y: (n,), samples whose y is NaN are left out; k <= columns rows + 2. No more samples than cells are all taken.
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


def _column_samples(y: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Indices of the first, last, lowest and highest sample and the first gap of each column; edges: (columns + 1,)."""
    gap = np.isnan(y)
    column = np.repeat(np.arange(edges.size - 1), np.diff(edges))
    lowest, highest = np.fmin.reduceat(y, edges[:-1])[column], np.fmax.reduceat(y, edges[:-1])[column]
    rows = [_firsts(chosen, column) for chosen in (gap, ~gap, y == lowest, y == highest)]
    known = np.flatnonzero(~gap)
    rows.append(known[np.diff(column[known], append=-1) != 0])
    return np.unique(np.concatenate(rows))


def _firsts(chosen: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Index of the first chosen sample of each column that has one."""
    rows = np.flatnonzero(chosen)
    return rows[np.diff(column[rows], prepend=-1) != 0]


def _cells(values: np.ndarray, count: int) -> np.ndarray:
    """Number of the cell of each value, of `count` equal cells between the lowest and the highest value."""
    low, high = values.min(), values.max()
    return np.minimum((values - low) / (high - low or 1.0) * count, count - 1).astype(int)
