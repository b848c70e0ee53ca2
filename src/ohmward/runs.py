"""Runs of a condition along a log."""

from __future__ import annotations

import numpy as np


def runs(condition: np.ndarray) -> list[tuple[int, int]]:
    """First index and the one after the last of every run of True in a condition (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], condition, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
