"""Long tables with a row for each value (InfluxDB, Home Assistant and the like) as tables with a column per name."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.clean import LONGEST_S, YEAR_S
from ohmward.logs.clock import read_clock
from ohmward.logs.columns import Column, argument
from ohmward.logs.selection import select_rows
from ohmward.logs.table import Note, Table, TableFile, counted, file_of, held, row_numbers

_TIME = "time"
#: Most batteries or robots in one table: a column of more values numbers its rows.
_MOST_INSTANCES = 16


class LongColumns(NamedTuple):
    """Columns of a long table: names of the quantities, their values, their times."""

    name: str
    value: str
    time: str
    holds: bool = False  #: values are written on change only, and hold until the next one


_NAMES = ("name", "variable", "metric", "sensor", "field", "signal", "channel", "parameter", "key", "quantity", "tag",
          "topic")  # fmt: skip
_VALUES = ("value", "val", "reading", "payload")
_TIMES = ("time", "timestamp", "ts", "date", "datetime")


#: Share of the values with the name and time of another value from which batteries or robots have the same names.
_MOST_REPEATED = 0.2


def as_wide(file: TableFile) -> TableFile:
    """A long table with a column for each of its names; any other table as it is.

    The other columns may tell batteries or robots apart, whose names are the same: `part` picks one of them.
    """
    columns = _long_columns(file.names)
    if columns is None:
        return file
    table = file.load(file.names)
    labels = [name for name in table.columns if name not in columns]

    def opened(table: Table) -> TableFile:
        wide = _wide(table, columns, file)
        return file._replace(names=tuple(wide.columns), load=file_of(wide, file.hints).load, time=_TIME, head={})

    def part(kind: str, where: Mapping[str, float | str]) -> TableFile:
        chosen = {name: wanted for name, wanted in where.items() if name in labels}
        mine = select_rows(table, chosen)
        _require_one_instance(mine, columns, [name for name in labels if name not in chosen])
        rows = opened(mine)
        for name in chosen:  # for those who select rows by it again
            rows = rows.with_column(name, (), partial(_throughout, name, mine.columns[name][0]))
        return rows

    return opened(table)._replace(choose=part)


def _throughout(name: str, value: Any, wide: Table) -> tuple[np.ndarray, Note]:
    return np.full(wide.line.size, value), Note(f"{name} = {value} throughout")


def _require_one_instance(table: Table, columns: LongColumns, labels: Sequence[str]) -> None:
    """Refuse values of several batteries or robots that have the same names, with the label that tells them apart."""

    def with_codes(series: np.ndarray, name: str) -> np.ndarray:
        values = table.columns[name]
        distinct, code = np.unique(values.astype(str) if values.dtype == object else values, return_inverse=True)
        return series * distinct.size + code

    def is_repeated(series: np.ndarray) -> bool:
        return np.unique(series).size < (1.0 - _MOST_REPEATED) * series.size

    series = with_codes(with_codes(np.zeros(table.line.size, int), columns.time), columns.name)
    if not labels or not is_repeated(series):
        return
    texts = {name: list(dict.fromkeys(map(str, table.columns[name]))) for name in labels}
    for name, values in sorted(texts.items(), key=lambda label: len(label[1])):
        if 1 < len(values) <= _MOST_INSTANCES and not is_repeated(with_codes(series, name)):
            options = " or ".join(f"--where {argument(f'{name}={value}')}" for value in values)
            raise InputError(
                f"{table.source}: values of one name and time are of several batteries or robots; they differ in "
                f"{name!r}; choose one with {options} (where={{{name!r}: {values[0]!r}}})"
            )


def _long_columns(names: Collection[str]) -> LongColumns | None:
    if {"_time", "_value", "_field"} <= set(names):
        return LongColumns("_field", "_value", "_time")
    if {"entity_id", "state"} <= set(names):
        changed = next((name for name in ("last_changed", "last_updated") if name in names), None)
        return LongColumns("entity_id", "state", changed, holds=True) if changed else None
    lower = {name.lower(): name for name in names}
    found = [next((lower[word] for word in words if word in lower), None) for words in (_NAMES, _VALUES, _TIMES)]
    name, value, time = found
    return LongColumns(name, value, time) if name and value and time and len(names) <= 5 else None


def _wide(table: Table, columns: LongColumns, file: TableFile) -> Table:
    """A row for each time at which something was written, in order of time."""
    clock = read_clock(table, Column(columns.time, None), file.hints)
    values = np.array([_number(cell) for cell in table.columns[columns.value]])
    known = np.isfinite(clock.time_s)
    names = np.array([str(cell).removeprefix("sensor.") for cell in table.columns[columns.name]])[known]
    if not names.size:
        raise InputError(f"{table.source}: column {columns.time!r} has no value; a log needs the time of its samples")
    years = np.ptp(clock.time_s[known]) / YEAR_S
    if years > LONGEST_S / YEAR_S:
        raise InputError(
            f"{table.source}: column {columns.time!r} gives a log of {years:,.0f} years; correct its cells"
        )
    time_s, row = np.unique(clock.time_s[known], return_inverse=True)
    wide: dict[str, np.ndarray] = {_TIME: time_s}
    if clock.start_unix_s is not None:
        start = np.int64(round(clock.start_unix_s * 1e9))
        nanoseconds = start + np.round(time_s * 1e9).astype(np.int64)
        wide[_TIME] = nanoseconds.astype("M8[ns]")
    values, lost = values[known], 0
    for name in dict.fromkeys(names.tolist()):
        of_name = names == name
        column = np.full(time_s.size, np.nan)
        column[row[of_name]] = values[of_name]
        lost += int(np.count_nonzero(np.abs(column[row[of_name]] - values[of_name]) > 0.0))
        if np.isfinite(column).any():
            wide[name] = held(column) if columns.holds else column
    until = ", each of which holds until the next" if columns.holds else ""
    notes = [Note(f"a row for each value: columns made of the names in {columns.name!r}{until}")]
    if lost:
        notes.append(Note(f"{counted(lost, 'value')} of a name that has another at the same time: left out", "warning"))
    return Table(table.source, wide, row_numbers(1, time_s.size), "time", (*table.notes, *notes))


def _number(cell: object) -> float:
    """The number in a cell, NaN for any text: `unavailable`, `on`."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan
