"""DataFrames as tables to read: of pandas, polars, Arrow, DuckDB and whatever else streams Arrow; all are optional."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array, values_of
from ohmward.logs.table import Progress, Table, TableFile, require_unique, row_numbers
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
    require_unique("DataFrame", names)
    return _table_file("DataFrame", table.num_rows, names, lambda at: values_of(table.column(at).combine_chunks()))


def _table_file(
    source: str, rows: int, columns: Sequence[str], column: Callable[[int], np.ndarray], time: str | None = None
) -> TableFile:
    """The file of columns (rows,); column: makes the one of a number when it is asked for."""

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        if not rows:
            raise InputError("the DataFrame has no rows; a log needs samples")
        chosen = {name: column(at) for at, name in enumerate(columns) if name in names}
        return Table(source, chosen, row_numbers(1, rows), "row")

    return TableFile(source, tuple(columns), load, time)


def _open_pandas(frame: Any) -> TableFile:
    if frame.columns.nlevels > 1 or frame.index.nlevels > 1:
        raise InputError("the DataFrame has several levels of columns or index; flatten them, as with reset_index()")
    names = [str(name) for name in frame.columns]
    require_unique("DataFrame", names)
    index, time = _index(frame, names)
    columns = [*index.values(), *(frame.iloc[:, at] for at in range(len(names)))]
    source = str(frame.attrs.get("name", "DataFrame"))
    return _table_file(source, len(frame), [*index, *names], lambda at: plain_array(columns[at]), time)


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
