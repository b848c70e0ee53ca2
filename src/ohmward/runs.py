"""Runs of a condition, windows of time, and straight lines over missing values, along a log."""

from __future__ import annotations

import math

import numpy as np


def runs(condition: np.ndarray) -> list[tuple[int, int]]:
    """First index and the one after the last of every run of True in a condition (T,)."""
    first, stop = _ends(condition)
    return list(zip(first.tolist(), stop.tolist(), strict=True))


def long_runs(condition: np.ndarray, time_s: np.ndarray, least_s: float, fewest: int = 1) -> list[tuple[int, int]]:
    """The `runs` of at least `least_s` from their first to their last sample, with at least `fewest` samples.

    condition, time_s: (T,).
    """
    first, stop = _ends(condition)
    enough = (stop - first >= fewest) & (time_s[stop - 1] - time_s[first] >= least_s)
    return list(zip(first[enough].tolist(), stop[enough].tolist(), strict=True))


def repeats(values: np.ndarray) -> np.ndarray:
    """(T,) True where a value is that of the row before to the last digit; nan is not."""
    same = np.zeros(values.size, dtype=bool)
    np.equal(values[1:], values[:-1], out=same[1:])
    return same


def where_known(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """The columns (T,) at the rows where all of them are finite; the columns themselves where every row is."""
    known = np.logical_and.reduce([np.isfinite(values) for values in columns])
    return columns if known.all() else tuple(values[known] for values in columns)


def window_starts(time_s: np.ndarray, window_s: float, begin_s: float) -> np.ndarray:
    """Index of the first sample in every window of time that has one.

    time_s: (T,) [s] increasing; window_s: length of a window; begin_s: begin of the first one, not after `time_s[0]`.
    """
    windows = int((time_s[-1] - begin_s) // window_s) + 1
    return np.unique(np.searchsorted(time_s, begin_s + window_s * np.arange(windows)))


def interpolated(at_s: np.ndarray, time_s: np.ndarray, values: np.ndarray, longest_s: float = np.inf) -> np.ndarray:
    """Values (N,) at times on straight lines between known samples; nan elsewhere, and across more than `longest_s`.

    at_s: (N,).  time_s: (T,) [s] increasing.  values: (T,), nan where unknown.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(at_s), np.nan)
    t = time_s[known]
    found = np.interp(at_s, t, values[known], left=np.nan, right=np.nan)
    if longest_s == np.inf:
        return found
    after = np.minimum(np.searchsorted(t, at_s), t.size - 1)
    before = np.maximum(after - 1, 0)
    return np.where((t[after] - t[before] <= longest_s) | (t[after] == at_s), found, np.nan)


def between(time_s: np.ndarray, values: np.ndarray, longest_s: float = np.inf) -> np.ndarray:
    """The values (T,) with straight lines over nan, as `interpolated`."""
    return values if np.isfinite(values).all() else interpolated(time_s, time_s, values, longest_s)


def from_to(time_s: np.ndarray) -> str:
    """Time span of a run in words: "from 12.5 s to 80 s"."""
    first, last = (f"{at_s:.4g}" if abs(at_s) < 1e4 else f"{at_s:.0f}" for at_s in (time_s[0], time_s[-1]))
    return f"from {first} s to {last} s"


def duration(seconds: float) -> str:
    """A length of time in its natural unit: "12.5 s", "42 min", "9 h 25 min"; "-" where it is not known."""
    if not math.isfinite(seconds):
        return "-"
    if seconds < 120:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


def _ends(condition: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First indices of the runs, and those after their last."""
    padded = np.concatenate([[False], np.asarray(condition, dtype=bool), [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges[::2], edges[1::2]
