"""Columns of rows of the store: `unix_ns` and numbers, from files of the archive, put together and thinned."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from ohmward.errors import OhmwardError
from ohmward.optional import require


def quoted(name: str) -> str:
    """A name as SQL takes it, whatever it holds."""
    return '"' + name.replace('"', '""') + '"'


def read_archive(path: Path, names: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Columns of a file of the archive.

    Raises:
        OhmwardError: it is missing or damaged.
    """
    parquet = require("pyarrow.parquet", "the archive of the store")
    try:
        file = parquet.ParquetFile(path)
        wanted = [n for n in file.schema_arrow.names if names is None or n in names or n == "unix_ns"]
        table = file.read(columns=wanted)
    except (OSError, ValueError) as error:
        raise OhmwardError(f"{path}: cannot be read ({error})") from error
    return {name: table.column(name).to_numpy() for name in wanted}


def joined(pieces: Sequence[dict[str, np.ndarray]], names: Sequence[str] | None) -> dict[str, np.ndarray]:
    """Pieces one after the other; a column that a piece lacks is nan there."""
    found = dict.fromkeys(name for piece in pieces for name in piece if name != "unix_ns")
    wanted = list(found) if names is None else [name for name in names if name in found]
    whole = {"unix_ns": np.concatenate([piece["unix_ns"] for piece in pieces])}
    for name in wanted:
        columns = [piece.get(name, np.full(len(piece["unix_ns"]), np.nan)) for piece in pieces]
        whole[name] = np.concatenate(columns)
    return whole


def between(columns: dict[str, np.ndarray], first_ns: int, last_ns: int) -> dict[str, np.ndarray]:
    """Rows of a span of time, both ends belong to it, in the order of time."""
    time_ns = columns["unix_ns"]
    inside = (time_ns >= first_ns) & (time_ns <= last_ns)
    order = np.argsort(time_ns[inside], kind="stable")
    return {name: column[inside][order] for name, column in columns.items()}


def first_of_each(columns: dict[str, np.ndarray], step_ns: int) -> dict[str, np.ndarray]:
    """First row of each step, whose edges are multiples of it; rows in the order of time."""
    first = np.unique(columns["unix_ns"] // step_ns, return_index=True)[1]
    return {name: column[first] for name, column in columns.items()}


@lru_cache(maxsize=4096)
def thinned_archive(path: Path, names: tuple[str, ...], step_ns: int) -> dict[str, np.ndarray]:
    """First row of each step of a file of the archive; a file never changes, so it is read once.

    Raises:
        OhmwardError: see `read_archive`.
    """
    columns = read_archive(path, names)
    return first_of_each(between(columns, 0, int(columns["unix_ns"].max(initial=0))), step_ns)
