"""Write logs and other tables as CSV, Parquet, BDF or MCAP; a file is either whole or not there."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from os import PathLike
from pathlib import Path

import numpy as np

from ohmward.atomic import replacing
from ohmward.errors import InputError
from ohmward.logs import bdf, csv_arrow
from ohmward.logs.log import LogSource, as_log
from ohmward.logs.mcap_table import write_mcap
from ohmward.logs.parquet_file import write_parquet
from ohmward.logs.table import Progress

#: Endings of tables that can be written.
TABLES = (".csv", ".parquet", ".mcap")
_BLOCK_ROWS = 100_000


def write_log(log: LogSource, path: str | PathLike[str]) -> None:
    """Write a log; the suffix says how: .csv, .parquet, .mcap, .bdf.csv or .bdf.parquet. Current > 0 charges in each.

    CSV, Parquet and MCAP carry ohmward's own names (time_s, current_A, voltage_V, temperature_degC, unix_time_s), BDF
    those of the Battery Data Format. The extra columns follow under their own names; notes are not written.

    Raises:
        InputError: an unknown suffix, or an extra column with the name of a measured one.
        OhmwardError: the disk refused, Parquet without pyarrow, MCAP without mcap.
    """
    path = Path(path)
    log = as_log(log)
    own = log.measured()
    if bdf.is_bdf(path.name):
        own = {bdf.NAMES[field][0]: values for field, values in own.items()}
    if taken := own.keys() & log.extra.keys():
        raise InputError(f"log {log.name!r}: the extra column {min(taken)!r} has the name of a measured one; rename it")
    write_table({**own, **log.extra}, path)


def write_table(columns: Mapping[str, np.ndarray], path: str | PathLike[str], progress: Progress | None = None) -> None:
    """Write named columns (T,) as .csv, .parquet or .mcap; numbers keep every digit, NaN is an empty cell in CSV.

    progress: called now and then with the rows that are written and all rows.

    Raises:
        InputError: an unknown suffix, or columns of different lengths.
        OhmwardError: the disk refused, Parquet without pyarrow, MCAP without mcap.
    """
    path = Path(path)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{path.name}: columns differ in length: {lengths}; give every column one value per row")
    writers = dict(zip(TABLES, (_write_csv, write_parquet, write_mcap), strict=True))
    if path.suffix.lower() not in writers:
        raise InputError(f"{path.name}: unknown suffix {path.suffix!r}; name the file .csv, .parquet or .mcap")
    with replacing(path) as temporary:
        writers[path.suffix.lower()](temporary, columns, progress)


def _write_csv(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    arrays = [np.asarray(values) for values in columns.values()]
    rows = len(arrays[0]) if arrays else 0
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for start in range(0, rows, _BLOCK_ROWS):
            block = [values[start : start + _BLOCK_ROWS] for values in arrays]
            if (text := csv_arrow.rows_as_text(block)) is not None:
                stream.write(text)
            else:
                writer.writerows(zip(*map(_cells, block), strict=True))
            if progress:
                progress(start + len(block[0]), rows)


def _cells(values: np.ndarray) -> list:
    """Python numbers, which the csv module writes with every digit; None (an empty cell) for NaN."""
    if values.dtype.kind != "f":
        return values.tolist()
    return [None if value != value else value for value in values.tolist()]
