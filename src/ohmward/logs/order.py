"""Make the time of a table increase: late rows, clocks that start again, equal and coarse stamps.

Everywhere `time` is the column of the time [s], and `channels` are the columns that were measured; the time does not
fall but in `find_restarts`, `sort_rows` and `join_steps`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import letters, word_set
from ohmward.logs.selection import (
    count_unnamed_instances,
    explain_instances,
    explain_recordings,
    explain_unnamed_instances,
    find_instances,
    find_separators,
)
from ohmward.logs.table import Note, Table, counted


class SeveralRecordingsError(InputError):
    """A file holds several recordings, and one must be chosen."""

    def __init__(self, text: str, separators: Sequence[str] = ()) -> None:
        super().__init__(text)
        self.separators = tuple(separators)  #: columns that tell apart the parts after which the clock starts again

    @property
    def are_steps(self) -> bool:
        """True where the parts are steps and cycles of one test."""
        return bool(self.separators) and all(_STEPS & set(letters(name)) for name in self.separators)


#: Words in the name of a column that counts the steps of a test.
_STEPS = word_set("step cycle cyc loop schritt zyklus 工步 循环")
# More rows than this fraction out of order are not a few that were written late.
_MOST_LATE = 0.05
#: Where more than this fraction of the rows is measured again at the same time, the stamps are too coarse.
_MOST_REPEATED = 0.2
#: Quantile of the intervals between stamps that is the smallest one, a few odd stamps aside.
_SMALLEST_STEP = 0.01
#: Stamps that are this many times their smallest interval apart have a pause between them.
_PAUSE = 1.5


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

    sort_time: sort whatever the file's order.

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


def join_steps(table: Table, time: str) -> Table:
    """The table with one time for steps whose clock starts again at each: a usual interval after the one before."""
    time_s = table.columns[time]
    steps = np.diff(time_s, prepend=time_s[0])
    restarts = find_restarts(time_s)
    rising = steps[steps > 0]
    steps[restarts] = np.maximum(time_s[restarts], np.median(rising) if rising.size else 1.0)
    note = Note(
        f"the clock in {time!r} starts again {counted(restarts.size, 'time')}, with each step of the test: the steps "
        "are joined; pauses between them are not known",
        "warning",
    )
    return table.with_columns({time: time_s[0] + np.cumsum(steps)}, note)


def require_one_instance(table: Table, time: str, channels: Collection[str]) -> None:
    """Refuse rows of several batteries or robots side by side.

    Raises:
        InputError: names the column that tells them apart, and its values.
    """
    if name := find_instances(table, time, channels):
        raise SeveralRecordingsError(explain_instances(table, name))
    if (count := count_unnamed_instances(table, time, channels)) > 1:
        raise SeveralRecordingsError(explain_unnamed_instances(table, count))


def settle_equal_times(table: Table, time: str, channels: Collection[str]) -> Table:
    """Rows with a time of their own each.

    Rows of one time that hold different channels, or the same values twice, become one row. Rows that measured the
    same channel again are readings of their own: where they are many, the stamps are coarser than the rows, which are
    spread over the interval of the stamps; where they are few, the last one counts, with a warning.
    """
    repeats = find_repeats(table, time, channels)
    if repeats.differ and repeats.again.mean() > _MOST_REPEATED:
        return _spread(table, time)
    return merge_equal_times(table, time, "warning" if repeats.differ else "info")


class Repeats(NamedTuple):
    """Rows of a table that share their time."""

    again: np.ndarray  #: (T,) a channel of the row is measured once more by a later row of the same time
    differ: bool  #: two such measurements have different values


def find_repeats(table: Table, time: str, channels: Collection[str]) -> Repeats:
    """The rows that measured a channel which a later row of the same time measured as well."""
    time_s = table.columns[time]
    again = np.zeros(time_s.size, dtype=bool)
    differ = False
    if (time_s[1:] > time_s[:-1]).all():
        return Repeats(again, differ)
    for name in channels:
        values = table.columns[name]
        if values.dtype.kind not in "fiu":
            continue
        rows = np.flatnonzero(np.isfinite(values))
        same = time_s[rows[1:]] == time_s[rows[:-1]]
        again[rows[:-1][same]] = True
        differ = differ or bool((values[rows[1:]] != values[rows[:-1]])[same].any())
    return Repeats(again, differ)


def merge_equal_times(table: Table, time: str, level: str = "info") -> Table:
    """One row for each time; of rows with the same time, the last value of each column that is not NaN counts.

    level: of the note on it.
    """
    time_s = table.columns[time]
    later = time_s[1:] > time_s[:-1]
    if later.all():
        return table
    first = np.flatnonzero(np.concatenate([[True], later]))
    columns = {name: _last_known(values, first) for name, values in table.columns.items()}
    repeated = time_s.size - first.size
    percent = 100.0 * repeated / time_s.size
    note = Note(
        f"{repeated} of {counted(time_s.size, 'row')} ({percent:.3g} %) with the time of the row before: the last "
        "value of each column kept",
        level,
    )
    return table._replace(columns=columns, line=table.line[first]).with_notes(note)


def _spread(table: Table, time: str) -> Table:
    """The table with the n rows of each stamp, to which the logger rounded down, at equal intervals until the next.

    The interval of the stamps is the smallest between two of them. Beside a pause, at the start and at the end, a
    stamp may hold fewer rows than its interval had room for: they lie at the usual distance from each other, before
    the pause from the stamp on, after it up to the next stamp.
    """
    time_s = table.columns[time]
    stamp_s, group, count = np.unique(time_s, return_inverse=True, return_counts=True)
    steps = np.diff(stamp_s)
    interval_s = float(np.quantile(steps, _SMALLEST_STEP, method="lower")) if steps.size else 1.0
    room_s = np.minimum(np.append(steps, interval_s), interval_s)
    is_pause = np.append(steps, np.inf) > _PAUSE * interval_s
    after_pause = np.concatenate([[True], is_pause[:-1]])
    distance_s = room_s / count
    inner = ~(is_pause | after_pause)
    usual_s = float(np.median(distance_s[inner])) if inner.any() else float(distance_s.min())
    distance_s[~inner] = np.minimum(distance_s[~inner], usual_s)
    begin_s = stamp_s + np.where(after_pause & ~is_pause, room_s - count * distance_s, 0.0)
    within = np.arange(time_s.size) - np.searchsorted(time_s, time_s)
    spread_s = begin_s[group] + within * distance_s[group]
    note = Note(
        f"{counted(time_s.size, 'row')} with {counted(stamp_s.size, 'stamp')}, {interval_s:g} s apart: the rows of one "
        "stamp are spread evenly until the next; let the logger write finer stamps",
        "warning",
    )
    return table.with_columns({time: spread_s}, note)


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
            separators = find_separators(table, time, restarts)
            raise SeveralRecordingsError(explain_recordings(table, time, restarts, separators), separators)
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
