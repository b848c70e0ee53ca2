"""Pick the rows of one recording out of a file that holds several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.columns import argument, guess, listed
from ohmward.logs.note import Note
from ohmward.logs.table import Table, numbers

# A column that every file has: 1, 2, ... counted up where the clock starts again.
RECORDING = "recording"
_MOST_SEPARATORS = 3


def select_rows(table: Table, where: Mapping[str, float | str]) -> Table:
    """The rows in which every named column has the wanted value; numbers compare as numbers, all else as text.

    Raises:
        InputError: a column does not exist or no row has the value.
    """
    for name, wanted in where.items():
        picked = _equal(table, name, wanted)
        if not picked.any():
            raise InputError(
                f"{table.source}: no row has {name} = {wanted}; the values are {_distinct(table.columns[name])}"
            )
        note = Note(f"rows with {name} = {wanted}: {picked.sum()} of {picked.size}")
        table = table.pick(picked).with_notes(note)
    return table


def recording_numbers(restarts: np.ndarray, size: int) -> np.ndarray:
    """(T,) 1, 2, ... counted up at every row in `restarts` (K,)."""
    return 1.0 + np.isin(np.arange(size), restarts).cumsum()


def explain_recordings(table: Table, time: str, restarts: np.ndarray) -> str:
    """The message on a clock that starts again at the rows `restarts` (K,): the place, and a way to choose a recording.

    time: the column with the time [s].
    """
    at = int(restarts[0])
    time_s = table.columns[time]
    what = (
        f"{table.source} holds several recordings: the time falls from {time_s[at - 1]:g} s to {time_s[at]:g} s "
        f"at {table.place} {table.line[at]}"
    )
    separators = find_separators(table, time, restarts)
    if not separators:
        return (
            f"{what}, and no column tells them apart; choose one by its number with --where {RECORDING}=1 "
            f"(where={{{RECORDING!r}: 1}}; there are {restarts.size + 1}), or split the file"
        )
    values = " and ".join(f"{name!r} ({_distinct(table.columns[name])})" for name in separators)
    example = {name: _plain(table.columns[name][0]) for name in separators}
    options = " ".join(f"--where {argument(f'{name}={value}')}" for name, value in example.items())
    return f"{what}; they are told apart by {values}; choose one, for example {options} (where={example})"


def find_separators(table: Table, time: str, restarts: np.ndarray) -> tuple[str, ...]:
    """The fewest columns such that the time never falls among the rows that share their values; () if there are none.

    Only columns that change about as often as the clock starts again are labels of recordings.

    time: the column with the time [s]; restarts: (K,) rows at which it falls.
    """
    changes = {name: _changes(values) for name, values in table.columns.items() if name != time}
    labels = {name: rows for name, rows in changes.items() if 0 < rows.size <= 2 * (restarts.size + 1)}
    starts = np.unique(np.concatenate([[0], restarts, *labels.values()])).astype(int)
    time_s = table.columns[time]
    first = time_s[starts]
    last = time_s[np.append(starts[1:], time_s.size) - 1]
    codes = {name: np.unique(table.columns[name][starts], return_inverse=True)[1] for name in labels}
    for count in range(1, _MOST_SEPARATORS + 1):
        for names in combinations(codes, count):
            if _rises([codes[name] for name in names], first, last):
                return names
    return ()


def _rises(codes: Sequence[np.ndarray], first: np.ndarray, last: np.ndarray) -> bool:
    """True where runs of rows with the same codes follow each other in time; first, last: (N,) times of each [s]."""
    order = np.lexsort((np.arange(first.size), *codes))
    same = np.all([np.diff(code[order]) == 0 for code in codes], axis=0)
    pause = first[order][1:] - last[order][:-1]
    follows = (pause > 0) | ((pause == 0) & (np.diff(order) == 1))
    return bool(np.all(follows[same]))


def _equal(table: Table, name: str, wanted: float | str) -> np.ndarray:
    if name not in table.columns:
        raise InputError(
            f"{table.source}: cannot select by {name!r}: there is no such column{guess(name, list(table.columns))}; "
            f"it has: {listed(list(table.columns))}"
        )
    values = table.columns[name]
    if values.dtype.kind in "fium":
        try:
            return np.isclose(numbers(table, name), float(wanted), rtol=1e-9, atol=0.0)
        except ValueError:
            return np.zeros(values.size, dtype=bool)
    return values.astype(str) == str(wanted)


def _changes(values: np.ndarray) -> np.ndarray:
    """Rows whose value differs from that of the row before."""
    return np.flatnonzero(values[1:] != values[:-1]) + 1


def _distinct(values: np.ndarray, most: int = 8) -> str:
    distinct = list(dict.fromkeys(_plain(value) for value in values[np.concatenate([[0], _changes(values)])]))
    return ", ".join(str(value) for value in distinct[:most]) + (", ..." if len(distinct) > most else "")


def _plain(value) -> float | int | str:
    """A number without its NumPy type, whole where it is whole; anything else as text."""
    if not isinstance(value, int | float | np.number):
        return str(value)
    return int(value) if float(value).is_integer() else float(value)
