"""DataFrames as tables to read: of pandas, polars, Arrow, DuckDB and whatever else streams Arrow; all are optional."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array
from ohmward.logs.arrow import values_of
from ohmward.logs.table import Progress, Table, TableFile, row_numbers
from ohmward.optional import require


def is_frame(source: Any) -> bool:
    """True for a DataFrame of pandas or its kin, and for what streams Arrow, or does when it is collected."""
    has_columns = any(hasattr(type(source), name) for name in ("columns", "column_names", "schema"))
    streams = hasattr(source, "__arrow_c_stream__") or hasattr(type(source), "collect")
    return _is_of_pandas(source) or (has_columns and streams)


def _is_of_pandas(source: Any) -> bool:
    return all(hasattr(type(source), name) for name in ("iloc", "to_numpy")) and getattr(source, "ndim", 0) == 2


def open_frame(frame: Any) -> TableFile:
    """The columns of a DataFrame; of pandas its index too where it has a name or tells the time.

    An index of dates, of durations or of numbers without a name is the time unless `columns` says otherwise.

    Raises:
        InputError: several levels of columns or index, a name twice, or (on loading) no rows.
        OhmwardError: pyarrow, which reads the frames of others than pandas, is not installed.
    """
    return _open_pandas(frame) if _is_of_pandas(frame) else _open_stream(frame)


def _open_stream(source: Any) -> TableFile:
    """The columns of a frame that streams Arrow; a lazy one is collected, a stream is read once."""
    pyarrow = require("pyarrow", f"a frame of {type(source).__module__.partition('.')[0]}")
    try:
        table = pyarrow.table(source if hasattr(source, "__arrow_c_stream__") else source.collect())
    except (TypeError, ValueError, pyarrow.ArrowException) as error:
        raise InputError(
            f"the {type(source).__name__} gives no columns of Arrow ({error}); give one of pandas"
        ) from error
    names = [str(name) for name in table.column_names]
    _require_unique(names)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        if not table.num_rows:
            raise InputError("the DataFrame has no rows; a log needs samples")
        arrays = {name: values_of(table[name].combine_chunks()) for name in table.column_names if name in names}
        return Table("DataFrame", arrays, row_numbers(1, table.num_rows), "row")

    return TableFile("DataFrame", tuple(names), load)


def _require_unique(names: Sequence[str]) -> None:
    """Raise InputError where a name stands twice."""
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"DataFrame: more than one column is named {twice!r}; rename them so that each is unique")


def _open_pandas(frame: Any) -> TableFile:
    if frame.columns.nlevels > 1 or frame.index.nlevels > 1:
        raise InputError("the DataFrame has several levels of columns or index; flatten them, as with reset_index()")
    _require_unique([str(name) for name in frame.columns])
    columns = {str(name): position for position, name in enumerate(frame.columns)}
    source = str(frame.attrs.get("name", "DataFrame"))
    index, time = _index(frame, columns)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        if not len(frame):
            raise InputError("the DataFrame has no rows; a log needs samples")
        arrays = {name: values for name, values in index.items() if name in names}
        arrays |= {name: plain_array(frame.iloc[:, at]) for name, at in columns.items() if name in names}
        return Table(source, arrays, row_numbers(1, len(frame)), "row")

    return TableFile(source, (*index, *columns), load, time)


def _index(frame: Any, columns: Collection[str]) -> tuple[dict[str, np.ndarray], str | None]:
    """The index by its name, none where it only counts the rows; and its name where it is the time."""
    values = plain_array(frame.index)
    name = frame.index.name
    is_time = values.dtype.kind in "mM" or (values.dtype.kind == "f" and name is None)
    if name is None and not is_time:
        return {}, None
    name = next(free for free in (str(name or "time"), "index", "time of the index") if free not in columns)
    return {name: values}, name if is_time else None


def to_frame(columns: Mapping[str, np.ndarray], name: str) -> Any:
    """A DataFrame of columns (T,) over the one called `time_s`; `name` is in its `attrs`.

    Raises:
        OhmwardError: pandas is not installed.
    """
    pandas = require("pandas", "a DataFrame")
    frame = pandas.DataFrame(dict(columns)).set_index("time_s")
    frame.attrs["name"] = name
    return frame
