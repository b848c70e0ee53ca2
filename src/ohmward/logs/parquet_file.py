"""Parquet files, of which only the needed columns are read; the one place that imports pyarrow."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.table import Table, TableFile


def open_parquet(path: Path) -> TableFile:
    """The columns of a Parquet file.

    Raises:
        InputError: not a Parquet file, damaged, or (on loading) without rows.
        OhmwardError: pyarrow is not installed.
    """
    pyarrow, parquet = _pyarrow()
    try:
        names = tuple(parquet.read_schema(path).names)
    except pyarrow.ArrowException as error:
        raise InputError(f"{path.name}: not a readable Parquet file ({error}); write it again") from error

    def load(wanted: Collection[str]) -> Table:
        try:
            table = parquet.read_table(path, columns=[name for name in names if name in wanted])
        except (pyarrow.ArrowException, OSError) as error:
            raise InputError(f"{path.name}: the Parquet file is damaged ({error}); write it again") from error
        if not table.num_rows:
            raise InputError(f"{path.name}: the file has columns but no rows; a log needs samples")
        columns = {name: _values(table[name]) for name in table.column_names}
        return Table(path.name, columns, np.arange(1, table.num_rows + 1), "row")

    return TableFile(path.name, names, load)


def write_parquet(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns (T,) as Parquet with zstd; NaN stays NaN.

    Raises:
        OhmwardError: pyarrow is not installed.
    """
    pyarrow, parquet = _pyarrow()
    parquet.write_table(pyarrow.table(dict(columns)), path, compression="zstd")


def _pyarrow():
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise OhmwardError("Parquet needs pyarrow, which is not installed; pip install 'ohmward[lab]'") from error
    return pyarrow, parquet


def _values(column) -> np.ndarray:
    """Numbers as they are (NaN for null), dates as datetime64, everything else as text."""
    kind = str(column.type)
    if kind.startswith(("timestamp", "date")):
        return column.to_numpy().astype("datetime64[ns]")
    if kind.startswith(("int", "uint", "float", "double", "halffloat")):
        values = column.to_numpy()
        return values.astype(np.int64) if values.dtype.kind == "u" else values
    if kind.startswith(("duration", "decimal", "bool")):
        return _as_seconds(column) if kind.startswith("duration") else column.cast("float64").to_numpy()
    return np.array(["" if value is None else str(value) for value in column.to_pylist()], dtype=object)


def _as_seconds(column) -> np.ndarray:
    return column.to_numpy().astype("timedelta64[ns]") / np.timedelta64(1, "s")
