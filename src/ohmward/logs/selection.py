"""The rows of one recording: picked out of a file that holds several, and in order of time.

Everywhere `time` is the time column [s], which never falls once the rows are sorted or when instances are sought, and
`channels` are the measured columns.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import letters, word_set
from ohmward.logs.columns import argument, guess, listed
from ohmward.logs.table import MISSING, Note, Table, TableFile, counted, numbers

# A column that every file has: 1, 2, ... counted up at each restart of the clock.
RECORDING = "recording"
_MOST_SEPARATORS, _MOST_QUOTED = 3, 8
#: A file with a selection of its rows.
_SELECTION = re.compile(r"(?P<path>.+):(?P<where>[^:=,]+=[^:=,]+(,[^:=,]+=[^:=,]+)*)")
#: Words in the name of a column that tells batteries or robots apart, and words beside them.
_INSTANCE = frozenset(("instance", "battery", "pack", "bms", "robot", "vehicle", "host", "device"))
_BESIDE_INSTANCE = frozenset(("id", "no", "nr", "number", "name", "index", "serial"))
#: Words for the finer part of a stamp in a column of its own, which also tells rows apart.
_STAMP = frozenset(("s", "sec", "secs", "second", "seconds", "ms", "msec", "millis", "milliseconds", "us", "ns"))
#: Most instances in one table; number of rows whose labels are checked first.
_MOST_INSTANCES, _LABEL_ROWS = 16, 1000
#: Smallest fraction of rows at which the instance changes, or of rows of rarer instances that share another row's time.
_SIDE_BY_SIDE = 0.5
#: Smallest fraction of the stamps that have a row of each instance.
_MOST_STAMPS = 0.9
#: Between rows of different instances a channel changes by more than this many times its change within one.
_MORE_CHANGE = 1.5


def select_rows(table: Table, where: Mapping[str, float | str]) -> Table:
    """The rows in which every named column has the wanted value, as a number or as text; InputError where none has."""
    for name, wanted in where.items():
        picked = _equal(table, name, wanted)
        if not picked.any():
            raise InputError(
                f"{table.source}: no row has {name} = {wanted}; the values are {_listed(table.columns[name])}"
            )
        note = Note(f"rows with {name} = {wanted}: {picked.sum()} of {picked.size}")
        table = table.pick(picked).with_notes(note)
    return table


def explain_recordings(table: Table, time: str, restarts: np.ndarray, separators: Sequence[str]) -> str:
    """The message on a clock that restarts at the rows `restarts` (K,): the place, and how to choose a recording.

    separators: from `find_separators`.
    """
    at = int(restarts[0])
    time_s = table.columns[time]
    what = (
        f"{table.source} holds several recordings: the time falls from {time_s[at - 1]:g} s to {time_s[at]:g} s "
        f"at {table.place} {table.line[at]}"
    )
    if not separators:
        return (
            f"{what}, and no column distinguishes them; choose one by its number with --where {RECORDING}=1 "
            f"(where={{{RECORDING!r}: 1}}; there are {restarts.size + 1}), or split the file; if "
            "it is one recording whose rows are out of order, sort them with --sort-time (sort_time=True)"
        )
    values = " and ".join(f"{name!r} ({_listed(table.columns[name])})" for name in separators)
    example = {name: _plain(table.columns[name][0]) for name in separators}
    options = " ".join(f"--where {argument(f'{name}={value}')}" for name, value in example.items())
    return f"{what}; they differ in {values}; choose one, for example {options} (where={example})"


def find_separators(table: Table, time: str, restarts: np.ndarray) -> tuple[str, ...]:
    """The fewest columns such that the time never falls among the rows that share their values; () if there are none.

    Only columns that change about as often as the clock restarts are labels of recordings.

    restarts: (K,) rows at which the time falls.
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


