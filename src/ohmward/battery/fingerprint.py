"""Fingerprint of a log, by which a battery file recognises the measurements that it has learnt from.

Means of voltage and current over bins of equal length. A part of the log has the same means as the whole, whatever the
zero of its clock, and a log of every tenth sample nearly so: both are found by shifting one against the other.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.logs.log import Log

#: Bins of a log, and their shortest and longest length: a fingerprint of a day has 96 numbers, of ten days 960.
_BINS = 48
_SHORTEST_BIN_S, _LONGEST_BIN_S = 30.0, 1800.0
#: Fewest samples in a bin, and fewest bins of a log, however short it is.
_SAMPLES_PER_BIN = 4
_FEWEST_BINS = 8
#: Levels of a mean between the lowest and the highest of its log: two bytes.
_LEVELS = 65535
#: Levels by which rounding makes the means of the same samples differ.
_ROUNDING_LEVELS = 3.0
#: Share of the bins in which means of the same samples may differ: at the ends and where single samples were repaired.
_MOST_OTHER_BINS = 0.2
#: Log odds above which two logs are the same: e^25 against a thousand logs with ten thousand shifts each.
_CERTAIN_LOG_ODDS = 25.0
#: Sampling intervals that differ by less than this share are equal: then only identical samples are the same log.
_SAME_INTERVAL = 0.05
#: Wall clocks of one log agree to within this time; a network moves the clock that it sets by less.
_SAME_CLOCK_S = 120.0
#: Step between the shifts tried first, in bins, number of shifts that are refined, and steps of each refinement.
_SHIFT_BINS = 0.125
_REFINED = 32
_NEAREST_STEPS = 8
#: Numbers processed at once: 16 MB.
_NUMBERS_AT_ONCE = 2_000_000


class LogProfile(NamedTuple):
    """Content of a fingerprint."""

    #: length of a bin, and median interval of the samples
    bin_s: float
    interval_s: float
    start_unix_s: float  #: wall clock of the first sample, NaN where there is none
    means: np.ndarray  #: (2, n) mean voltage [V] and current [A] of each bin
    level: np.ndarray  #: (2, 1) their resolution

    @property
    def duration_s(self) -> float:
        """Length of the log."""
        return self.bin_s * self.means.shape[1]


class LogIntegrals(NamedTuple):
    """Time integrals of voltage and current from the first sample on."""

    time_s: tuple[np.ndarray, np.ndarray]  #: times of the samples of each, from the first sample of the log
    total: tuple[np.ndarray, np.ndarray]  #: their integrals there
    duration_s: float  #: of the log

    def means(self, edges_s: np.ndarray) -> np.ndarray:
        """(2, ..., n) means between neighbours of the edges (..., n + 1), as far as they lie within the log."""
        inside_s = np.clip(edges_s, 0.0, self.duration_s)
        total = np.stack([np.interp(inside_s, *one) for one in zip(self.time_s, self.total, strict=True)])
        return np.diff(total, axis=-1) / np.maximum(np.diff(inside_s, axis=-1), 1e-9)


def fingerprint(log: Log) -> str:
    """Fingerprint of a log in base 64, 100 to 400 characters for a drive or a day; "" for a log of one instant."""
    return "" if log.duration_s <= 0 else _packed(_profile(log))


def unlearnt_parts(log: Log, fingerprints: Iterable[str]) -> tuple[Log, ...]:
    """The parts of the log that are in none of the logs with these fingerprints, in order of time; () for none."""
    seen = [overlap for text in fingerprints if (overlap := overlap_s(log, text)) is not None]
    if not seen:
        return (log,)
    gaps = _complement(seen, log.duration_s, _bin_s(log))
    return tuple(log.between(log.time_s[0] + start, log.time_s[0] + stop) for start, stop in gaps)


def overlap_s(log: Log, text: str) -> tuple[float, float] | None:
    """Start and end, from the log's first sample, of the time that it shares with the log of a fingerprint, or None."""
    if not text or log.duration_s <= 0:
        return None
    seen, integrals = _unpacked(text), _integrals(log)
    shifts = [*_refine(integrals, seen, _likely_shifts(integrals, seen)), *_clock_shift(seen, log)]
    odds = [_log_odds(integrals, seen, log, shift) for shift in shifts]
    if not odds or max(odds) < _CERTAIN_LOG_ODDS:
        return None
    best = shifts[int(np.argmax(odds))]
    return max(float(best), 0.0), min(float(best) + seen.duration_s, log.duration_s)


