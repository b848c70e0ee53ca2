"""Table of open-circuit voltage against state of charge, read from a file or DataFrame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import OCV_TABLE
from ohmward.logs.columns import Column, find_column, listed
from ohmward.logs.read import open_table
from ohmward.logs.table import Note, counted, numbers

#: A table whose largest SoC is above this is in percent: a fraction ends at 1, plus some counting error.
_PERCENT_ABOVE = 1.5
#: Change of the OCV with temperature [V/K] beyond which a column without a unit is in mV/K: entropy gives less than
#: 1 mV/K for each cell, and 20 cells in series are the most that is likely.
_MOST_V_PER_K = 0.02


class OcvTable(NamedTuple):
    """Columns of a table of open-circuit voltage in SI units, in the order of the file; None for missing ones."""

    source: str  #: the file's name
    soc: np.ndarray  #: (K,) as a fraction
    #: (K,) mean curve and branches
    ocv_V: np.ndarray | None
    charge_V: np.ndarray | None
    discharge_V: np.ndarray | None
    #: (K,) half the distance between the branches; slope_V_per_K: (K,) change with temperature
    hysteresis_V: np.ndarray | None
    slope_V_per_K: np.ndarray | None
    reference_degC: float | None  #: temperature of the table
    notes: tuple[Note, ...]  #: what was assumed


def read_ocv_table(source: Any) -> OcvTable:
    """The columns of a CSV or Parquet file or a DataFrame, found by name and unit; rows with a gap are dropped.

    Raises:
        InputError: no such file, no column for the SoC or the voltage, text among numbers, fewer than 2 rows.
    """
    file = open_table(source)
    found = {c.name: find_column(file.source, file.names, c, {}, {}) for c in OCV_TABLE}
    columns = {name: column for name, column in found.items() if column}
    _require_columns(file.source, file.names, columns)
    table = file.load([column.name for column in columns.values()])
    values = {
        c.name: (columns[c.name].unit or c.default).in_si(numbers(table, columns[c.name].name))
        for c in OCV_TABLE
        if c.name in columns
    }
    reference = values.pop("reference_temperature", None)
    whole = np.all([np.isfinite(v) for v in values.values()], axis=0)
    if whole.sum() < 2:
        raise InputError(f"{file.source}: a curve needs at least 2 rows with numbers, it has {whole.sum()}")
    used = {name: v[whole] for name, v in values.items()}
    columns_read = ", ".join(f"{name} from {column.name!r}" for name, column in columns.items())
    notes = [Note(f"{file.source}: {columns_read}")]
    if dropped := int((~whole).sum()):
        notes.append(Note(f"{file.source}: {counted(dropped, 'row')} with an empty cell left out", "warning"))
    soc, slope = used["soc"], used.get("ocv_slope")
    if columns["soc"].unit is None and np.max(soc) > _PERCENT_ABOVE:
        soc = soc / 100
    if slope is not None and columns["ocv_slope"].unit is None and np.max(np.abs(slope)) > _MOST_V_PER_K:
        slope = slope / 1000
    return OcvTable(
        file.source,
        soc,
        used.get("ocv"),
        used.get("ocv_charge"),
        used.get("ocv_discharge"),
        used.get("hysteresis"),
        slope,
        None if reference is None or not np.isfinite(reference).any() else float(np.nanmedian(reference)),
        tuple(notes),
    )


def _require_columns(source: str, names: tuple[str, ...], columns: dict[str, Column]) -> None:
    """Raise InputError without a SoC, without a voltage, or with one branch alone."""
    if "soc" not in columns:
        raise InputError(
            f"{source}: no column for the state of charge found; it has: {listed(names)}; call it 'soc' (0 to 1) or "
            "'soc_percent'"
        )
    branches = [name for name in ("ocv_charge", "ocv_discharge") if name in columns]
    if len(branches) == 1:
        other = "ocv_discharge_V" if branches == ["ocv_charge"] else "ocv_charge_V"
        raise InputError(
            f"{source}: column {columns[branches[0]].name!r} is one branch of the open-circuit voltage, the other is "
            f"missing; add it as {other!r}, or call the column 'ocv_V' if it is the whole curve"
        )
    if not branches and "ocv" not in columns:
        raise InputError(
            f"{source}: no column for the open-circuit voltage found; it has: {listed(names)}; call it 'ocv_V', or its "
            "branches 'ocv_charge_V' and 'ocv_discharge_V'"
        )