def find_instances(table: Table, time: str, channels: Collection[str]) -> str | None:
    """The column whose few values tell apart batteries or robots with interleaved rows; None if there is none.

    The rows of the instances alternate, or those of the rarer ones share their stamps with others, and no instance has
    a stamp twice. A flag of one battery may do the same: the name of the column must be one for instances, or a channel
    must change more from instance to instance than within each. If the name is one for instances and their rows
    alternate, a stamp may repeat: the stamps are coarse.
    """
    time_s = table.columns[time]
    equal = time_s[1:] == time_s[:-1]
    shared = np.append(equal, False) | np.append(False, equal)
    for name, values in table.columns.items():
        if name == time or name in channels or _STAMP & set(letters(name)) or not _are_labels(values):
            continue
        turns = _changes(values)
        often = turns.size >= _SIDE_BY_SIDE * equal.size
        if not turns.size or not (often or equal.any()):
            continue
        code = np.unique(values.astype(str) if values.dtype == object else values, return_inverse=True)[1]
        counts = np.bincount(code)
        order = np.argsort(code, kind="stable")
        within = np.diff(code[order]) == 0
        before, later = order[:-1][within], order[1:][within]
        if counts.size > _MOST_INSTANCES or counts.min() < 2:
            continue
        named = names_instances(name)
        if (time_s[later] == time_s[before]).any() and not (named and often):
            continue
        beside = often or shared[code != np.argmax(counts)].mean() >= _SIDE_BY_SIDE
        if beside and (named or _differ(table, channels, turns, (before, later))):
            return name
    return None


def count_unnamed_instances(table: Table, time: str, channels: Collection[str]) -> int:
    """Number of batteries or robots whose rows share each stamp without a column that tells them apart; else 1.

    Nearly every stamp has this many rows, which differ by their place in it. Rows of one battery with coarse stamps do
    not, unless its load is synchronous with them; a column with the finer part of the stamp shows that they are of one.
    """
    time_s = table.columns[time]
    if (time_s[1:] > time_s[:-1]).all() or any(name != time and _STAMP & set(letters(name)) for name in table.columns):
        return 1
    _, first, rows = np.unique(time_s, return_index=True, return_counts=True)
    count = int(np.median(rows))
    if not 1 < count <= _MOST_INSTANCES or np.count_nonzero(rows == count) < max(2, _MOST_STAMPS * rows.size):
        return 1
    place = np.arange(table.line.size) - np.repeat(first, rows)
    placed = table.only({time, *channels}).with_columns({"": place}).pick(np.repeat(rows == count, rows))
    return count if find_instances(placed, time, channels) is not None else 1


def names_instances(name: str) -> bool:
    """True for the name of a column that tells batteries or robots apart: Instance, Battery ID; not pack_voltage."""
    words = set(letters(name))
    return bool(words & _INSTANCE) and words <= _INSTANCE | _BESIDE_INSTANCE


def _are_labels(values: np.ndarray) -> bool:
    """True where the first rows hold a few whole numbers or texts, none missing."""
    head = values[:_LABEL_ROWS]
    if head.dtype.kind == "f" and not (np.isfinite(head).all() and (head == np.rint(head)).all()):
        return False
    return head.dtype.kind in "fiubO" and len(set(head.tolist())) <= _MOST_INSTANCES


def _differ(
    table: Table, channels: Collection[str], turns: np.ndarray, neighbours: tuple[np.ndarray, np.ndarray]
) -> bool:
    """True where a channel changes more at the rows `turns` than between the `neighbours` of one instance."""
    before, later = neighbours
    for name in channels:
        values = table.columns[name]
        if values.dtype.kind not in "fiu":
            continue
        between = _median_change(values[turns - 1], values[turns])
        if between > _MORE_CHANGE * _median_change(values[before], values[later]):
            return True
    return False


def _median_change(before: np.ndarray, later: np.ndarray) -> float:
    """Median magnitude of the finite changes; 0 if there are none."""
    change = np.abs(later - before)
    known = np.isfinite(change)
    return float(np.median(change[known])) if known.any() else 0.0


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


def distinct(values: np.ndarray) -> list[float | int | str]:
    """The values (T,) each once, in order of appearance; whole numbers without a decimal point."""
    begins = np.append(True, values[1:] != values[:-1])[: values.size]
    return list(dict.fromkeys(map(_plain, values[begins])))


