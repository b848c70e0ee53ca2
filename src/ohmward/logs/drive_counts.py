"""Wheel speeds from the counts of encoders, through the roll-over of their counters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.logs.clean import find_gaps

#: Widths of counters that roll over within a drive.
WIDTHS = (8, 16, 32)


class Counted(NamedTuple):
    """What the encoder of a wheel says.

    speed_rad_s: (T,) mean since the count before, NaN in rows without a new count and after gaps.
    bits: of the counter, None where it never rolled over.
    rollovers: how often it did.
    """

    speed_rad_s: np.ndarray
    bits: int | None
    rollovers: int


def speed_from_counts(counts: np.ndarray, time_s: np.ndarray, counts_per_turn: float) -> Counted:
    """The speed of a wheel from its encoder.

    counts: (T,) whole numbers, NaN where nothing new.  time_s: (T,) [s], increasing.
    counts_per_turn: of the wheel, > 0.
    """
    known = np.flatnonzero(np.isfinite(counts))
    steps, values = np.diff(counts[known]), counts[known]
    bits = counter_bits(values)
    if bits is not None:
        steps = np.mod(steps + 2.0 ** (bits - 1), 2.0**bits) - 2.0 ** (bits - 1)
    speed = np.full(counts.size, np.nan)
    speed[known[1:]] = 2 * math.pi / counts_per_turn * steps / np.diff(time_s[known])
    speed[known[1:][find_gaps(time_s[known])]] = np.nan
    rolled = int(np.count_nonzero(steps != np.diff(values)))
    return Counted(speed, bits if rolled else None, rolled)


def counter_bits(counts: np.ndarray) -> int | None:
    """Width of the counter that fits its values (N,) and jumps over half of its range; None if none does.

    A counter of b bits shows 0 to 2^b - 1, or with a sign -2^(b-1) to 2^(b-1) - 1.
    """
    if counts.size < 2:
        return None
    low, high, jump = counts.min(), counts.max(), np.abs(np.diff(counts)).max()
    for bits in WIDTHS:
        span = 2.0**bits
        if (low >= 0 and high < span) or (-span / 2 <= low and high < span / 2):
            return bits if jump > span / 2 else None
    return None
