"""A time column in whatever notation, as seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import Column
from ohmward.logs.note import Note
from ohmward.logs.table import Table, number, numbers
from ohmward.logs.units import UNITS

# Unix times of the years 2000 to 2100; an elapsed time of 30 years does not occur in a log.
_UNIX_S = (946_684_800.0, 4_102_444_800.0)
_DURATION = re.compile(r"^\s*(\d+):(\d\d):(\d\d(?:\.\d*)?)\s*$")


class Clock(NamedTuple):
    """time_s: (T,) float64 [s], NaN where the row has none; start_unix_s: Unix time of its zero, None if elapsed."""

    time_s: np.ndarray
    start_unix_s: float | None
    notes: tuple[Note, ...] = ()


def nanosecond_column(names: Sequence[str], name: str) -> str | None:
    """The column that holds the nanoseconds of a ROS time whose seconds are `name`, if there is one."""
    stem = re.sub(r"secs?$", "", name)
    return next((n for n in names if n != name and n in (f"{stem}nanosec", f"{stem}nsecs", f"{stem}nsec")), None)


def read_clock(table: Table, column: Column) -> Clock:
    """Seconds from elapsed time, Unix time (s, ms, us or ns, told by magnitude), ISO 8601, h:mm:ss, dates, durations.

    Wall clocks become seconds since their first sample; elapsed times keep the file's own zero.

    Raises:
        InputError: a cell is neither a number nor a date; names the line.
    """
    values = table.columns[column.name]
    if (nanoseconds := nanosecond_column(tuple(table.columns), column.name)) is not None:
        values = (values.astype(np.int64) * 1_000_000_000 + table.columns[nanoseconds].astype(np.int64)).view("M8[ns]")
    if values.dtype.kind in "mM":
        return clock_of_dates(values)
    if values.dtype == object:
        return _from_text(table, column, values)
    return _from_numbers(column, values)


def clock_of_dates(values: np.ndarray) -> Clock:
    """Seconds since the first of the datetime64 values (T,), or the seconds of timedelta64 values (T,)."""
    known = ~np.isnat(values)
    if values.dtype.kind == "m":
        return Clock(values / np.timedelta64(1, "s"), None)
    nanoseconds = values.astype("datetime64[ns]", copy=False).view(np.int64)
    start = int(nanoseconds[np.argmax(known)]) if known.any() else 0
    return Clock(np.where(known, (nanoseconds - start) * 1e-9, np.nan), start * 1e-9)


def _from_numbers(column: Column, values: np.ndarray) -> Clock:
    known = np.isfinite(values)
    first = values[np.argmax(known)] if known.any() else 0
    unit = column.unit or next((UNITS[u] for u in ("s", "ms", "us", "ns") if _is_unix(first * UNITS[u].scale)), None)
    notes: tuple[Note, ...] = ()
    if unit is None:
        unit = UNITS["s"]
        notes = (Note(f"column {column.name!r} names no unit: taken as seconds"),)
    if not _is_unix(first * unit.scale):
        return Clock(_scaled(values, unit.scale), None, notes)
    if column.unit is None:
        notes = (Note(f"column {column.name!r} taken as Unix time in {unit.symbol}"),)
    return Clock(_scaled(values - first, unit.scale), float(first * unit.scale), notes)


def _scaled(values: np.ndarray, scale: float) -> np.ndarray:
    return values.astype(float, copy=False) if scale == 1.0 else values * scale


def _is_unix(seconds: float) -> bool:
    return _UNIX_S[0] <= seconds <= _UNIX_S[1]


def _from_text(table: Table, column: Column, values: np.ndarray) -> Clock:
    first = next((cell for cell in values if cell.strip()), "")
    if _is_number(first):
        return _from_numbers(column, numbers(table, column.name))
    parse = _duration_s if _DURATION.match(first) else _unix_s
    seconds = np.empty(values.size)
    for row, cell in enumerate(values):
        try:
            seconds[row] = parse(cell) if cell.strip() else np.nan
        except ValueError:
            raise InputError(
                f"{table.source}, {table.place} {table.line[row]}, column {column.name!r}: {cell!r} is not a time like "
                f"{first!r}; write seconds or ISO 8601 (2026-01-31T12:00:00.5Z)"
            ) from None
    if parse is _duration_s:
        return Clock(seconds, None)
    start = seconds[np.isfinite(seconds)][0]
    zone = "" if datetime.fromisoformat(first.strip()).tzinfo else "; no time zone given, taken as UTC"
    note = Note(f"column {column.name!r} read as dates: time counts from {first.strip()}{zone}")
    return Clock(seconds - start, float(start), (note,))


def _unix_s(cell: str) -> float:
    moment = datetime.fromisoformat(cell.strip())
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return moment.timestamp()


def _duration_s(cell: str) -> float:
    found = _DURATION.match(cell)
    if not found:
        raise ValueError(cell)
    hours, minutes, seconds = found.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True