def _bin_s(log: Log) -> float:
    """Length of a bin that divides the log evenly."""
    usual = np.clip(log.duration_s / _BINS, _SHORTEST_BIN_S, _LONGEST_BIN_S)
    wanted = max(usual, _SAMPLES_PER_BIN * float(np.median(log.dt_s)))
    return log.duration_s / max(round(log.duration_s / wanted), _FEWEST_BINS)


def _profile(log: Log) -> LogProfile:
    bin_s = _bin_s(log)
    means = _integrals(log).means(np.linspace(0.0, log.duration_s, round(log.duration_s / bin_s) + 1))
    level = np.maximum(np.ptp(means, axis=1, keepdims=True) / _LEVELS, 1e-7)
    begin_unix_s = math.nan if log.begin_unix_s is None else log.begin_unix_s
    return LogProfile(bin_s, float(np.median(log.dt_s)), begin_unix_s, means, level)


def _integrals(log: Log) -> LogIntegrals:
    times, totals = [], []
    for values in (log.voltage_V, log.current_A):
        known = np.isfinite(values)
        time_s, values = log.time_s[known] - log.time_s[0], values[known]
        areas = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)
        times.append(time_s if time_s.size else np.zeros(1))
        totals.append(np.concatenate([[0.0], np.cumsum(areas)]))
    return LogIntegrals((times[0], times[1]), (totals[0], totals[1]), log.duration_s)


def _packed(profile: LogProfile) -> str:
    """Three numbers, lowest mean and level of each quantity as doubles; then the means in levels, two bytes each."""
    lowest = profile.means.min(axis=1, keepdims=True)
    head = [profile.bin_s, profile.interval_s, profile.start_unix_s, *lowest[:, 0], *profile.level[:, 0]]
    levels = np.rint((profile.means - lowest) / profile.level)
    data = np.array(head, "<f8").tobytes() + levels.astype("<u2").tobytes()
    return base64.b64encode(data).decode("ascii")


def _unpacked(text: str) -> LogProfile:
    data = base64.b64decode(text)
    head = np.frombuffer(data, "<f8", 7)
    levels = np.frombuffer(data, "<u2", offset=7 * 8).reshape(2, -1)
    lowest, level = head[3:5, None], head[5:7, None]
    return LogProfile(float(head[0]), float(head[1]), float(head[2]), lowest + level * levels, level)


def _spread(seen: LogProfile) -> np.ndarray:
    """(2, 1) standard deviation of the means over their log, no less than their level."""
    return np.maximum(seen.means.std(axis=1, keepdims=True), seen.level)


def _edges(seen: LogProfile, shift_s: np.ndarray) -> np.ndarray:
    """(K, n + 1) edges of the bins after the shifts (K,)."""
    return shift_s[:, None] + seen.bin_s * np.arange(seen.means.shape[1] + 1)


def _inside(edges_s: np.ndarray, duration_s: float) -> np.ndarray:
    """(..., n) bins that lie within the log; a thousandth of a bin may lie outside, from rounding of the times."""
    slack = 1e-3 * (edges_s[..., 1:2] - edges_s[..., :1])
    return (edges_s[..., :-1] >= -slack) & (edges_s[..., 1:] <= duration_s + slack)


