"""Make the time of a table increase: late rows, clocks that start again, equal times."""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.note import Note, counted
from ohmward.logs.selection import explain_recordings
from ohmward.logs.table import Table


class SeveralRecordingsError(InputError):
    """A file holds several recordings, and one must be chosen."""


# More rows than this fraction out of order are not a few that were written late.
_MOST_LATE = 0.05


def find_restarts(time_s: np.ndarray) -> np.ndarray:
    """(K,) rows at which the time falls by more than rows that were merely written late explain.

    time_s: (T,) [s], finite. A row is late when it stands after a row that is at most one median interval younger.
    """
    steps = np.diff(time_s)
    rising = steps[steps > 0]
    typical = np.median(rising) if rising.size else 0.0
    return np.flatnonzero(-steps > typical) + 1


def sort_rows(table: Table, time: str, *, sort_time: bool = False) -> Table:
    """The rows in order of time.

    A few late rows are sorted and noted: each row carries its own time. A larger fall of the time is refused, because
    two recordings would be mixed.

    time: the column with the time [s]; sort_time: sort whatever the file's order.

    Raises:
        InputError: the file holds several recordings, or its time runs backwards.
    """
    time_s = table.columns[time]
    if not (time_s[1:] < time_s[:-1]).any():
        return table
    late = time_s < np.maximum.accumulate(time_s)
    if not sort_time:
        _require_late_rows_only(table, time, late)
    note = Note(f"{counted(late.sum(), 'row')} out of order: sorted by time", "warning" if sort_time else "info")
    return table.pick(np.argsort(time_s, kind="stable")).with_notes(note)


def merge_equal_times(table: Table, time: str) -> Table:
    """One row for each time; of rows with the same time, the last value of each column that is not NaN counts."""
    time_s = table.columns[time]
    later = time_s[1:] > time_s[:-1]
    if later.all():
        return table
    first = np.flatnonzero(np.concatenate([[True], later]))
    columns = {name: _last_known(values, first) for name, values in table.columns.items()}
    repeated = counted(time_s.size - first.size, "row")
    note = Note(f"{repeated} with the time of the row before: the last value of each column kept")
    return table._replace(columns=columns, line=table.line[first]).with_notes(note)


def _require_late_rows_only(table: Table, time: str, late: np.ndarray) -> None:
    """Raise InputError where more is out of order than a few rows that were written `late` (T,)."""
    time_s = table.columns[time]
    steps = np.diff(time_s)
    falls, rises = np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)
    if falls > rises:
        order = "the newest row stands first" if rises < 0.1 * falls else "the rows are shuffled"
        raise InputError(
            f"{table.source}: the time falls from {table.place} to {table.place} {falls:,} times: {order}; "
            "sort the rows with --sort-time (sort_time=True)"
        )
    restarts = find_restarts(time_s)
    if restarts.size:
        before, after = time_s[restarts[0] - 1], time_s[restarts[0]]
        if before - after >= 0.5 * (before - time_s[0]):  # back over most of the time that had passed
            raise SeveralRecordingsError(explain_recordings(table, time, restarts))
    if restarts.size or late.mean() > _MOST_LATE:
        raise InputError(_backwards(table, time_s, late))


def _last_known(values: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(N,) of each group that begins at the rows `first` (N,) the last value that is not NaN."""
    rows = np.where(np.isfinite(values), np.arange(values.size), -1)
    last = np.maximum.reduceat(rows, first)
    return np.where(last >= 0, values[last], np.nan)


def _backwards(table: Table, time_s: np.ndarray, late: np.ndarray) -> str:
    falls = np.flatnonzero(np.diff(time_s) < 0) + 1
    lines = ", ".join(str(table.line[at]) for at in falls[:5]) + (", ..." if falls.size > 5 else "")
    at = int(falls[0])
    return (
        f"{table.source}: the time runs backwards at {table.place} {lines} (first from {time_s[at - 1]:.6f} s to "
        f"{time_s[at]:.6f} s; {late.sum()} of {late.size} rows are late); if every row carries its own right time, "
        "sort them with --sort-time (sort_time=True); if the clock was set, choose a part with --where recording=1 "
        "(where={'recording': 1})"
    )
