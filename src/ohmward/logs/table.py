"""A file as columns, before anyone decides what they mean."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import numpy as np

from ohmward.logs.log import Note


class Table(NamedTuple):
    """Columns of one file and where each row stands in it.

    source: the file's name, for messages.
    columns: name -> (T,); numbers, datetime64, or text (dtype object).
    line: (T,) int, the row's line in a text file or its number (from 1) in a Parquet file.
    place: what `line` counts, "line" or "row", for messages.
    notes: what the reader dropped.
    """

    source: str
    columns: Mapping[str, np.ndarray]
    line: np.ndarray
    place: str
    notes: tuple[Note, ...] = ()

    def pick(self, rows: np.ndarray) -> Table:
        """The rows that a mask or indices pick."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return self._replace(columns=columns, line=self.line[rows])


class TableFile(NamedTuple):
    """A file whose column names are known and whose columns are read on demand.

    source: the file's name, for messages.
    names: the columns in the file's order.
    load: reads the named columns into a Table.
    """

    source: str
    names: tuple[str, ...]
    load: Callable[[Collection[str]], Table]
