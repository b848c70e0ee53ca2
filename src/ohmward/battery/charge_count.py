"""Charge between the samples of a log: that of the current and, where there is one, of a charge counter."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.noise import path_std_A
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log, Note, counted

#: A gap in the recording is longer than this [s], and than this many median intervals.
RECORDING_GAP_S = 120.0
_GAP_INTERVALS = 20.0
#: Longest interval, in medians, that is used to compare a counter with the current.
_USUAL_INTERVALS = 3.0
#: A counter's slope over the integral of the current is 1 to within this, from sums over this many blocks.
_COUNTER_TOLERANCE = 0.05
_BLOCKS = 200
#: Intervals of a block, over which the charge is made to match the counter.
_BLOCK_INTERVALS = 100
#: Gain error of a current sensor: the error of an interval in which the current does not change.
_GAIN_ERROR = 1e-3


class ChargeIntegral(NamedTuple):
    """Charge of each interval between two samples; every array belongs to the interval that ends at the sample."""

    moved_Ah: np.ndarray  #: (T,) [Ah], > 0 when charge went in; the first is 0
    unknown: np.ndarray  #: (T,) bool, a gap during which an unknown charge may have flowed; moved_Ah is 0 there
    notes: tuple[Note, ...] = ()  #: on intervals whose charge the current does not show
    counted: bool = False  #: True where a charge counter has shown it

    @property
    def total_Ah(self) -> np.ndarray:
        """(T,) charge since the first sample [Ah]."""
        return np.cumsum(self.moved_Ah)


class Counter(NamedTuple):
    """A charge counter among the log's columns."""

    name: str  #: of the column, or "a - b"
    step_Ah: np.ndarray  #: (T,) its change over each interval, resets taken out, > 0 when charge went in
    resolution_Ah: float  #: the smallest change that it shows


def count_charge(log: Log) -> ChargeIntegral:
    """Charge of each interval of the log: the mean of both currents, corrected by a charge counter if there is one.

    Where the current changes by di within an interval dt, the charge by the mean of both is wrong by up to |di| dt/2,
    and in a gap of the recording it is unknown. A counter column that agrees with the current elsewhere settles both:
    its difference from the integral is spread over the intervals in proportion to that error.

    Raises:
        InputError: the log has no current.
    """
    current_A = known_current_A(log)
    dt_s = np.diff(log.time_s, prepend=log.time_s[0])
    moved_Ah = dt_s * 0.5 * (current_A + np.concatenate([current_A[:1], current_A[:-1]])) / SECONDS_PER_HOUR
    error_Ah = dt_s * 0.5 * np.abs(np.diff(current_A, prepend=current_A[0])) / SECONDS_PER_HOUR
    gap = find_gaps(log.time_s)
    counter = find_counter(log, moved_Ah, gap)
    if counter is None:
        note = Note(f"{counted(int(gap.sum()), 'gap')} without a charge counter: what flowed there is not known")
        return ChargeIntegral(np.where(gap, 0.0, moved_Ah), gap, (note,) if gap.any() else ())
    settled_Ah = np.where(gap, counter.step_Ah, _settle(moved_Ah, error_Ah, gap, counter.step_Ah))
    return ChargeIntegral(settled_Ah, np.zeros_like(gap), (_counter_note(counter, settled_Ah - moved_Ah, gap),), True)


def require_followed(log: Log) -> None:
    """Raise InputError where more charge may flow unseen between the rows of a log than they show, in rms over them.

    Resistances that are fitted to such currents are far too small: a drive sampled every half minute gave a third of
    them, with a band as narrow as from a row a second. Means since the row before would do, but nothing in a log tells
    them from samples. A column that counts the charge is not looked at: where there is one, do not ask.
    """
    known = np.isfinite(log.current_A)
    time_s, current_A = log.time_s[known], log.current_A[known]
    recorded = ~find_gaps(time_s)[1:]
    dt_s, change_A = np.diff(time_s)[recorded], np.diff(current_A)[recorded]
    mean_A = (0.5 * (current_A[1:] + current_A[:-1]))[recorded]
    missed_As, counted_As = dt_s * path_std_A(change_A, dt_s), dt_s * mean_A
    if np.sum(missed_As**2) > np.sum(counted_As**2):
        raise InputError(
            f"{log.name}: its rows are {np.median(dt_s):.3g} s apart, and its current changes so much from one to the "
            "next that more charge may have flowed between them than they show; log a row a second"
        )


def known_current_A(log: Log) -> np.ndarray:
    """(T,) current [A]; single samples without one are bridged by a straight line, see `without_unknown_current`."""
    known = np.isfinite(log.current_A)
    if not known.any() or not np.any(log.current_A[known]):
        raise InputError(f"log {log.name!r}: the current is never other than zero; nothing can be identified from it")
    return np.interp(log.time_s, log.time_s[known], log.current_A[known])


def without_unknown_current(log: Log) -> Log:
    """The log without the samples of long stretches without a current, which become gaps of the recording.

    Those at its ends are left out as well: no current is known beyond them.
    """
    known = np.flatnonzero(np.isfinite(log.current_A))
    if not known.size:
        return log
    used = np.zeros(len(log), dtype=bool)
    used[known[0] : known[-1] + 1] = True
    for k in np.flatnonzero(np.diff(log.time_s[known]) > RECORDING_GAP_S):
        used[known[k] + 1 : known[k + 1]] = False
    return log if used.all() else log.select(used)


def find_gaps(time_s: np.ndarray) -> np.ndarray:
    """(T,) bool: True where the interval that ends at the sample is a gap, over 120 s and 20 median intervals."""
    dt_s = np.diff(time_s)
    if not dt_s.size:
        return np.zeros(time_s.size, dtype=bool)
    return np.concatenate([[False], dt_s > max(RECORDING_GAP_S, _GAP_INTERVALS * float(np.median(dt_s)))])


