"""Arrow, where it is installed, without pandas, which its own conversions import: longer than reading a short log."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np


def import_arrow() -> ModuleType | None:
    """The package pyarrow, or None."""
    try:
        import pyarrow
    except ImportError:
        return None
    return pyarrow


def numbers_of(column: Any) -> np.ndarray:
    """(T,) an Arrow column of numbers as int64 or float64, NaN where one is missing."""
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


def table_of(table: Any) -> dict[str, np.ndarray]:
    """Name -> (T,) of the columns of an Arrow table."""
    return {name: values_of(table[name].combine_chunks()) for name in table.column_names}


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
