"""Statistics of one signal: range, resolution, white noise; of a time, its intervals and gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: An interval that is longer than its neighbours and the median by this factor is a gap, unless at least this many and
#: this share of all are: then several sensors report in turn.
_GAP_FACTOR, _FEWEST_OF_A_RHYTHM, _RHYTHM = 10.0, 20, 0.1
#: Fewer second differences than these give no robust standard deviation.
_NOISE_LEAST = 20
#: Approximate number of intervals from which the usual one is found.
_INTERVALS_LOOKED_AT = 10_000


@dataclass(frozen=True)
class Sampling:
    """Intervals between samples [s]; a gap is more than ten times the usual interval."""

    median_s: float
    shortest_s: float
    longest_s: float
    irregularity: float  #: share of the intervals that differ from the median by more than a tenth
    gaps: int
    longest_gap_s: float


@dataclass(frozen=True)
class Signal:
    """Range, resolution and white noise of one quantity, in its own unit."""

    minimum: float
    maximum: float
    missing: int  #: number of NaN samples
    levels: int  #: number of distinct values
    resolution: float  #: smallest step between two of them
    noise_std: float

    @property
    def largest(self) -> float:
        """Largest magnitude."""
        return max(abs(self.minimum), abs(self.maximum))


def sampling_of(time_s: np.ndarray) -> Sampling:
    """Statistics of the intervals of a time (T,) [s]."""
    dt = np.diff(time_s)
    if not dt.size:
        return Sampling(0.0, 0.0, 0.0, 0.0, 0, 0.0)
    median = float(np.median(dt))
    gaps = find_gaps(time_s)
    return Sampling(
        median_s=median,
        shortest_s=float(dt.min()),
        longest_s=float(dt.max()),
        irregularity=float(np.mean(np.abs(dt - median) > 0.1 * median)),
        gaps=int(gaps.size),
        longest_gap_s=float(dt[gaps].max(initial=0.0)),
    )


def signal_of(values: np.ndarray, resting: np.ndarray) -> Signal:
    """Statistics of values (T,), some of them finite.

    resting: (T,) bool; the noise is estimated at rest if that is long enough, because a working current is not noise.
    """
    known = values[np.isfinite(values)]
    at_rest = np.where(resting, values, np.nan)
    enough = np.isfinite(np.diff(at_rest, n=2)).sum() >= _NOISE_LEAST
    return Signal(
        minimum=float(known.min()),
        maximum=float(known.max()),
        missing=int(values.size - known.size),
        levels=int(np.unique(known).size),
        resolution=resolution(known),
        noise_std=float(noise_std(at_rest if enough else values)),
    )


def noise_std(values: np.ndarray) -> float:
    """White-noise standard deviation from second differences, blind to slow changes and, being robust, to a few steps.

    For white noise, x[i-1] - 2 x[i] + x[i+1] has six times its variance. Not below rounding, resolution / sqrt(12).

    values: (T,), NaN allowed.
    """
    known = values[np.isfinite(values)]
    return max(spread(np.diff(known, n=2)) / math.sqrt(6.0), resolution(known) / math.sqrt(12.0))


def find_gaps(time_s: np.ndarray) -> np.ndarray:
    """(G,) indices of the samples after which the log is silent for unusually long.

    A gap is more than ten times the median interval and more than ten times the intervals on both sides of it: where a
    logger slows down at rest, one long interval follows another, and that is no gap; nor is one that recurs all the
    time between the rows of sensors that report in turn.

    time_s: (T,) [s].
    """
    intervals = np.diff(time_s)
    if intervals.size < 2 or intervals.max() <= _GAP_FACTOR * intervals.min():
        return np.empty(0, dtype=int)
    long = np.flatnonzero(intervals > _GAP_FACTOR * np.median(intervals))
    before = np.where(long > 0, intervals[long - 1], 0.0)
    after = np.where(long < intervals.size - 1, intervals[(long + 1) % intervals.size], 0.0)
    gaps = long[intervals[long] > _GAP_FACTOR * np.maximum(before, after)]
    is_rhythm = gaps.size >= max(_FEWEST_OF_A_RHYTHM, _RHYTHM * intervals.size)
    return np.empty(0, dtype=int) if is_rhythm else gaps


def usual_interval_s(time_s: np.ndarray) -> float:
    """Median of the intervals between samples of a time (T,), T > 1."""
    some = np.arange(0, time_s.size - 1, -(-time_s.size // _INTERVALS_LOOKED_AT))
    return float(np.median(time_s[some + 1] - time_s[some]))


def spread(values: np.ndarray) -> float:
    """Robust standard deviation, 1.4826 times the median absolute deviation; 0 for an empty array."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values)))) if values.size else 0.0


def running_median(values: np.ndarray, count: int) -> np.ndarray:
    """(T,) median of each value and its neighbours, `count` in all, an odd number; the ends are repeated."""
    padded = np.pad(values, count // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, count), axis=1)


def resolution(values: np.ndarray) -> float:
    """Smallest step between distinct values (T,), no NaN; 0 where they are all equal.

    Steps below 1e-6 of the range are rounding of a float32 or of a sum, not of the instrument.
    """
    distinct = np.unique(values)
    steps = np.diff(distinct)
    real = steps[steps > 1e-6 * max(np.ptp(distinct), abs(distinct).max())] if steps.size else steps
    return float(real.min()) if real.size else 0.0
