"""DataFrames (of pandas, polars, Arrow, DuckDB and whatever else streams Arrow) and Parquet files as tables.

Values of any kind (lists, NumPy, pandas, Arrow) become plain arrays: numbers, dates, durations or text.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import UTC, date, timedelta
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.cells import with_decimal_commas
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Progress, Table, TableFile, parsing, require_unique, row_numbers
from ohmward.optional import require

#: Name of a DataFrame without one in its `attrs`.
UNNAMED = "DataFrame"


def plain_array(values: Any) -> np.ndarray:
    """The values as numbers (int or float), datetime64[ns] in UTC, timedelta64[ns] or text (dtype object).

    None, NaN, NaT, pandas' NA and masked NumPy values are missing: NaN in numbers, NaT in dates and durations, empty
    in text. Dates with a time zone are converted to UTC, dates without one assumed UTC. Numbers are not copied.
    """
    if hasattr(values, "isna") and not isinstance(values.dtype, np.dtype):
        values = _from_extension(values)
    if isinstance(values, np.ma.MaskedArray):
        values = _without_masked(values)
    array = np.asarray(values)
    if array.dtype.kind == "M":
        return array.astype("datetime64[ns]", copy=False)
    if array.dtype.kind == "m":
        return array.astype("timedelta64[ns]", copy=False)
    if array.dtype.kind == "b" or array.dtype == np.float16:  # those end at 65,504, with no room for a Unix time
        return array.astype(float)
    return array if array.dtype.kind in "iuf" else _from_objects(array)


def _without_masked(values: np.ma.MaskedArray) -> np.ndarray:
    """The values, with masked ones set to missing."""
    plain, mask = np.asarray(values.data), np.ma.getmaskarray(values)
    if plain.dtype.kind in "iufb":
        return np.where(mask, np.nan, plain)
    if plain.dtype.kind in "mM":
        return np.where(mask, np.array("NaT", plain.dtype), plain)
    return np.where(mask, np.array(None, object), plain.astype(object))


def _from_extension(values: Any) -> Any:
    """Convert a column of a pandas type (with time zone or NA) to the equivalent NumPy type, else to objects."""
    kind = values.dtype.kind
    if kind in "mM":
        return values.to_numpy("datetime64[ns]" if kind == "M" else "timedelta64[ns]")
    if kind in "iu" and not values.isna().any():
        return values.to_numpy(np.int64)
    return values.to_numpy(float, na_value=np.nan) if kind in "biuf" else values.to_numpy(object)


def _from_objects(array: np.ndarray) -> np.ndarray:
    """Python's dates, durations and numbers as arrays of NumPy; all else as text."""
    cells = array.ravel().tolist()
    known = [cell for cell in cells if not _is_missing(cell)]
    if known and all(isinstance(cell, date | np.datetime64) for cell in known):
        moments = [np.datetime64("NaT") if _is_missing(cell) else _moment(cell) for cell in cells]
        return np.array(moments, "datetime64[ns]").reshape(array.shape)
    if known and all(isinstance(cell, timedelta | np.timedelta64) for cell in known):
        return np.array([None if _is_missing(cell) else cell for cell in cells], "timedelta64[ns]").reshape(array.shape)
    if not any(isinstance(cell, str | bytes) for cell in known):
        try:
            return np.array([np.nan if _is_missing(cell) else float(cell) for cell in cells]).reshape(array.shape)
        except (TypeError, ValueError):
            pass  # not a number: returned as text, which shows the caller what it is
    text = np.empty(len(cells), dtype=object)
    text[:] = ["" if _is_missing(cell) else str(cell) for cell in cells]
    return text.reshape(array.shape)


def _is_missing(cell: Any) -> bool:
    return cell is None or type(cell).__name__ in ("NAType", "NaTType") or (np.isscalar(cell) and cell != cell)


def _moment(cell: Any) -> np.datetime64:
    if hasattr(cell, "to_datetime64"):  # a Timestamp of pandas, to the nanosecond
        return cell.to_datetime64()
    zone = getattr(cell, "tzinfo", None)
    return np.datetime64(cell.astimezone(UTC).replace(tzinfo=None) if zone else cell, "ns")


def import_arrow() -> ModuleType | None:
    """The package pyarrow, or None."""
    try:
        import pyarrow
    except ImportError:
        return None
    return pyarrow


def flattened(table: Any) -> Any:
    """An Arrow table with the fields of its structures as columns, `battery.voltage`, at any depth."""
    while any(str(field.type).startswith("struct<") for field in table.schema):
        table = table.flatten()
    return table


