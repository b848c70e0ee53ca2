"""Values of any kind (lists, NumPy, pandas, Arrow) as plain arrays: numbers, dates, durations or text."""

from __future__ import annotations

from datetime import UTC, date, timedelta
from types import ModuleType
from typing import Any

import numpy as np


def plain_array(values: Any) -> np.ndarray:
    """The values as numbers (int or float), datetime64[ns] in UTC, timedelta64[ns] or text (dtype object).

    None, NaN, NaT, pandas' NA and what NumPy masks are missing: NaN among numbers, NaT among dates and durations, an
    empty text. Dates with a time zone become UTC, dates without one are taken as UTC. Numbers are not copied.
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
    if array.dtype.kind == "b":
        return array.astype(float)
    return array if array.dtype.kind in "iuf" else _from_objects(array)


def _without_masked(values: np.ma.MaskedArray) -> np.ndarray:
    """The values, those that are masked missing."""
    plain, mask = np.asarray(values.data), np.ma.getmaskarray(values)
    if plain.dtype.kind in "iufb":
        return np.where(mask, np.nan, plain)
    if plain.dtype.kind in "mM":
        return np.where(mask, np.array("NaT", plain.dtype), plain)
    return np.where(mask, np.array(None, object), plain.astype(object))


def _from_extension(values: Any) -> Any:
    """A column of a type of pandas' own (with a time zone, with NA) as one of NumPy where there is a like one."""
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
            pass  # something that is no number: its text says to the caller what it is
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