def labels_in(file: TableFile, column: str) -> list[str]:
    """The texts in a column of labels, such as serial numbers, each once; missing ones are left out."""
    values = file.load({column}).columns.get(column, np.empty(0))
    texts = dict.fromkeys(str(value).strip() for value in distinct(values))
    return [text for text in texts if text.lower() not in MISSING]


def _listed(values: np.ndarray) -> str:
    """The first distinct values for a message."""
    found = distinct(values)
    return ", ".join(map(str, found[:_MOST_QUOTED])) + (", ..." if len(found) > _MOST_QUOTED else "")


def _plain(value) -> float | int | str:
    """A number as int if it is whole, else as float; anything else as text."""
    if not isinstance(value, int | float | np.number):
        return str(value)
    return int(value) if float(value).is_integer() else float(value)


def split_selection(text: str) -> tuple[Path, dict[str, str]]:
    """File and selected rows of `ocv.parquet:script=1,temp_C=25`; an existing file of that name is taken whole."""
    found = None if Path(text).exists() else _SELECTION.fullmatch(text)
    if found is None:
        return Path(text), {}
    return Path(found["path"]), dict(part.split("=", 1) for part in found["where"].split(","))


def selected_name(name: str, where: Mapping[str, str]) -> str:
    """Name of a log together with the rows that were selected from its file."""
    chosen = ",".join(f"{column}={value}" for column, value in where.items())
    return f"{name}:{chosen}" if chosen else name


class SeveralRecordingsError(InputError):
    """A file holds several recordings, and one must be chosen; separators: columns that tell them apart."""

    def __init__(self, text: str, separators: Sequence[str] = ()) -> None:
        super().__init__(text)
        #: the recordings are steps and cycles of one test
        self.are_steps = bool(separators) and all(_STEPS & set(letters(name)) for name in separators)


#: Words in the name of a column that counts the steps of a test.
_STEPS = word_set("step cycle cyc loop schritt zyklus 工步 循环")
# Largest fraction of rows out of order that passes for a few written late.
_MOST_LATE = 0.05
# Restarts in more than this fraction of the rows show that they are shuffled: steps of a test, but no recordings, may
# have so few rows each.
_SHUFFLED = 0.25
# A column of fewer different values than this share of its rows is hardly a time.
_FEW_VALUES = 0.2
#: If more than this fraction of the rows is measured again at the same time, the stamps are too coarse.
_MOST_REPEATED = 0.2
#: Quantile of the intervals between stamps that is used as the smallest one, so that a few odd stamps do not count.
_SMALLEST_STEP = 0.01
#: Stamps that are this many times their smallest interval apart have a pause between them.
_PAUSE = 1.5