def _likely_shifts(integrals: LogIntegrals, seen: LogProfile) -> np.ndarray:
    """Shifts [s] at which the log looks most like the one seen, one for each peak of the likelihood."""
    step = _SHIFT_BINS * seen.bin_s
    shifts = np.arange(seen.bin_s - seen.duration_s, integrals.duration_s - 0.5 * seen.bin_s, step)
    shifts = np.union1d(shifts, [0.0, integrals.duration_s - seen.duration_s])
    parts = np.array_split(shifts, 1 + shifts.size * seen.means.shape[1] // _NUMBERS_AT_ONCE)
    found = np.concatenate([_likelihood(integrals, seen, part) for part in parts])
    rim = np.concatenate([[-np.inf], found, [-np.inf]])
    peaks = np.flatnonzero((found >= rim[:-2]) & (found >= rim[2:]))
    return shifts[peaks[np.argsort(-found[peaks])[:_REFINED]]]


def _likelihood(integrals: LogIntegrals, seen: LogProfile, shift_s: np.ndarray) -> np.ndarray:
    """(K,) logarithm of the likelihood of each shift, its error of half a step and of sampling included."""
    edges = _edges(seen, shift_s)
    inside = _inside(edges, integrals.duration_s)
    squares = ((integrals.means(edges) - seen.means[:, None]) / _spread(seen)[:, None]) ** 2
    count = inside.sum(axis=1)
    mean = (squares.mean(axis=0) * inside).sum(axis=1) / np.maximum(count, 1)
    return -count * np.log(mean + 0.02)


def _refine(integrals: LogIntegrals, seen: LogProfile, shifts: np.ndarray) -> np.ndarray:
    """The shifts (K,) moved to the nearest least-squares minimum by Gauss-Newton steps of at most a bin."""
    width = 1e-3 * seen.bin_s
    for _ in range(_NEAREST_STEPS):
        edges = _edges(seen, shifts)
        inside = _inside(edges, integrals.duration_s)
        error = (integrals.means(edges) - seen.means[:, None]) / _spread(seen)[:, None] * inside
        rise = (integrals.means(edges + width) - integrals.means(edges - width)) / (2 * width)
        slope = rise / _spread(seen)[:, None] * inside
        size = np.maximum((slope**2).sum(axis=(0, 2)), 1e-30)
        shifts = shifts - np.clip((slope * error).sum(axis=(0, 2)) / size, -seen.bin_s, seen.bin_s)
    return shifts


def _log_odds(integrals: LogIntegrals, seen: LogProfile, log: Log, shift_s: float) -> float:
    """Logarithm of the odds that at this shift both are the same log; -inf where they are not.

    Each bin that agrees within sigma counts log(S / sigma), S being the spread of the means over their log: the log of
    a battery that rests all day matches nothing in particular.
    """
    edges = _edges(seen, np.array([shift_s]))[0]
    inside = _inside(edges, integrals.duration_s)
    if not inside.any():
        return -np.inf
    error = np.abs(integrals.means(edges) - seen.means)[:, inside]
    odds = -np.inf
    for sigma in _tolerances(seen, log, shift_s, edges)[:, :, inside]:
        same = (error < 4 * sigma).all(axis=0)
        if same.mean() >= 1 - _MOST_OTHER_BINS:
            gain = np.log(np.maximum(_spread(seen) / sigma, 1.0)) - 0.5 * (error / sigma) ** 2
            odds = max(odds, float(gain[:, same].sum()))
    return odds


def _tolerances(seen: LogProfile, log: Log, shift_s: float, edges_s: np.ndarray) -> np.ndarray:
    """(M, 2, n) standard deviations by which the means of the same log may differ: with identical samples, or fewer.

    A mission that is driven twice shows nearly the same means; at equal sampling intervals, or on different days by the
    clock, only identical samples are the same log.
    """
    exact = np.broadcast_to(_ROUNDING_LEVELS * seen.level, seen.means.shape)
    intervals_s = sorted((seen.interval_s, float(np.median(log.dt_s))))
    clocks_differ = any(abs(other_s - shift_s) > _SAME_CLOCK_S for other_s in _clock_shift(seen, log))
    if intervals_s[1] < (1 + _SAME_INTERVAL) * intervals_s[0] or clocks_differ:
        return exact[None]
    lag = max(1, round(intervals_s[1] / float(np.median(log.dt_s))))
    sampling = np.stack([_change_in_bins(log, values, lag, edges_s) for values in (log.voltage_V, log.current_A)])
    return np.stack([exact, np.hypot(exact, sampling * np.sqrt(intervals_s[1] / seen.bin_s))])


def _clock_shift(seen: LogProfile, log: Log) -> list[float]:
    """Shift by the wall clocks, where both logs have one."""
    if log.begin_unix_s is None or not np.isfinite(seen.start_unix_s):
        return []
    return [seen.start_unix_s - log.begin_unix_s]


def _change_in_bins(log: Log, values: np.ndarray, lag: int, edges_s: np.ndarray) -> np.ndarray:
    """(n,) root mean square of the change over `lag` samples in each bin, over sqrt(2); 0 in a bin without samples."""
    change = values[lag:] - values[:-lag]
    known = np.isfinite(change)
    bins = np.searchsorted(edges_s, (log.time_s[lag:] - log.time_s[0])[known], side="right") - 1
    inside = (bins >= 0) & (bins < edges_s.size - 1)
    count = np.bincount(bins[inside], minlength=edges_s.size - 1)
    squares = np.bincount(bins[inside], change[known][inside] ** 2, edges_s.size - 1)
    return np.sqrt(0.5 * squares / np.maximum(count, 1))


def _complement(seen: Sequence[tuple[float, float]], duration_s: float, least_s: float) -> list[tuple[float, float]]:
    """The times from 0 to the end that none of the intervals covers, those shorter than `least_s` left out."""
    parts, begin = [], 0.0
    for start, stop in [*sorted(seen), (duration_s, duration_s)]:
        if start - begin >= least_s:
            # the sample at the end of the log belongs to its last part
            parts.append((begin, np.inf if start == duration_s else start))
        begin = max(begin, stop)
    return parts
