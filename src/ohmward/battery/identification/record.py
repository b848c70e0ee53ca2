"""Record: a log with its charge, its phases and the kind of test, divided at gaps of unknown charge."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.charge import ChargeIntegral, count_charge, known_current_A
from ohmward.battery.identification.segments import FEWEST_OF_A_PULSE, Phase, Test, find_phases, is_rest, kind_of_test
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.errors import InputError
from ohmward.logs.log import Log, Note, counted

#: Relative difference of voltages that are the same rest, and length of a rest whose voltage has settled [s]: a minute
#: after a pulse of 6 C it still rises by as much as a discharge of 5 % would lower it.
_SAME_VOLTAGE = 0.003
_SETTLED_REST_S = 600.0


class Record(NamedTuple):
    """A log with the charge of each interval, its phases and the kind of test."""

    log: Log
    charge: ChargeIntegral
    phases: tuple[Phase, ...]
    test: Test
    #: direction of the charge that flowed unseen before the record, -1 discharge, 1 charge, 0 unknown
    came_from: int = 0

    @property
    def current_A(self) -> np.ndarray:
        """(T,) current [A], > 0 charges, without holes."""
        return known_current_A(self.log)

    def temperature_degC(self, otherwise: float) -> np.ndarray:
        """(T,) temperature [degC]; `otherwise` where the log has none."""
        if self.log.temperature_degC is None:
            return np.full(len(self.log), otherwise)
        return np.where(np.isfinite(self.log.temperature_degC), self.log.temperature_degC, otherwise)

    def typical_degC(self) -> float | None:
        """Median temperature of the log, or None."""
        values = self.log.temperature_degC
        return None if values is None or not np.isfinite(values).any() else float(np.nanmedian(values))


def make_records(log: Log, capacity_Ah: float, idle_current_A: float = 0.0) -> tuple[Record, ...]:
    """Charge, phases and kind of test of a log: one record, or several where gaps of unknown charge divide it.

    A gap divides nothing where the battery has rested for 10 minutes before it, and rests at the same voltage (within
    0.3 %) after it.

    Raises:
        InputError: no current in the log, or too short for a pulse.
    """
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
    """The record with the direction of the charge in the gap before it, told by the voltages at rest on both sides.

    A voltage that had not settled before the gap tells it only where it went on against its relaxation.
    """
    if not (before.phases[-1].kind == record.phases[0].kind == "rest"):
        return record
    ends_V = before.log.voltage_V[np.isfinite(before.log.voltage_V)]
    starts_V = record.log.voltage_V[np.isfinite(record.log.voltage_V)]
    if not ends_V.size or not starts_V.size or abs(starts_V[0] - ends_V[-1]) <= _SAME_VOLTAGE * ends_V[-1]:
        return record
    direction = int(np.sign(starts_V[0] - ends_V[-1]))
    relaxing = 0 if is_rest(before.phases[-1], _SETTLED_REST_S) else _relaxing(before)
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
        p.kind == "rest" and p.first < k <= p.last and time_s[k - 1] - time_s[p.first] >= _SETTLED_REST_S
        for p in record.phases
    )
    before_V, after_V = record.log.voltage_V[k - 1], record.log.voltage_V[k]
    return settled and bool(abs(after_V - before_V) <= _SAME_VOLTAGE * abs(before_V))


def reference_degC(records: Sequence[Record]) -> float:
    """Median of the typical temperatures of the records [degC], room temperature where none is known."""
    known_degC = [degC for r in records if (degC := r.typical_degC()) is not None]
    return float(np.median(known_degC)) if known_degC else ROOM_DEGC
