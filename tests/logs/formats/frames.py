"""Damaged DataFrames of pandas, polars and Arrow: cells, types, names and indices as programs leave them."""

from __future__ import annotations

import warnings
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from typing import Any

import numpy as np
import pandas
import polars
import pyarrow

from logs.formats.containers import COLUMNS
from logs.formats.known import LOG

_CELLS = (
    None, np.nan, np.inf, -np.inf, 0, -1, True, 1e308, 10**30, "", "12.5", "nan", "a", b"\xff", Decimal("1.5"),
    datetime(2026, 3, 28, tzinfo=UTC), datetime(2026, 3, 28), date(1, 1, 1), timedelta(days=-1), [1, 2], {"a": 1},
    1 + 2j, object(), np.datetime64("NaT"), pandas.NaT, pandas.NA, np.float32(3), "2026-03-28T09:15:00+02:00",
)  # fmt: skip
_TYPES = (
    "float32", "float16", "int64", "int8", "uint64", "bool", "object", "str", "category", "Int64", "Float64", "string",
    "complex128", "datetime64[ns]", "timedelta64[s]", "datetime64[ms, Europe/Berlin]", "boolean",
)  # fmt: skip
_NAMES = ("", " ", "time_s", "current_A", "Voltage [mV]", "T", 3, 2.5, None, ("a", "b"), "x" * 1000, "time", "v\n1")


def damaged_frame(rng: np.random.Generator) -> Any:
    """The known log as a DataFrame with one to four changes, every third one of polars or Arrow."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return _damaged(rng)


def _damaged(rng: np.random.Generator) -> Any:
    rows = int(rng.choice([0, 1, 2, 30, LOG.time_s.size]))
    frame = pandas.DataFrame({name: values[:rows] for name, values in COLUMNS.items()})
    for _ in range(rng.integers(1, 5)):
        try:
            frame = _changed(frame, rng)
        except (ValueError, TypeError, OverflowError, IndexError, KeyError, AttributeError, NotImplementedError):
            continue  # a change that pandas does not allow
    # pyarrow itself crashes on cells that it has no type for
    is_plain = not any(one.dtype == object for one in (frame.index, *(column for _, column in frame.items())))
    kind = int(rng.integers(3)) if is_plain else 0
    try:
        table = pyarrow.Table.from_pandas(frame) if kind else None
    except (pyarrow.ArrowException, ValueError, TypeError, OverflowError, AttributeError):
        return frame
    if kind == 1:
        return table
    try:
        return frame if table is None else polars.from_arrow(table)
    except (polars.exceptions.PolarsError, ValueError, TypeError):
        return table


def _changed(frame: pandas.DataFrame, rng: np.random.Generator) -> pandas.DataFrame:
    """One change: of a cell, a type, a name, the index, the order or the number of rows, a column more or less."""
    kind, at = int(rng.integers(10)), int(rng.integers(max(frame.shape[1], 1)))
    names = list(frame.columns)
    if kind < 3:
        cells = frame.iloc[:, at].astype(object).tolist()
        for _ in range(rng.integers(1, 4)):
            cells[rng.integers(len(cells))] = _CELLS[rng.integers(len(_CELLS))]
        frame = frame.astype({names[at]: object})
        frame[names[at]] = pandas.Series(cells, frame.index, dtype=object)
    elif kind in (3, 4):
        frame = frame.astype({names[at]: _TYPES[rng.integers(len(_TYPES))]})
    elif kind == 5:
        names[at] = _NAMES[rng.integers(len(_NAMES))]
        frame.columns = pandas.Index(names, tupleize_cols=False)
    elif kind == 6:
        frame = frame.set_index(names[: int(rng.integers(1, 3))])
    elif kind == 7:
        frame = frame.iloc[rng.integers(0, len(frame), len(frame))]
    elif kind == 8:
        frame = frame.drop(columns=names[at])
    else:
        frame.index = pandas.Index([_CELLS[rng.integers(len(_CELLS))] for _ in range(len(frame))], dtype=object)
    return frame
