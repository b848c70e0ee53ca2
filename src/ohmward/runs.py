"""Runs of a condition along a log."""

from __future__ import annotations

import numpy as np


def runs(condition: np.ndarray) -> list[tuple[int, int]]:
    """First index and the one after the last of every run of True in a condition (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], condition, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def long_runs(condition: np.ndarray, time_s: np.ndarray, least_s: float, fewest: int = 1) -> list[tuple[int, int]]:
    """The `runs` that last so long from their first to their last sample, and have so many.

    condition, time_s: (T,).
    """
    found = runs(condition)
    return [(a, b) for a, b in found if b - a >= fewest and time_s[b - 1] - time_s[a] >= least_s]
