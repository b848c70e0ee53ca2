"""Long tables with a row for each value (InfluxDB, Home Assistant and the like) as tables with a column per name."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.cells import with_unit
from ohmward.logs.clean import LONGEST_S, YEAR_S
from ohmward.logs.clock import read_clock
from ohmward.logs.columns import Column, other_times
from ohmward.logs.table import Note, Table, TableFile, counted, file_of, held, row_numbers

_TIME = "time"


class LongColumns(NamedTuple):
    """Columns of a long table: names of the quantities, their values, their times."""

    name: str
    value: str
    time: str
    unit: str | None = None
    holds: bool = False  #: values are written on change only, and hold until the next one


_NAMES = ("name", "variable", "metric", "sensor", "field", "signal", "channel", "parameter", "key", "quantity", "tag",
          "topic", "pid")  # fmt: skip
_VALUES = ("value", "val", "reading", "payload")
_UNITS = ("unit", "units")
#: Values are of one sample if they are written within this share of the time in which the same name returns, and no
#: more than this time [s] apart.
_OF_PERIOD, _LONGEST_SAMPLE_S = 0.1, 1.0


def as_wide(file: TableFile) -> TableFile:
    """A long table with a column for each of its names and labels; any other table as it is."""
    columns = long_columns(file.names)
    if columns is None:
        return file
    wide = _wide(file.load(file.names), columns, file)
    return file._replace(names=tuple(wide.columns), load=file_of(wide, file.hints).load, time=_TIME, head={})


def long_columns(names: Collection[str]) -> LongColumns | None:
    """The columns of a long table by their names; None for any other table."""
    if {"_time", "_value", "_field"} <= set(names):
        return LongColumns("_field", "_value", "_time")
    if {"entity_id", "state"} <= set(names):
        changed = next((name for name in ("last_changed", "last_updated") if name in names), None)
        return LongColumns("entity_id", "state", changed, holds=True) if changed else None
    lower = {name.lower(): name for name in names}
    name, value, unit = (next((lower[w] for w in words if w in lower), None) for words in (_NAMES, _VALUES, _UNITS))
    if name is None or value is None or len(names) > 5:
        return None
    times = other_times(tuple(names), {name, value})
    return LongColumns(name, value, times[0].name, unit) if times else None


def _wide(table: Table, columns: LongColumns, file: TableFile) -> Table:
    """A row for each time at which something was written, and for each robot, in order of time."""
    clock = read_clock(table, Column(columns.time, None), file.hints)
    known = np.isfinite(clock.time_s)
    table = table.pick(known)
    names = np.array([str(cell).removeprefix("sensor.") for cell in table.columns[columns.name]])
    if columns.unit:
        names = np.array([with_unit(*pair) for pair in zip(names, table.columns[columns.unit], strict=True)])
    if not names.size:
        raise InputError(f"{table.source}: column {columns.time!r} has no value; a log needs the time of its samples")
    years = np.ptp(clock.time_s[known]) / YEAR_S
    if years > LONGEST_S / YEAR_S:
        raise InputError(
            f"{table.source}: column {columns.time!r} gives a log of {years:,.0f} years; correct its cells"
        )
    labels = [] if columns.holds else _labels(table, columns, names)
    series = reduce(_numbered, [names, *(table.columns[label] for label in labels)], np.zeros(names.size, int))
    sampled_s = _sample_times(clock.time_s[known], series)
    key = reduce(_numbered, [sampled_s, *(table.columns[label] for label in labels)], np.zeros(names.size, int))
    _, first, row = np.unique(key, return_index=True, return_inverse=True)
    time_s = sampled_s[first]
    wide: dict[str, np.ndarray] = {_TIME: time_s}
    if clock.start_unix_s is not None:
        start = np.int64(round(clock.start_unix_s * 1e9))
        nanoseconds = start + np.round(time_s * 1e9).astype(np.int64)
        wide[_TIME] = nanoseconds.astype("M8[ns]")
    values, lost = _numbers(table.columns[columns.value]), 0
    for name in dict.fromkeys(names.tolist()):
        of_name = names == name
        column = np.full(time_s.size, np.nan)
        column[row[of_name]] = values[of_name]
        lost += int(np.count_nonzero(np.abs(column[row[of_name]] - values[of_name]) > 0.0))
        if np.isfinite(column).any():
            wide[name] = held(column) if columns.holds else column
    wide |= {label: table.columns[label][first] for label in labels if label not in wide}
    until = ", each of which holds until the next" if columns.holds else ""
    notes = [Note(f"a row for each value: columns made of the names in {columns.name!r}{until}")]
    if together := int(np.count_nonzero(sampled_s != clock.time_s[known])):
        text = f"{counted(together, 'value')} written up to {_LONGEST_SAMPLE_S:g} s after others: of the same sample"
        notes.append(Note(text))
    if lost:
        notes.append(Note(f"{counted(lost, 'value')} of a name that has another at the same time: left out", "warning"))
    return Table(table.source, wide, row_numbers(1, time_s.size), "time", (*table.notes, *notes))


def _sample_times(written_s: np.ndarray, series: np.ndarray) -> np.ndarray:
    """Times (T,) of the samples: those of the first value of each, where others are written a little later.

    series: (T,) numbers of the names. A sample has each but once; values of a name that returns sooner are left apart.
    """
    order = np.lexsort((written_s, series))
    returns_s = np.diff(written_s[order])[np.diff(series[order]) == 0]
    returns_s = returns_s[returns_s > 0.0]
    if not returns_s.size:
        return written_s
    apart_s = min(_OF_PERIOD * float(np.median(returns_s)), _LONGEST_SAMPLE_S)
    order = np.argsort(written_s, kind="stable")
    begins = np.diff(written_s[order], prepend=-np.inf) > apart_s
    sample = np.cumsum(begins) - 1
    of_name = _numbered(sample, series[order])
    has_twice = np.bincount(sample, weights=np.bincount(of_name)[of_name] > 1) > 0
    found_s = written_s.copy()
    found_s[order] = np.where(has_twice[sample], written_s[order], written_s[order][begins][sample])
    return found_s


def _labels(table: Table, columns: LongColumns, names: np.ndarray) -> list[str]:
    """The other columns, which may tell batteries or robots of the same names apart.

    Not those that follow from the names (T,) and from labels of fewer values, or number the rows.
    """
    codes = {label: _numbered(np.zeros(names.size, int), table.columns[label]) for label in table.columns}
    series = _numbered(np.zeros(names.size, int), names)
    found = []
    for label in sorted((label for label in codes if label not in columns), key=lambda label: codes[label].max()):
        finer = _numbered(series, codes[label])
        if finer.max() > series.max() and 2 * codes[label].max() < names.size:
            found.append(label)
            series = finer
    return found


def _numbered(series: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Numbers (T,) of the groups of equal values in each of the series (T,), in the order of both."""
    code = np.unique(values.astype(str) if values.dtype == object else values, return_inverse=True)[1]
    return np.unique(series * (code.max(initial=0) + 1) + code, return_inverse=True)[1]


def _numbers(cells: np.ndarray) -> np.ndarray:
    """The numbers in cells (T,), NaN for any text: `unavailable`, `on`."""
    found = np.full(cells.size, np.nan)
    for row, cell in enumerate(cells):
        with suppress(ValueError):
            found[row] = float(str(cell))
    return found
