"""Record: a log with its charge, its phases and the kind of test, divided at gaps of unknown charge.

Phases are rests, pulses, constant and varying currents, on any sampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.charge_count import ChargeIntegral, count_charge, known_current_A, without_unknown_current
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.soc.anchor_rule import REST_C
from ohmward.errors import InputError
from ohmward.logs.log import SECONDS_PER_HOUR, Log, Note, counted

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
#: Smallest share of the charge moved slowly in a low-rate test, largest drawn by varying currents in a pulse test.
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
    least_jump_A = np.maximum(_JUMP_SHARE * np.abs(current_A[1:]), _JUMP_RATE * capacity_Ah)
    jump = np.abs(np.diff(current_A)) > least_jump_A
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
    """Low-rate when most charge moved below C/15; pulses when at least 3 stand between rests; else dynamic.

    The current of a charge to the full battery varies in every kind of test.
    """
    moved_Ah = np.abs(charge.moved_Ah)
    dt_s = np.diff(log.time_s, prepend=log.time_s[0])
    slow = SECONDS_PER_HOUR * moved_Ah / np.where(dt_s > 0, dt_s, 1.0) < LOW_RATE * capacity_Ah
    if moved_Ah[slow].sum() > _LOW_RATE_SHARE * moved_Ah.sum():
        return "low-rate"
    drawn_Ah = np.maximum(-charge.moved_Ah, 0.0)
    varying_Ah = sum(drawn_Ah[p.first : p.last + 1].sum() for p in phases if p.kind == "varying")
    pulses = len(find_pulses(phases, capacity_Ah))
    return "pulses" if pulses >= _FEWEST_PULSES and varying_Ah < _VARYING_SHARE * moved_Ah.sum() else "dynamic"


def _joined(
    time_s: np.ndarray, current_A: np.ndarray, rest: np.ndarray, first: np.ndarray, last: np.ndarray
) -> tuple[Phase, ...]:
    """Phases of the runs first ... last (N,); neighbouring runs of varying current are one phase."""
    low, high = np.minimum.reduceat(current_A, first), np.maximum.reduceat(current_A, first)
    largest_A = np.maximum(np.abs(high), np.abs(low))
    steady = (high - low <= _CONSTANT_SHARE * largest_A) & (last > first)
    varying = ~rest & ~steady
    kinds = np.select([rest, varying], ["rest", "varying"], "constant").tolist()
    starts = np.flatnonzero(~(varying & np.concatenate([[False], varying[:-1]])))
    ends = np.append(starts[1:], first.size) - 1
    return tuple(
        Phase(
            kinds[a],
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
    found = (
        f"{log.name!r} is divided at {counted(len(divides), 'gap')} of unknown charge, {len(useful)} of "
        f"{len(edges) - 1} parts are used; where the current was constant, add rows of it every 60 s without a voltage"
    )
    if not useful:
        raise InputError(f"log {found}")
    note = Note(f"{found}; each part has a state of charge of its own", "warning")
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
