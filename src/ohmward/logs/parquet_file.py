"""Parquet files, of which only the needed columns are read, block by block."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import to_column, values_of
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Progress, Table, TableFile, parsing, require_unique, row_numbers
from ohmward.optional import require

#: Rows that are decoded at a time: what Arrow holds beside the columns stays small.
_DECODED_ROWS = 1 << 18
#: Rows that a file keeps together.
_GROUP_ROWS = 1 << 20


def open_parquet(path: Path, hints: FileHints) -> TableFile:
    """The columns of a Parquet file, read when they are asked for."""
    pyarrow, parquet = _pyarrow()
    with parsing(path, "not a readable Parquet file", "write it again"):
        stored = tuple(parquet.read_schema(path).names)
    require_unique(path.name, stored)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        try:
            with parquet.ParquetFile(path, pre_buffer=False) as file:  # which would hold the whole file
                rows = file.metadata.num_rows
                columns = _columns(file, [name for name in stored if name in names], progress)
            pyarrow.default_memory_pool().release_unused()  # Arrow would keep what it decoded into
        except MemoryError:  # of Arrow, which counts it among its own
            raise
        except (pyarrow.ArrowException, OSError) as error:
            raise InputError(f"{path.name}: the Parquet file is damaged ({error}); write it again") from error
        if not rows:
            raise InputError(f"{path.name}: the file has columns but no rows; a log needs samples")
        return Table(path.name, columns, row_numbers(1, rows), "row")

    return TableFile(path.name, stored, load, hints=hints)


def _columns(file: Any, names: list[str], progress: Progress | None) -> dict[str, np.ndarray]:
    """The columns (T,) of a file, block by block into arrays of their whole length; none where there are no rows."""
    rows = file.metadata.num_rows
    columns: dict[str, np.ndarray] = {}
    first = 0
    for batch in file.iter_batches(_DECODED_ROWS, columns=names):
        last = first + batch.num_rows
        for name in names:
            values = values_of(batch[name])
            if name not in columns:
                columns[name] = np.empty(rows, values.dtype)
            elif columns[name].dtype != values.dtype:  # whole numbers, until the first block that lacks one
                columns[name] = columns[name].astype(np.result_type(columns[name], values))
            columns[name][first:last] = values
        first = last
        if progress:
            progress(first, rows)
    return columns


def write_parquet(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    """Write columns (T,) as Parquet with zstd; NaN stays NaN.

    progress: called now and then with the rows that are written and all rows.

    Raises:
        OhmwardError: pyarrow is not installed.
    """
    pyarrow, parquet = _pyarrow()
    # a dictionary of measured numbers is as large as the numbers, and slow to write and to read
    repeating = [name for name, values in columns.items() if np.asarray(values).dtype.kind != "f"]
    table = pyarrow.Table.from_arrays([to_column(pyarrow, values) for values in columns.values()], list(columns))
    with parquet.ParquetWriter(path, table.schema, compression="zstd", use_dictionary=repeating or False) as writer:
        for first in range(0, table.num_rows, _GROUP_ROWS):
            group = table.slice(first, _GROUP_ROWS)
            writer.write_table(group)
            if progress:
                progress(first + group.num_rows, table.num_rows)


def _pyarrow() -> tuple[ModuleType, ModuleType]:
    return require("pyarrow", "Parquet"), require("pyarrow.parquet", "Parquet")