def _leaves(field: Any) -> Iterator[str]:
    """The names of the columns of a field in a `flattened` table."""
    if not str(field.type).startswith("struct<"):
        yield field.name
        return
    yield from (f"{field.name}.{name}" for inner in field.type for name in _leaves(inner))


def numbers_of(column: Any) -> np.ndarray:
    """An Arrow column of numbers as (T,) int64 or float64, NaN where one is missing."""
    bare = type(column).from_buffers(column.type, len(column), [None, column.buffers()[1]], offset=column.offset)
    values = np.from_dlpack(bare)
    if column.null_count:
        return np.where(np.from_dlpack(column.is_null().cast("uint8")), np.nan, values.astype(float))
    return values.astype(np.int64 if values.dtype.kind in "iu" else float, copy=False)


def to_column(pyarrow: ModuleType, values: Any) -> Any:
    """An array as an Arrow column, contiguous numbers without a copy."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        return pyarrow.array(values)
    native = np.ascontiguousarray(array, array.dtype.newbyteorder("="))
    buffers = [None, pyarrow.py_buffer(native)]
    return pyarrow.Array.from_buffers(pyarrow.from_numpy_dtype(native.dtype), native.size, buffers)


def values_of(column: Any) -> np.ndarray:
    """Numbers as float64 or int64 (NaN for null), dates and durations as such, everything else as text."""
    kind = str(column.type)
    if kind.startswith(("timestamp", "date")):
        return _numpy(column).astype("datetime64[ns]")
    if kind.startswith(("int", "uint", "float", "double", "halffloat")):
        return numbers_of(column)
    if kind.startswith("duration"):
        return _numpy(column).astype("timedelta64[ns]")
    if kind.startswith(("decimal", "bool")):
        return _numpy(column.cast("float64"))
    return np.array(["" if value is None else str(value) for value in column.to_pylist()], dtype=object)


def _numpy(column: Any) -> np.ndarray:
    return column.to_numpy(zero_copy_only=False)


def is_frame(source: Any) -> bool:
    """True for a DataFrame of pandas or similar, and for a frame that streams Arrow, directly or once collected.

    Also for a dict of arrays, and for an array with named fields.
    """
    has_columns = any(hasattr(type(source), name) for name in ("columns", "column_names", "schema"))
    streams = hasattr(source, "__arrow_c_stream__") or hasattr(type(source), "collect")
    has_fields = isinstance(source, np.ndarray) and source.dtype.names is not None
    return _is_of_pandas(source) or (has_columns and streams) or has_fields or isinstance(source, Mapping)


def _is_of_pandas(source: Any) -> bool:
    return all(hasattr(type(source), name) for name in ("iloc", "to_numpy")) and getattr(source, "ndim", 0) == 2


def open_frame(frame: Any) -> TableFile:
    """The columns of a DataFrame, and for pandas its index too if it has a name or holds the time.

    An index of dates, of durations or of unnamed floats is the time unless `columns` says otherwise.

    Raises:
        InputError: several levels of columns or index, a repeated name, arrays of several lengths, or (on loading) no
            rows.
        OhmwardError: pyarrow, which reads all frames but those of pandas, is not installed.
    """
    if isinstance(frame, Mapping | np.ndarray):
        names = frame if isinstance(frame, Mapping) else frame.dtype.names or ()
        return _open_arrays({str(name): frame[name] for name in names})
    return _open_pandas(frame) if _is_of_pandas(frame) else _open_stream(frame)


def _open_arrays(columns: Mapping[str, Any]) -> TableFile:
    arrays = {name: plain_array(values) for name, values in columns.items()}
    if len({array.shape for array in arrays.values()}) > 1 or any(array.ndim != 1 for array in arrays.values()):
        shapes = ", ".join(f"{name!r} {array.shape}" for name, array in arrays.items())
        raise InputError(f"the columns must have one dimension and one length; they have: {shapes}")
    rows = next((array.size for array in arrays.values()), 0)
    return _table_file("columns", rows, list(arrays), list(arrays.values()).__getitem__)


def _open_stream(source: Any) -> TableFile:
    """The columns of a frame that streams Arrow; a lazy one is collected, a stream is read once."""
    pyarrow = require("pyarrow", f"a frame of {type(source).__module__.partition('.')[0]}")
    try:
        table = pyarrow.table(source if hasattr(source, "__arrow_c_stream__") else source.collect())
    except (TypeError, ValueError, pyarrow.ArrowException) as error:
        raise InputError(
            f"the {type(source).__name__} gives no columns of Arrow ({error}); give one of pandas"
        ) from error
    table = flattened(table)
    names = [str(name) for name in table.column_names]
    require_unique(UNNAMED, names)
    return _table_file(UNNAMED, table.num_rows, names, lambda at: values_of(table.column(at).combine_chunks()))


def _table_file(
    source: str, rows: int, columns: Sequence[str], column: Callable[[int], np.ndarray], time: str | None = None
) -> TableFile:
    """The TableFile of columns (rows,); column: makes the array at a given position on demand."""

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        if not rows:
            raise InputError("the DataFrame has no rows; a log needs samples")
        chosen = {name: column(at) for at, name in enumerate(columns) if name in names}
        return Table(source, with_decimal_commas(chosen), row_numbers(1, rows), "row")

    return TableFile(source, tuple(columns), load, time)


def _open_pandas(frame: Any) -> TableFile:
    if frame.columns.nlevels > 1 or frame.index.nlevels > 1:
        raise InputError("the DataFrame has several levels of columns or index; flatten them, as with reset_index()")
    names = [str(name) for name in frame.columns]
    require_unique(UNNAMED, names)
    index, time = _index(frame, names)
    columns = [*index.values(), *(frame.iloc[:, at] for at in range(len(names)))]
    source = str(frame.attrs.get("name", UNNAMED))
    return _table_file(source, len(frame), [*index, *names], lambda at: plain_array(columns[at]), time)


def _index(frame: Any, columns: Collection[str]) -> tuple[dict[str, np.ndarray], str | None]:
    """The index by its name, empty if it only counts the rows; and its name if it is the time, else None."""
    values = plain_array(frame.index)
    name = frame.index.name
    is_time = values.dtype.kind in "mM" or (values.dtype.kind == "f" and name is None)
    if name is None and not is_time:
        return {}, None
    name = next(free for free in (str(name or "time"), "index", "time of the index") if free not in columns)
    return {name: values}, name if is_time else None


def to_frame(columns: Mapping[str, np.ndarray], name: str) -> Any:
    """A DataFrame of columns (T,), indexed by the one called `time_s`; `name` is stored in its `attrs`."""
    pandas = require("pandas", "a DataFrame")
    frame = pandas.DataFrame(dict(columns)).set_index("time_s")
    frame.attrs["name"] = name
    return frame


#: Rows decoded at a time, so that Arrow needs little memory besides the columns.
_DECODED_ROWS = 1 << 18
#: Rows of a row group in a written file.
_GROUP_ROWS = 1 << 20


def open_parquet(path: Path, hints: FileHints) -> TableFile:
    """The columns of a Parquet file, read on demand."""
    pyarrow, parquet = _pyarrow()
    with parsing(path, "not a readable Parquet file", "write it again"):
        stored = tuple(name for field in parquet.read_schema(path) for name in _leaves(field))
    require_unique(path.name, stored)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        try:
            with parquet.ParquetFile(path, pre_buffer=False) as file:  # buffering would hold the whole file
                rows = file.metadata.num_rows
                columns = _columns(file, [name for name in stored if name in names], progress)
            pyarrow.default_memory_pool().release_unused()  # Arrow would keep its decoding buffers
        except MemoryError:  # Arrow's own is also an ArrowException
            raise
        except (pyarrow.ArrowException, OSError) as error:
            raise InputError(f"{path.name}: the Parquet file is damaged ({error}); write it again") from error
        if not rows:
            raise InputError(f"{path.name}: the file has columns but no rows; a log needs samples")
        return Table(path.name, with_decimal_commas(columns), row_numbers(1, rows), "row")

    return TableFile(path.name, stored, load, hints=hints)


def _columns(file: Any, names: list[str], progress: Progress | None) -> dict[str, np.ndarray]:
    """The columns (T,) of a file, read block by block into full-length arrays; none if there are no rows."""
    pyarrow, _ = _pyarrow()
    rows = file.metadata.num_rows
    columns: dict[str, np.ndarray] = {}
    first = 0
    for batch in file.iter_batches(_DECODED_ROWS, columns=names, use_threads=rows > _DECODED_ROWS):
        last = first + batch.num_rows
        table = flattened(pyarrow.Table.from_batches([batch]))
        for name in names:
            values = values_of(table[name].chunk(0))
            if name not in columns:
                columns[name] = np.empty(rows, values.dtype)
            elif columns[name].dtype != values.dtype:  # integers up to the first block with a missing value
                columns[name] = columns[name].astype(np.result_type(columns[name], values))
            columns[name][first:last] = values
        first = last
        if progress:
            progress(first, rows)
    return columns


def write_parquet(path: Path, columns: Mapping[str, np.ndarray], progress: Progress | None = None) -> None:
    """Write columns (T,) as Parquet with zstd; NaN stays NaN.

    progress: called now and then with the rows written and the total.
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
