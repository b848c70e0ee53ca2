"""Wheel speeds from encoder counts, through the overflow of the counter."""

from __future__ import annotations

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError


def wheel_speeds(counts: np.ndarray, time_s: np.ndarray, counts_per_turn: float, bits: int = 32) -> np.ndarray:
    """Mean speed (T, wheels) [rad/s] of each wheel since the count before; nan in the first row and where dt <= 0.

    counts: (T, wheels) whole numbers, of a counter that starts again after `bits` bits, signed or not.
    time_s: (T,) of each row.

    Raises:
        InputError: counts that are not (T, wheels), or impossible settings.
    """
    counts, time_s = np.asarray(counts), np.asarray(time_s, dtype=float)
    if counts.ndim != 2 or len(counts) != len(time_s):
        raise InputError(f"counts must be (T, wheels) with T = {len(time_s)} times, got shape {counts.shape}")
    require_positive("counts_per_turn", counts_per_turn)
    if not 8 <= bits <= 63:
        raise InputError(f"bits must be between 8 and 63, got {bits}")
    speeds = np.full(counts.shape, np.nan)
    dt_s = np.diff(time_s)
    good = dt_s > 0
    turns = differences(counts, bits)[good] / counts_per_turn
    speeds[1:][good] = 2 * np.pi * turns / dt_s[good, None]
    return speeds


def differences(counts: np.ndarray, bits: int) -> np.ndarray:
    """Counts (T - 1, wheels) since the row before, taken the short way round the counter."""
    half = 1 << (bits - 1)
    return np.mod(np.diff(counts.astype(np.int64), axis=0) + half, 2 * half) - half
