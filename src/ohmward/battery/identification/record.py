"""Record: a log with its charge, its phases and the kind of test, divided at gaps of unknown charge.

The charge between the samples is that of the current and, where there is one, of a charge counter. Phases are rests,
pulses, constant and varying currents, on any sampling.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.anchor_rule import REST_C
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
        return ChargeIntegral(np.where(gap, 0.0, moved_Ah), gap, _gap_notes(gap))
    settled_Ah = np.where(gap, counter.step_Ah, _settle(moved_Ah, error_Ah, gap, counter.step_Ah))
    return ChargeIntegral(settled_Ah, np.zeros_like(gap), (_counter_note(counter, settled_Ah - moved_Ah, gap),))


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
        if abs(abs(slope) - 1.0) < _COUNTER_TOLERANCE:
            return Counter(name, np.sign(slope) * step_Ah, _resolution(values_Ah))
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


def _gap_notes(gap: np.ndarray) -> tuple[Note, ...]:
    if not gap.any():
        return ()
    return (Note(f"{counted(int(gap.sum()), 'gap')} without a charge counter: what flowed there is not known"),)


#: Rates relative to 1 C: largest of a low-rate test, smallest of a pulse.
LOW_RATE = 1 / 15
PULSE_RATE = 1 / 20
#: Durations of a pulse and of the rest before it [s].
LONGEST_PULSE_S = 400.0
SHORTEST_REST_S = 10.0
#: Samples of the shortest log that may hold a pulse and its rest.
FEWEST_OF_A_PULSE = 5
#: A jump of the current exceeds this rate and this share of it; a constant current stays within the last share.
_JUMP_RATE = 1 / 50
_JUMP_SHARE = 0.05
_CONSTANT_SHARE = 0.1
#: Smallest share of the charge moved slowly in a low-rate test, largest moved by varying currents in a pulse test.
_LOW_RATE_SHARE = 0.6
_VARYING_SHARE = 0.2
#: Fewest pulses of a pulse test.
_FEWEST_PULSES = 3

Test = Literal["low-rate", "pulses", "dynamic"]


class Phase(NamedTuple):
    """Samples first ... last (both included) of one kind of current."""

    kind: Literal["rest", "constant", "varying"]
    first: int
    last: int
    current_A: float  #: its mean, > 0 charges
    duration_s: float  #: from the first to the last sample


def find_phases(log: Log, capacity_Ah: float, idle_current_A: float = 0.0) -> tuple[Phase, ...]:
    """The log cut into rests (within C/100 of the idle current), constant and varying currents, on any sampling.

    A current is constant while it jumps by less than 5 % (and C/50) from sample to sample and by 10 % in all.

    Raises:
        InputError: the log has no current, or is too short to hold a pulse.
    """
    if len(log) < FEWEST_OF_A_PULSE:
        raise InputError(
            f"log {log.name!r} has {len(log)} samples; a pulse and its rest need at least {FEWEST_OF_A_PULSE}"
        )
    current_A = known_current_A(log)
    rest = np.abs(current_A - idle_current_A) <= REST_C * capacity_Ah
    jump = np.abs(np.diff(current_A)) > np.maximum(_JUMP_SHARE * np.abs(current_A[1:]), _JUMP_RATE * capacity_Ah)
    new = (rest[1:] != rest[:-1]) | (jump & ~rest[1:])
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    last = np.append(first[1:], len(log)) - 1
    return _joined(log.time_s, current_A, rest[first], first, last)


def find_pulses(phases: Sequence[Phase], capacity_Ah: float) -> tuple[Phase, ...]:
    """Phases of constant current over C/20 that last up to 400 s and follow a rest of at least 10 s."""
    pairs = pairwise(phases)
    return tuple(b for a, b in pairs if is_rest(a) and is_pulse(b, capacity_Ah))


def find_rests(phases: Sequence[Phase], shortest_s: float) -> tuple[Phase, ...]:
    """Rests of at least `shortest_s` that follow a current."""
    pairs = pairwise(phases)
    return tuple(b for a, b in pairs if a.kind != "rest" and is_rest(b, shortest_s))


def is_rest(phase: Phase, shortest_s: float = SHORTEST_REST_S) -> bool:
    """True for a rest of at least `shortest_s`."""
    return phase.kind == "rest" and phase.duration_s >= shortest_s


def settled_ends(record: Record) -> tuple[tuple[Phase, int], ...]:
    """Rest at the start of a record and rests whose voltage has settled, each with the index of its last voltage."""
    rests = [*(p for p in record.phases[:1] if is_rest(p)), *find_rests(record.phases, SETTLED_REST_S)]
    known = np.isfinite(record.log.voltage_V)
    ends = [(p, p.first + np.flatnonzero(known[p.first : p.last + 1])) for p in rests]
    return tuple((p, int(measured[-1])) for p, measured in ends if measured.size)


def is_pulse(phase: Phase, capacity_Ah: float) -> bool:
    """True where current and duration are those of a pulse."""
    strong = abs(phase.current_A) >= PULSE_RATE * capacity_Ah
    return phase.kind == "constant" and strong and phase.last > phase.first and phase.duration_s <= LONGEST_PULSE_S


def kind_of_test(log: Log, charge: ChargeIntegral, phases: Sequence[Phase], capacity_Ah: float) -> Test:
    """Low-rate when most charge moved below C/15; pulses when at least 3 stand between rests; else dynamic."""
    moved_Ah = np.abs(charge.moved_Ah)
    dt_s = np.diff(log.time_s, prepend=log.time_s[0])
    slow = SECONDS_PER_HOUR * moved_Ah / np.where(dt_s > 0, dt_s, 1.0) < LOW_RATE * capacity_Ah
    if moved_Ah[slow].sum() > _LOW_RATE_SHARE * moved_Ah.sum():
        return "low-rate"
    varying_Ah = sum(moved_Ah[p.first : p.last + 1].sum() for p in phases if p.kind == "varying")
    pulses = len(find_pulses(phases, capacity_Ah))
    return "pulses" if pulses >= _FEWEST_PULSES and varying_Ah < _VARYING_SHARE * moved_Ah.sum() else "dynamic"


def _joined(
    time_s: np.ndarray, current_A: np.ndarray, rest: np.ndarray, first: np.ndarray, last: np.ndarray
) -> tuple[Phase, ...]:
    """Phases of the runs first ... last (N,); neighbouring runs of varying current are one phase."""
    low, high = np.minimum.reduceat(current_A, first), np.maximum.reduceat(current_A, first)
    steady = (high - low <= _CONSTANT_SHARE * np.maximum(np.abs(high), np.abs(low))) & (last > first)
    varying = ~rest & ~steady
    starts = np.flatnonzero(~(varying & np.concatenate([[False], varying[:-1]])))
    ends = np.append(starts[1:], first.size) - 1
    return tuple(
        Phase(
            "rest" if rest[a] else "varying" if varying[a] else "constant",
            int(first[a]),
            int(last[b]),
            float(current_A[first[a] : last[b] + 1].mean()),
            float(time_s[last[b]] - time_s[first[a]]),
        )
        for a, b in zip(starts, ends, strict=True)
    )


#: Largest relative difference of voltages in the same rest, and length of a rest whose voltage has settled [s]: a
#: minute after a pulse of 6 C it has yet to rise by as much as a discharge of 5 % would lower it.
_SAME_VOLTAGE = 0.003
SETTLED_REST_S = 600.0


class Record(NamedTuple):
    """A log with the charge of each interval, its phases and the kind of test."""

    log: Log
    charge: ChargeIntegral
    phases: tuple[Phase, ...]
    test: Test
    #: direction of the unrecorded charge before the record, -1 discharge, 1 charge, 0 unknown
    came_from: int = 0

    @property
    def current_A(self) -> np.ndarray:
        """(T,) current [A], > 0 charges, without holes."""
        return known_current_A(self.log)

    def typical_degC(self) -> float | None:
        """Median temperature of the log, or None."""
        values = self.log.temperature_degC
        return None if values is None or not np.isfinite(values).any() else float(np.nanmedian(values))


def make_records(log: Log, capacity_Ah: float, idle_current_A: float = 0.0) -> tuple[Record, ...]:
    """Charge, phases and kind of test of a log: one record, or several where gaps of unknown charge divide it.

    A gap does not divide the log where the battery has rested for 10 minutes before it, and rests at the same voltage
    (within 0.3 %) after it.

    Raises:
        InputError: no current in the log, or too short for a pulse.
    """
    log = without_unknown_current(log)
    record = _record(log, capacity_Ah, idle_current_A)
    divides = [k for k in np.flatnonzero(record.charge.unknown) if not _rests_through(record, int(k))]
    if not divides:
        return (record,)
    edges = [0, *(int(k) for k in divides), len(log)]
    parts = [log.select(slice(a, b)) for a, b in pairwise(edges) if b - a >= FEWEST_OF_A_PULSE]
    useful = [part for part in parts if np.any(np.nan_to_num(part.current_A)) and part.duration_s > 0]
    if not useful:
        raise InputError(f"log {log.name!r}: {counted(len(divides), 'gap')} of unknown charge leave no part to use")
    note = Note(
        f"{log.name!r} is divided at {counted(len(divides), 'gap')} in which an unknown charge may have flowed; "
        f"{len(useful)} of {len(parts)} parts are used, each with a state of charge of its own",
        "warning",
    )
    records = [_record(part, capacity_Ah, idle_current_A) for part in useful]
    if record.test == "pulses":  # a part of such a test is one, however few its pulses
        records = [part._replace(test="pulses") for part in records]
    records = [records[0], *(_after_gap(a, b) for a, b in pairwise(records))]
    first = records[0]
    return (first._replace(charge=first.charge._replace(notes=(note,))), *records[1:])


def _after_gap(before: Record, record: Record) -> Record:
    """The record with the direction of the charge in the gap before it, from the rest voltages on both sides.

    A voltage that had not settled before the gap shows it only where it moved against its relaxation.
    """
    if not (before.phases[-1].kind == record.phases[0].kind == "rest"):
        return record
    ends_V = before.log.voltage_V[np.isfinite(before.log.voltage_V)]
    starts_V = record.log.voltage_V[np.isfinite(record.log.voltage_V)]
    if not ends_V.size or not starts_V.size or abs(starts_V[0] - ends_V[-1]) <= _SAME_VOLTAGE * ends_V[-1]:
        return record
    direction = int(np.sign(starts_V[0] - ends_V[-1]))
    relaxing = 0 if is_rest(before.phases[-1], SETTLED_REST_S) else _relaxing(before)
    return record._replace(came_from=0 if direction == relaxing else direction)


def _relaxing(record: Record) -> int:
    """Direction in which the voltage relaxes at the end of the record, against the last current; 0 without one."""
    moved_Ah = record.charge.moved_Ah[: record.phases[-1].first + 1]
    flowed = moved_Ah[moved_Ah != 0.0]
    return -int(np.sign(flowed[-1])) if flowed.size else 0


def _record(log: Log, capacity_Ah: float, idle_current_A: float) -> Record:
    charge = count_charge(log)
    phases = find_phases(log, capacity_Ah, idle_current_A)
    return Record(log, charge, phases, kind_of_test(log, charge, phases, capacity_Ah))


def _rests_through(record: Record, k: int) -> bool:
    """True where a rest that had settled before the gap at sample k goes on after it at the same voltage."""
    time_s = record.log.time_s
    settled = any(
        p.kind == "rest" and p.first < k <= p.last and time_s[k - 1] - time_s[p.first] >= SETTLED_REST_S
        for p in record.phases
    )
    before_V, after_V = record.log.voltage_V[k - 1], record.log.voltage_V[k]
    return settled and bool(abs(after_V - before_V) <= _SAME_VOLTAGE * abs(before_V))


def reference_degC(records: Sequence[Record]) -> float:
    """Median of the typical temperatures of the records [degC], room temperature where none is known."""
    known_degC = [degC for r in records if (degC := r.typical_degC()) is not None]
    return float(np.median(known_degC)) if known_degC else ROOM_DEGC
