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
