"""Voltages of single cells in a log: columns that are numbered alike, told by their names and checked by their sum.

`cell_voltage_1_V` to `cell_voltage_4_V`, `Cell 1 (mV)`, `cell_voltage[0]` of a ROS message, or merely `U1` to `U4`: a
row of columns belongs to the cells of a pack where their sum is the voltage of the pack.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.logs.channels import VOLTAGE, letters, word_set
from ohmward.logs.columns import find_column
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, numbers
from ohmward.logs.units import Unit, split_unit, unit_in_name

#: The sum of the cells and the voltage of the pack are measured by different converters, and the wires between them
#: drop a few millivolts a cell.
SUM_TOLERANCE = 0.01
#: Cells without a unit in their names are in mV where they show more than this: no cell has 100 V.
_LARGEST_CELL_V = 100.0
_OTHER_THAN_VOLTAGE = word_set(
    "temperature temp t current i soc charge resistance ohm balance balancing capacity soh fault flag status std sigma"
)


class CellVoltages(NamedTuple):
    """Voltages of the cells of a pack."""

    names: tuple[str, ...]  #: (n,) of the columns, in the order of their numbers
    voltage_V: np.ndarray  #: (T, n); nan where one was not measured
    note: Note  #: where they come from


def find_cells(
    columns: Mapping[str, np.ndarray], pack_V: np.ndarray, n_series: int
) -> tuple[CellVoltages | None, tuple[Note, ...]]:
    """The cell voltages among columns; None where there are none. Notes say what was taken, or did not fit.

    columns: name -> (T,), in the units of the file: the `extra` of a log.
    pack_V: (T,) of the pack [V].
    n_series: cells of the pack in series.
    """
    if n_series < 2:
        return None, ()
    notes = []
    for row in sorted(numbered_rows(columns), key=lambda row: not is_named(row)):
        if len(row) != n_series:
            if is_named(row):
                notes.append(_other_count(row, n_series))
            continue
        table = np.stack([columns[name] for name in row], axis=1)
        for factor in _factors(row, table):
            if _agrees(factor * table, pack_V):
                note = Note(f"cell voltages from {row[0]!r} to {row[-1]!r}; their sum is the pack's voltage")
                return CellVoltages(row, factor * table, note), (note,)
        if is_named(row):
            notes.append(_other_sum(row, _factors(row, table)[0] * table, pack_V))
    return None, tuple(notes)


def cell_names(names: Collection[str]) -> tuple[str, ...]:
    """The columns that may be voltages of cells, by their names alone."""
    return tuple(name for row in numbered_rows(names) for name in row)


def numbered_rows(names: Collection[str]) -> list[tuple[str, ...]]:
    """Rows of two and more names that differ in one number only, which counts from 0 or 1; those of a voltage."""
    rows: dict[str, dict[int, str]] = {}
    for name in filter(_may_be_voltage, names):
        for number in re.finditer(r"\d+", name):
            key = f"{name[: number.start()]}#{name[number.end() :]}"
            rows.setdefault(key, {})[int(number[0])] = name
    found = [tuple(row[k] for k in sorted(row)) for row in rows.values() if len(row) > 1 and _counts(row)]
    return sorted(found, key=len, reverse=True)


def is_named(row: Sequence[str]) -> bool:
    """True where the names say that these are cells."""
    return any(word.endswith(("cell", "cells")) for word in letters(row[0]))


def _are_cells(row: Sequence[str]) -> bool:
    """True for `V1`, `V2`, `V3` and more, and `U1 (V)`: voltages that have nothing but a number."""
    return len(row) > 2 and all(set(letters(next(split_unit(name))[0])) <= {"v", "u"} for name in row)


def with_pack_voltage(file: TableFile, columns: Mapping[str, str] | None = None) -> TableFile:
    """The file with the sum of its cell voltages as a column, where it has cells and no voltage of the pack.

    columns: those that the caller named.
    """
    rows = [row for row in numbered_rows(file.names) if is_named(row)]
    rows = rows or [row for row in numbered_rows(file.names) if _are_cells(row)]
    if not rows or "voltage" in (columns or {}):
        return file
    optional = VOLTAGE._replace(required=False)
    leave = cell_names(file.names)
    if find_column(file.source, file.names, optional, file.given(columns), {}, leave):
        return file
    row = rows[0]
    name = "pack voltage [V]"

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        table = file.load([*names, *(row if name in names else ())], progress)
        if name not in names:
            return table
        cells = np.stack([numbers(table, cell) for cell in row], axis=1)
        note = Note(f"voltage of the pack: the sum of {row[0]!r} to {row[-1]!r}")
        return table.with_columns({name: _factors(row, cells)[0] * cells.sum(axis=1)}, note)

    return file._replace(names=(*file.names, name), load=load)


def _may_be_voltage(name: str) -> bool:
    """True where neither unit nor words make it another quantity; a `[1]` counts cells and is no unit."""
    units = [unit for _, unit in split_unit(name) if unit is not None and unit.symbol != "1"]
    if units and not any(unit.dimension == "voltage" for unit in units):
        return False
    stem, _ = next(split_unit(name))
    return not _OTHER_THAN_VOLTAGE & set(letters(stem))


def _counts(row: Mapping[int, str]) -> bool:
    """True where the numbers run from 0 or 1 without a gap."""
    numbers_ = sorted(row)
    return numbers_[0] in (0, 1) and numbers_[-1] - numbers_[0] + 1 == len(numbers_)


def _factors(row: Sequence[str], table: np.ndarray) -> tuple[float, ...]:
    """Factor to volts: that of the unit in the names; without one, what the numbers can be."""
    unit: Unit | None = unit_in_name(row[0], ("voltage",))
    if unit is not None:
        return (unit.scale,)
    return (1e-3,) if np.nanmedian(table) > _LARGEST_CELL_V else (1.0,)


def _agrees(cells_V: np.ndarray, pack_V: np.ndarray) -> bool:
    """True where the sum of the cells (T, n) is usually the voltage of the pack (T,)."""
    error = np.abs(cells_V.sum(axis=1) - pack_V) / np.abs(pack_V)
    error = error[np.isfinite(error)]
    return bool(error.size) and bool(np.median(error) <= SUM_TOLERANCE)


def _other_count(row: Sequence[str], n_series: int) -> Note:
    return Note(
        f"{len(row)} cell voltages, {row[0]!r} to {row[-1]!r}, but the battery file has n_series = {n_series}: they "
        "are not used",
        "warning",
    )


def _other_sum(row: Sequence[str], cells_V: np.ndarray, pack_V: np.ndarray) -> Note:
    sums = cells_V.sum(axis=1)
    text = (
        f"the sum of {row[0]!r} to {row[-1]!r} is usually {np.nanmedian(sums):.4g} V, the voltage of the pack "
        f"{np.nanmedian(pack_V):.4g} V: they are not used as cell voltages"
    )
    return Note(text, "warning")
