"""Write logs and other tables as CSV, Parquet, BDF or MCAP; a file is either whole or not there."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import ModuleType

import numpy as np

from ohmward.atomic import replacing
from ohmward.checks import path_of, require_mappings
from ohmward.errors import InputError
from ohmward.logs.bags.bag_table import TABLE_TYPE
from ohmward.logs.columns import BDF_NAMES, is_bdf
from ohmward.logs.frame import import_arrow, write_parquet
from ohmward.logs.log import LogSource, as_log
from ohmward.logs.table import Progress
from ohmward.optional import require

TOPIC = "/ohmward"

#: Size of a chunk [bytes]: the most that a truncated file loses, and what a viewer reads at once.
_CHUNK_BYTES = 1 << 18
#: Rows written at a time.
_WRITTEN_ROWS = 1 << 16
_HEADER = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
#: Plain CDR, little-endian: the stamp, an empty frame_id, and zeros up to the first eight-byte number.
_BEFORE = [("encoding", "<u4"), ("sec", "<i4"), ("nanosec", "<u4"), ("frame_length", "<u4"), ("frame", "<u4")]
_LITTLE_ENDIAN_CDR, _LENGTH_OF_EMPTY = 0x00000100, 1


def write_mcap(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    """Write the numeric columns (T,) as ROS 2 messages; text columns are left out.

    The time of a message is `unix_time_s`, without that column `time_s`, without both the number of the row.
    """
    writing = require("mcap.writer", "MCAP")
    numeric = {name: values for name, values in columns.items() if values.dtype.kind in "biuf"}
    rows = len(next(iter(numeric.values()), ()))
    time_ns = _times_ns(numeric, rows)
    fields = _field_names(list(numeric))
    definition = "".join(["std_msgs/Header header\n", *(f"float64 {name}\n" for name in fields), _HEADER])
    with path.open("wb") as stream:
        writer = writing.Writer(stream, chunk_size=_CHUNK_BYTES)
        writer.start("ros2", "ohmward")
        schema = writer.register_schema(TABLE_TYPE, "ros2msg", definition.encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for first in range(0, rows, _WRITTEN_ROWS):
            block = slice(first, first + _WRITTEN_ROWS)
            messages = _messages(time_ns[block], [values[block] for values in numeric.values()])
            for at_ns, message in zip(time_ns[block].tolist(), messages, strict=True):
                writer.add_message(channel, at_ns, message, at_ns)
            if progress:
                progress(min(block.stop, rows), rows)
        writer.finish()


def _times_ns(columns: Mapping[str, np.ndarray], rows: int) -> np.ndarray:
    """Time of each row (T,) as int64 [ns], clipped at 1970, before which MCAP has no times."""
    name = next((name for name in ("unix_time_s", "time_s") if name in columns), None)
    time_s = np.arange(rows, dtype=float) if name is None else columns[name].astype(float)
    seconds = np.floor(time_s)
    return np.maximum(seconds.astype(np.int64) * 10**9 + np.rint((time_s - seconds) * 1e9).astype(np.int64), 0)


def _field_names(names: list[str]) -> list[str]:
    """Unique field names that a message may have: letters, digits and single underscores, a letter first."""
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_") or "column"
        plain = plain if plain[0].isalpha() else f"column_{plain}"
        same = sum(field == plain or field.startswith(f"{plain}_again") for field in fields)
        fields.append(f"{plain}_again{same}" if same else plain)
    return fields


def _messages(time_ns: np.ndarray, columns: list[np.ndarray]) -> list[bytes]:
    """One message for each row."""
    table = np.zeros(time_ns.size, dtype=[*_BEFORE, *((f"f{k}", "<f8") for k in range(len(columns)))])
    table["encoding"], table["frame_length"] = _LITTLE_ENDIAN_CDR, _LENGTH_OF_EMPTY
    table["sec"], table["nanosec"] = np.divmod(time_ns, 10**9)
    for k, values in enumerate(columns):
        table[f"f{k}"] = values
    whole, size = table.tobytes(), table.dtype.itemsize
    return [whole[at : at + size] for at in range(0, len(whole), size)]


#: Endings of tables that can be written.
TABLES = (".csv", ".parquet", ".mcap")


def write_log(log: LogSource, path: str | PathLike[str]) -> None:
    """Write a log in the format of the suffix: .csv, .parquet, .mcap, .bdf.csv or .bdf.parquet; current > 0 charges.

    >>> ow.write_log("day.csv", "day.parquet")
    >>> len(ow.read_log("day.parquet"))
    33744

    CSV, Parquet and MCAP use ohmward's own names (time_s, current_A, voltage_V, temperature_degC, unix_time_s), BDF
    those of the Battery Data Format. The extra columns follow under their own names; notes are not written.

    Raises:
        InputError: an unknown suffix, or an extra column with the name of a measured one.
        OhmwardError: the file cannot be written, Parquet without pyarrow, MCAP without mcap.
    """
    path = path_of(path)
    log = as_log(log)
    own = log.measured()
    if is_bdf(path.name):
        own = {BDF_NAMES[field][0]: values for field, values in own.items()}
    if taken := own.keys() & log.extra.keys():
        raise InputError(f"log {log.name!r}: the extra column {min(taken)!r} has the name of a measured one; rename it")
    write_table({**own, **log.extra}, path)


def write_table(columns: Mapping[str, np.ndarray], path: str | PathLike[str], progress: Progress | None = None) -> None:
    """Write named columns (T,) as .csv, .parquet or .mcap; numbers keep every digit, NaN is an empty cell in CSV.

    >>> run = ow.SocEstimator(ow.load_battery("battery.toml")).run("day.csv")
    >>> ow.write_table({"time_s": run.time_s, "soc": run.soc, "soc_std": run.soc_std}, "soc.csv")

    progress: called now and then with the rows written and the total.

    Raises:
        InputError: an unknown suffix, or columns of different lengths.
        OhmwardError: the file cannot be written, Parquet without pyarrow, MCAP without mcap.
    """
    require_mappings(columns=columns)
    path, columns = path_of(path), {name: np.asarray(values) for name, values in columns.items()}
    if many := [name for name, values in columns.items() if values.ndim != 1]:
        shape = columns[many[0]].shape
        raise InputError(f"{path.name}: column {many[0]!r} has the shape {shape}; give every column one value per row")
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{path.name}: columns differ in length: {lengths}; give every column one value per row")
    writers = dict(zip(TABLES, (_write_csv, write_parquet, write_mcap), strict=True))
    if path.suffix.lower() not in writers:
        raise InputError(f"{path.name}: unknown suffix {path.suffix!r}; name the file .csv, .parquet or .mcap")
    with replacing(path) as temporary:
        writers[path.suffix.lower()](temporary, columns, progress)


def _write_csv(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    rows = len(next(iter(columns.values()), ()))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for start in range(0, rows, _WRITTEN_ROWS):
            block = [values[start : start + _WRITTEN_ROWS] for values in columns.values()]
            if (text := rows_as_text(block)) is not None:
                stream.write(text)
            else:
                # Python numbers, which are written with every digit; None is an empty cell
                cells = [[None if value != value else value for value in values.tolist()] for values in block]
                writer.writerows(zip(*cells, strict=True))
            if progress:
                progress(start + len(block[0]), rows)


#: Number of rows from which importing Arrow pays off.
WORTH_ROWS = 20_000


def rows_as_text(columns: Sequence[np.ndarray]) -> str | None:
    """Rows as the standard library writes them, made by Arrow; None if a column is not numeric or rows are few."""
    # the standard library quotes a row of one empty cell, so that its line is not empty
    if len(columns) < 2 or len(columns[0]) < WORTH_ROWS or any(c.dtype.kind not in "fiu" for c in columns):
        return None
    if (arrow := import_arrow()) is None:
        return None
    from pyarrow import csv

    cells = [_cells(arrow, values) for values in columns]
    table = arrow.Table.from_arrays(cells, [str(k) for k in range(len(cells))])
    sink = arrow.BufferOutputStream()
    csv.write_csv(table, sink, csv.WriteOptions(include_header=False, quoting_style="none"))
    return sink.getvalue().to_pybytes().decode("ascii")


def _cells(arrow: ModuleType, values: np.ndarray):
    """The text of every number as Python writes it, null for NaN."""
    from pyarrow import compute

    if values.dtype.kind != "f":
        return compute.cast(arrow.array(values), arrow.string())
    values = values.astype(float, copy=False)
    size = np.abs(values)
    missing = np.isnan(values)
    text = compute.cast(arrow.array(values, mask=missing), arrow.string())
    # both write the shortest digits; Python adds a point to whole numbers, and starts exponents at other sizes
    whole = (values == np.rint(values)) & (size < 1e10)
    if whole.any():
        pointed = compute.binary_join_element_wise(text, ".0", "")
        text = compute.if_else(arrow.array(whole), pointed, text)
    odd = ~whole & ~missing & ((size < 1e-4) | (size >= 1e10))
    if odd.any():
        spelled = arrow.array([repr(value) for value in values[odd].tolist()], arrow.string())
        text = compute.replace_with_mask(text, arrow.array(odd), spelled)
    return text