def begins_interval(number: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(T,) bool: True for the first sample of each numbered interval, for the last one, and at both ends of a gap.

    number: (T,) of the interval in which a sample lies; gap: (T,) bool, True for the first sample after a gap.
    """
    begins = np.concatenate([[True], number[1:] != number[:-1]]) | gap
    begins[:-1] |= gap[1:]
    begins[-1] = True
    return begins


def find_counter(log: Log, moved_Ah: np.ndarray, gap: np.ndarray) -> Counter | None:
    """The charge counter among the log's extra columns that agrees with the current, or None.

    moved_Ah: (T,) integral of the current over each interval [Ah]; gap: (T,) bool, intervals where that is unknown.
    """
    dt_s = np.diff(log.time_s, prepend=log.time_s[0])
    usable = ~gap & (dt_s <= _USUAL_INTERVALS * np.median(dt_s))
    for name, values_Ah in _candidates(log.extra).items():
        if not np.isfinite(values_Ah).all():
            continue
        step_Ah = _without_resets(values_Ah, moved_Ah, gap)
        slope = _slope(step_Ah, moved_Ah, usable)
        step_Ah = np.sign(slope) * step_Ah
        if abs(abs(slope) - 1.0) < _COUNTER_TOLERANCE and _counts_both_ways(step_Ah, moved_Ah, gap):
            return Counter(name, step_Ah, _resolution(values_Ah))
    return None


def _candidates(extra: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns that count charge by their names, in Ah; pairs for charge and discharge first."""
    found = {name: scale * extra[name] for name in extra if (scale := _ampere_hours(name))}
    into = [n for n in found if re.search(r"(?<!dis)(ch(ar)?g(e|ing)?)", n.lower())]
    out_of = [n for n in found if re.search(r"dis", n.lower())]
    pairs = {f"{a} - {b}": found[a] - found[b] for a in into for b in out_of if a != b}
    return pairs | found


def _ampere_hours(name: str) -> float:
    """Unit of a column in Ah, by its name; 0 for a column that is no charge."""
    words = re.split(r"[^a-z]+", name.lower())
    return 1e-3 if "mah" in words else 1.0 if "ah" in words else 0.0


def _without_resets(values_Ah: np.ndarray, moved_Ah: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(T,) change over each interval; where the counter started again from zero, its value since then."""
    before = np.concatenate([values_Ah[:1], values_Ah[:-1]])
    step = values_Ah - before
    unlike = np.abs(np.abs(step) - np.abs(moved_Ah)) > 0.1 * np.abs(before) + np.abs(moved_Ah)
    return np.where(unlike & ~gap & (np.abs(values_Ah) < 0.5 * np.abs(before)), values_Ah, step)


def _slope(step_Ah: np.ndarray, moved_Ah: np.ndarray, usable: np.ndarray) -> float:
    """Slope of the counter over the integral of the current, from sums over blocks, in which rounding averages out."""
    blocks = [rows for rows in np.array_split(np.flatnonzero(usable), _BLOCKS) if rows.size]
    counted_Ah = np.array([step_Ah[rows].sum() for rows in blocks])
    integral_Ah = np.array([moved_Ah[rows].sum() for rows in blocks])
    return float(counted_Ah @ integral_Ah / max(integral_Ah @ integral_Ah, 1e-300))


def _counts_both_ways(step_Ah: np.ndarray, moved_Ah: np.ndarray, gap: np.ndarray) -> bool:
    """False for a counter of throughput, which grows in both directions, where both have a share in the charge."""
    both = [way & ~gap for way in (moved_Ah > 0, moved_Ah < 0)]
    sums = [(float(np.abs(moved_Ah[way]).sum()), float(np.sign(moved_Ah[way]) @ step_Ah[way])) for way in both]
    least_Ah = _COUNTER_TOLERANCE * sum(flowed_Ah for flowed_Ah, _ in sums)
    return all(counted_Ah > 0.5 * flowed_Ah for flowed_Ah, counted_Ah in sums if flowed_Ah > least_Ah)


def _resolution(values_Ah: np.ndarray) -> float:
    """The smallest change apart from rounding in the file."""
    steps = np.abs(np.diff(values_Ah))
    steps = steps[steps > 1e-9 * np.ptp(values_Ah)]
    return float(np.quantile(steps, 0.01)) if steps.size else 0.0


def _settle(moved_Ah: np.ndarray, error_Ah: np.ndarray, gap: np.ndarray, step_Ah: np.ndarray) -> np.ndarray:
    """(T,) charge of each interval: the integral, corrected to the counter's sum in each block of intervals."""
    weight = np.where(gap, 0.0, error_Ah + _GAIN_ERROR * np.abs(moved_Ah))
    starts = np.arange(0, moved_Ah.size, _BLOCK_INTERVALS)
    missing_Ah = np.add.reduceat(np.where(gap, 0.0, step_Ah - moved_Ah), starts)
    share = missing_Ah / np.maximum(np.add.reduceat(weight, starts), 1e-300)
    return moved_Ah + weight * np.repeat(share, _BLOCK_INTERVALS)[: moved_Ah.size]


def _counter_note(counter: Counter, correction_Ah: np.ndarray, gap: np.ndarray) -> Note:
    text = (
        f"charge counter {counter.name!r} (resolution {counter.resolution_Ah:.2g} Ah) agrees with the current and "
        f"settles what the samples leave open: {np.abs(correction_Ah[~gap]).sum():.3g} Ah between samples"
    )
    return Note(f"{text}, {np.abs(correction_Ah[gap]).sum():.3g} Ah in {counted(int(gap.sum()), 'gap')}")
