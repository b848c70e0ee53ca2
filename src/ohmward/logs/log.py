"""What every part of ohmward reads: one recording of a battery, in SI units, with everything said that was assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ohmward.logs import recording

SECONDS_PER_HOUR = 3600.0


class Note(NamedTuple):
    """One thing that was assumed, converted, dropped or found; `level` is "info" or "warning"."""

    text: str
    level: str = "info"

    def __str__(self) -> str:
        return f"{self.level}: {self.text}"


def counted(count: int, noun: str) -> str:
    """A count with its noun for a message: "1 row", "2 rows"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


@dataclass(frozen=True, eq=False)
class Log:
    """A recording: current, voltage and temperature over time. Arrays are read-only float64.

    name: what to call it, usually the file's stem.
    time_s: (T,) [s], finite and strictly increasing; the zero is the file's own, or the first sample of a wall clock.
    current_A: (T,) [A], > 0 charges; NaN where it was not measured.
    voltage_V: (T,) [V] of the whole pack; NaN where it was not measured.
    temperature_degC: (T,) [degC], or None when the file has no temperature.
    extra: further numeric columns by their name in the file, (T,) each, in the file's own units.
    notes: everything that was assumed, converted or dropped on the way.
    start_unix_s: Unix time [s] of time_s = 0, or None when the file has no wall clock.

    Raises:
        InputError: no samples, shapes that differ, time that is not finite or does not increase.
    """

    name: str
    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    start_unix_s: float | None = None

    def __post_init__(self) -> None:
        columns = ("current_A", "voltage_V", "temperature_degC")
        recording.freeze(self, ("time_s", *columns))
        recording.require_time(self)
        recording.require_lengths(self, columns)

    def __len__(self) -> int:
        return self.time_s.size

    @property
    def duration_s(self) -> float:
        """Last minus first time [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def dt_s(self) -> np.ndarray:
        """(T-1,) [s], the time between neighbouring samples."""
        return np.diff(self.time_s)

    def select(self, rows: slice | np.ndarray) -> Log:
        """The samples that a slice, a mask (T,) or indices pick; at least one, in order of time."""
        return recording.select(self, rows)

    def between(self, start_s: float, stop_s: float) -> Log:
        """The samples with start_s <= time_s < stop_s; the clock keeps its zero."""
        return recording.between(self, start_s, stop_s)

    def with_notes(self, *notes: Note) -> Log:
        """The same log with more notes."""
        return replace(self, notes=self.notes + notes)

    def charge_Ah(self) -> np.ndarray:
        """(T,) [Ah], the integral of the current from the first sample, > 0 when charge went in.

        The current is linear between samples (trapezoids); samples without a current are bridged by the same line.
        """
        known = np.isfinite(self.current_A)
        if not known.any():
            return np.full(len(self), np.nan)
        current = np.interp(self.time_s, self.time_s[known], self.current_A[known])
        mean = 0.5 * (current[1:] + current[:-1])
        return np.concatenate([[0.0], np.cumsum(mean * self.dt_s)]) / SECONDS_PER_HOUR

    def describe(self) -> str:
        """A few lines for people: what is in the log, then its notes."""
        lines = [f"{self.name}: {counted(len(self), 'sample')}, {self.duration_s:g} s, {_interval(self)}"]
        lines += [_range("current", self.current_A, "A (> 0 charges)"), _range("voltage", self.voltage_V, "V")]
        if self.temperature_degC is not None:
            lines.append(_range("temperature", self.temperature_degC, "degC"))
        if self.extra:
            lines.append(f"  also: {', '.join(self.extra)}")
        return "\n".join(lines + [f"  {note}" for note in self.notes])


def _interval(log: Log) -> str:
    return f"median interval {np.median(log.dt_s):g} s" if len(log) > 1 else "one sample"


def _range(name: str, values: np.ndarray, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return f"  {name}: never measured"
    missing = values.size - known.size
    return f"  {name}: {known.min():.6g} to {known.max():.6g} {unit}" + (f", {missing} missing" if missing else "")
