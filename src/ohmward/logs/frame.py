"""DataFrames of pandas as tables to read, and as tables to look at; pandas itself is optional."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array
from ohmward.logs.table import Progress, Table, TableFile, row_numbers
from ohmward.optional import require


def is_frame(source: Any) -> bool:
    """True where the source is a DataFrame of pandas, or of one of its kin with the same columns and index."""
    return all(hasattr(source, name) for name in ("columns", "index", "iloc", "to_numpy")) and source.ndim == 2


def open_frame(frame: Any) -> TableFile:
    """The columns of a DataFrame, and its index where it has a name or tells the time.

    An index of dates, of durations or of numbers without a name is the time unless `columns` says otherwise.

    Raises:
        InputError: several levels of columns or index, a name twice, or (on loading) no rows.
    """
    if frame.columns.nlevels > 1 or frame.index.nlevels > 1:
        raise InputError("the DataFrame has several levels of columns or index; flatten them, as with reset_index()")
    columns = {str(name): position for position, name in enumerate(frame.columns)}
    if len(columns) < frame.shape[1]:
        names = [str(name) for name in frame.columns]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"DataFrame: more than one column is named {twice!r}; rename them so that each is unique")
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