def find_restarts(time_s: np.ndarray) -> np.ndarray:
    """Rows (K,) at which the time falls by more than a row written late would explain.

    time_s: (T,) [s], finite. A row is late if it follows a row that is newer by at most one median interval.
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
    """The table with one time for all steps, whose clocks restart: each at least a usual interval after the last."""
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
    """Refuse interleaved rows of several batteries or robots, with the column that tells them apart, and its values."""
    if name := find_instances(table, time, channels):
        values = distinct(table.columns[name])
        options = " or ".join(f"--where {argument(f'{name}={value}')}" for value in values)
        raise SeveralRecordingsError(
            f"{table.source}: the rows of {len(values)} batteries or robots take turns; they differ in {name!r}; "
            f"choose one with {options} (where={{{name!r}: {values[0]!r}}})"
        )
    if (count := count_unnamed_instances(table, time, channels)) > 1:
        raise SeveralRecordingsError(
            f"{table.source}: {count} rows stand at each time and differ as those of {count} batteries or robots, and "
            "no column distinguishes them; write each into a file of its own, or add a column with its name"
        )


def settle_equal_times(table: Table, time: str, channels: Collection[str]) -> Table:
    """Give each row a time of its own.

    Rows of one time that hold different channels, or repeat the same values, become one row, with the last value of
    each column that is not NaN. Rows that measured the same channel again are separate readings: if they are many, the
    stamps are too coarse, and the rows are spread over the interval between stamps; if they are few, the last one
    counts, with a warning.
    """
    share, differ = find_repeats(table, time, channels)
    if differ and share > _MOST_REPEATED:
        return _spread(table, time)
    time_s = table.columns[time]
    later = time_s[1:] > time_s[:-1]
    if later.all():
        return table
    first = np.flatnonzero(np.concatenate([[True], later]))
    columns = {}
    for name, values in table.columns.items():
        rows = np.where(np.isfinite(values), np.arange(values.size), -1)
        last = np.maximum.reduceat(rows, first)
        columns[name] = np.where(last >= 0, values[last], np.nan)
    repeated = time_s.size - first.size
    percent = 100.0 * repeated / time_s.size
    text = f"{repeated} of {counted(time_s.size, 'row')} ({percent:.3g} %) with the time of the row before: "
    if differ:
        note = Note(f"{text}the last value of each column kept", "warning")
    else:
        note = Note(f"{text}joined with it; no value differs")
    return table._replace(columns=columns, line=table.line[first]).with_notes(note)


def find_repeats(table: Table, time: str, channels: Collection[str]) -> tuple[float, bool]:
    """Fraction of rows with a channel that a later row of the same time measured again, and whether any two differ."""
    time_s = table.columns[time]
    again = np.zeros(time_s.size, dtype=bool)
    differ = False
    if (time_s[1:] > time_s[:-1]).all():
        return 0.0, differ
    for name in channels:
        values = table.columns[name]
        if values.dtype.kind not in "fiu":
            continue
        rows = np.flatnonzero(np.isfinite(values))
        same = time_s[rows[1:]] == time_s[rows[:-1]]
        again[rows[:-1][same]] = True
        differ = differ or bool((values[rows[1:]] != values[rows[:-1]])[same].any())
    return float(again.mean()), differ


def _spread(table: Table, time: str) -> Table:
    """The table with the n rows of each rounded-down stamp spread at equal intervals up to the next stamp.

    The interval of the stamps is the smallest between two of them. Next to a pause, at the start and at the end, a
    stamp may hold fewer rows than fit into its interval: these are placed at the usual distance from each other, from
    the stamp on before a pause, and up to the next stamp after it. With a single stamp it is refused.
    """
    time_s = table.columns[time]
    stamp_s, group, count = np.unique(time_s, return_inverse=True, return_counts=True)
    steps = np.diff(stamp_s)
    if not steps.size:
        raise InputError(
            f"{table.source}: column {time!r} is {stamp_s[0]:g} in all {time_s.size} rows; name another one with "
            "--column time=NAME (columns={'time': NAME}), or give the interval between rows with --sample-time 1 "
            "(FileHints(sample_time_s=1))"
        )
    interval_s = float(np.quantile(steps, _SMALLEST_STEP, method="lower"))
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
    """Raise InputError if more is out of order than a few rows that were written `late` (T,)."""
    time_s = table.columns[time]
    steps = np.diff(time_s)
    falls, rises = np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)
    values = np.unique(time_s).size
    if rises < 0.1 * falls:
        why, fix = "the newest row stands first", ";"
    elif values < _FEW_VALUES * time_s.size:
        why = f"it has {values:,} values in {time_s.size:,} rows; is {time!r} the time?"
        fix = " Name another with --column time=NAME, or give the interval between rows with --sample-time 1, else"
    else:
        why, fix = "the rows are shuffled", ";"
    shuffled = InputError(
        f"{table.source}: the time falls from {table.place} to {table.place} {falls:,} times: {why}{fix} sort the rows "
        "with --sort-time (sort_time=True)"
    )
    if falls > rises:
        raise shuffled
    restarts = find_restarts(time_s)
    if restarts.size:
        before, after = time_s[restarts[0] - 1], time_s[restarts[0]]
        if before - after >= 0.5 * (before - time_s[0]):  # back over most of the time that had passed
            separators = find_separators(table, time, restarts)
            several = SeveralRecordingsError(explain_recordings(table, time, restarts, separators), separators)
            raise several if several.are_steps or restarts.size <= _SHUFFLED * time_s.size else shuffled
    if restarts.size or late.mean() > _MOST_LATE:
        raise InputError(_backwards(table, time_s, late))


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
