"""Motor currents that come less often than the samples of a log: between two of them the last one holds."""

from __future__ import annotations

import numpy as np

#: Share of a channel's usual interval for which its last value holds; below 1, so that a value that fails is missing.
HOLD_SHARE = 0.99


def held(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The values (T, N) with each column's last one in place of nan, for the usual interval of that column.

    A column that comes with every sample stays as it is: a value that it lacks has failed.

    time_s: (T,) [s], increasing.
    """
    if np.isfinite(values).all():
        return values
    return np.column_stack([_held_column(time_s, column) for column in values.T])


def _held_column(time_s: np.ndarray, column: np.ndarray) -> np.ndarray:
    known = np.flatnonzero(np.isfinite(column))
    if known.size < 2:
        return column
    usual_s = float(np.median(np.diff(time_s[known])))
    before = np.searchsorted(known, np.arange(len(column)), side="right") - 1
    last = known[np.maximum(before, 0)]
    holds = (before >= 0) & (time_s - time_s[last] < HOLD_SHARE * usual_s)
    return np.where(holds, column[last], column)
