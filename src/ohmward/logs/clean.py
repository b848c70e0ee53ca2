"""From the columns of a file to the samples of a log: text, missing values, several sampling rates, gaps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import CURRENT, TEMPERATURE, VOLTAGE
from ohmward.logs.columns import Column, listed
from ohmward.logs.note import Note, counted
from ohmward.logs.table import Table, numbers

_GAP_FACTOR = 10.0


def to_si(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Current [A], voltage [V] and temperature [degC] as float64; infinite values become NaN.

    Raises:
        InputError: text where a number must stand (names the line), or no value of the current or voltage at all.
    """
    columns, notes = dict(table.columns), list(table.notes)
    for channel in (CURRENT, VOLTAGE, TEMPERATURE):
        if channel.name not in chosen:
            continue
        name, unit = chosen[channel.name]
        values, infinite = finite(name, numbers(table, name))
        columns[name] = (unit or channel.default).in_si(values)
        taken = f"in {unit.symbol}" if unit else f"which names no unit: taken as {channel.default.symbol}"
        notes += [*infinite, Note(f"{channel.name} from {name!r}{' ' if unit else ', '}{taken}")]
        if channel.required and not np.isfinite(columns[name]).any():
            raise InputError(f"{table.source}: column {name!r} has no value; a log needs a measured {channel.name}")
    return table._replace(columns=columns, notes=tuple(notes))


def finite(name: str, values: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The values (T,) of a column with NaN in place of infinite ones, and a note on their number."""
    infinite = np.isinf(values)
    if not infinite.any():
        return values, ()
    note = Note(f"{counted(infinite.sum(), 'infinite value')} of {name!r} taken as missing", "warning")
    return np.where(infinite, np.nan, values), (note,)


def drop_untimed(table: Table, time: str) -> Table:
    """The rows whose time is finite.

    Raises:
        InputError: no row has a time.
    """
    known = np.isfinite(table.columns[time])
    if not known.any():
        raise InputError(f"{table.source}: column {time!r} has no value; a log needs the time of its samples")
    if known.all():
        return table
    note = Note(f"{counted((~known).sum(), 'row')} without a time: dropped", "warning")
    return table.pick(known)._replace(notes=(*table.notes, note))


def drop_text(table: Table) -> Table:
    """The numeric columns that have a value at all, as float64."""
    numeric = {name: numbers(table, name) for name, values in table.columns.items() if values.dtype.kind in "fium"}
    measured = {name: values for name, values in numeric.items() if np.isfinite(values).any()}
    left_out = {"text": table.columns.keys() - numeric.keys(), "empty": numeric.keys() - measured.keys()}
    notes = [Note(f"{kind} columns left out: {listed(sorted(names))}") for kind, names in left_out.items() if names]
    return table._replace(columns=measured, notes=(*table.notes, *notes))


def merge_rates(table: Table, chosen: Mapping[str, Column]) -> Table:
    """Rows that have a current or a voltage; what was sampled on rows of its own is interpolated onto them.

    The temperature is always interpolated linearly over rows that lack it. The current is, where the file samples it
    on other rows than the voltage; single missing values of current and voltage stay NaN.
    """
    time_s = table.columns[chosen["time"].name]
    current, voltage = chosen["current"].name, chosen["voltage"].name
    has_current, has_voltage = np.isfinite(table.columns[current]), np.isfinite(table.columns[voltage])
    columns, notes = dict(table.columns), []
    if (has_current & has_voltage).sum() < 0.5 * min(has_current.sum(), has_voltage.sum()):
        columns[current], note = _bridged(time_s, columns[current], has_voltage & ~has_current, current)
        notes.append(note)
    measured = has_current | has_voltage
    if "temperature" in chosen and (name := chosen["temperature"].name) in columns:
        lacking = measured & ~np.isfinite(columns[name])
        if lacking.any():
            columns[name], note = _bridged(time_s, columns[name], lacking, name)
            notes.append(note)
    if measured.all():
        return table._replace(columns=columns, notes=(*table.notes, *notes))
    notes.append(Note(f"{counted((~measured).sum(), 'row')} with neither current nor voltage: dropped"))
    return table._replace(columns=columns, notes=(*table.notes, *notes)).pick(measured)


def missing_notes(table: Table, chosen: Mapping[str, Column]) -> tuple[Note, ...]:
    """Notes on the number of samples that lack their current or voltage."""
    counts = {q: int(np.isnan(table.columns[chosen[q].name]).sum()) for q in ("current", "voltage")}
    return tuple(
        Note(f"{count} of {table.line.size} samples have no {quantity} (NaN)", "warning")
        for quantity, count in counts.items()
        if count
    )


def find_gaps(time_s: np.ndarray) -> np.ndarray:
    """(G,) indices of the samples after which the log is silent for unusually long.

    A gap is more than ten times the median interval and more than ten times the intervals on both sides of it: where a
    logger slows down at rest, one long interval follows another, and that is no gap.

    time_s: (T,) [s].
    """
    intervals = np.diff(time_s)
    if intervals.size < 2:
        return np.empty(0, dtype=int)
    long = np.flatnonzero(intervals > _GAP_FACTOR * np.median(intervals))
    around = np.concatenate([[0.0], intervals, [0.0]])
    return long[intervals[long] > _GAP_FACTOR * np.maximum(around[long], around[long + 2])]


def gap_notes(time_s: np.ndarray) -> tuple[Note, ...]:
    """A note on the gaps in the time (T,) [s] and the longest of them, if there are any."""
    gaps = find_gaps(time_s)
    if not gaps.size:
        return ()
    longest = gaps[np.argmax(np.diff(time_s)[gaps])]
    length = time_s[longest + 1] - time_s[longest]
    return (Note(f"{counted(gaps.size, 'gap')}, the longest {length:g} s after {time_s[longest]:g} s", "warning"),)


def _bridged(time_s: np.ndarray, values: np.ndarray, rows: np.ndarray, name: str) -> tuple[np.ndarray, Note]:
    """The values with those at `rows` (mask) interpolated linearly in time, the ends held."""
    known = np.isfinite(values)
    filled = values.copy()
    filled[rows] = np.interp(time_s[rows], time_s[known], values[known])
    return filled, Note(
        f"{name!r} is interpolated at {counted(rows.sum(), 'sample')} from {counted(known.sum(), 'value')}"
    )
