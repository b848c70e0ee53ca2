"""Pick the rows of one recording out of a file that holds several.

Everywhere `time` is the column of the time [s], which does not fall among instances, and `channels` are the columns
that were measured.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.channels import letters
from ohmward.logs.columns import argument, guess, listed
from ohmward.logs.table import MISSING, Note, Table, TableFile, numbers

# A column that every file has: 1, 2, ... counted up where the clock starts again.
RECORDING = "recording"
_MOST_SEPARATORS, _MOST_LISTED = 3, 8
#: A file and the rows that are wanted of it.
_SELECTION = re.compile(r"(?P<path>.+):(?P<where>[^:=,]+=[^:=,]+(,[^:=,]+=[^:=,]+)*)")
#: Words in the name of a column that tells batteries or robots apart, and words beside them.
_INSTANCE = frozenset(("instance", "battery", "pack", "bms", "robot"))
_BESIDE_INSTANCE = frozenset(("id", "no", "nr", "number", "name", "index", "serial"))
#: Words of the rest of a stamp, which tells its rows apart as well.
_STAMP = frozenset(("s", "sec", "secs", "second", "seconds", "ms", "msec", "millis", "milliseconds", "us", "ns"))
#: So many instances at most in one table; rows whose labels are looked at first.
_MOST_INSTANCES, _HEAD_ROWS = 16, 1000
#: Fraction of the rows that take turns, or of the rarer instances that have the time of another row.
_SIDE_BY_SIDE = 0.5
#: Fraction of the stamps that have a row of each instance.
_MOST_STAMPS = 0.9
#: Between rows of different instances a channel changes by this many times its change within one.
_MORE_CHANGE = 1.5


def select_rows(table: Table, where: Mapping[str, float | str]) -> Table:
    """The rows in which every named column has the wanted value; numbers compare as numbers, all else as text.

    Raises:
        InputError: a column does not exist or no row has the value.
    """
    for name, wanted in where.items():
        picked = _equal(table, name, wanted)
        if not picked.any():
            raise InputError(
                f"{table.source}: no row has {name} = {wanted}; the values are {_listed(table.columns[name])}"
            )
        note = Note(f"rows with {name} = {wanted}: {picked.sum()} of {picked.size}")
        table = table.pick(picked).with_notes(note)
    return table


def recording_numbers(restarts: np.ndarray, size: int) -> np.ndarray:
    """(T,) 1, 2, ... counted up at every row in `restarts` (K,)."""
    return 1.0 + np.isin(np.arange(size), restarts).cumsum()


def explain_recordings(table: Table, time: str, restarts: np.ndarray, separators: Sequence[str]) -> str:
    """The message on a clock that starts again at the rows `restarts` (K,): the place, and a way to choose a recording.

    separators: as of `find_separators`.
    """
    at = int(restarts[0])
    time_s = table.columns[time]
    what = (
        f"{table.source} holds several recordings: the time falls from {time_s[at - 1]:g} s to {time_s[at]:g} s "
        f"at {table.place} {table.line[at]}"
    )
    if not separators:
        return (
            f"{what}, and no column tells them apart; choose one by its number with --where {RECORDING}=1 "
            f"(where={{{RECORDING!r}: 1}}; there are {restarts.size + 1}), or split the file"
        )
    values = " and ".join(f"{name!r} ({_listed(table.columns[name])})" for name in separators)
    example = {name: _plain(table.columns[name][0]) for name in separators}
    options = " ".join(f"--where {argument(f'{name}={value}')}" for name, value in example.items())
    return f"{what}; they are told apart by {values}; choose one, for example {options} (where={example})"


def find_separators(table: Table, time: str, restarts: np.ndarray) -> tuple[str, ...]:
    """The fewest columns such that the time never falls among the rows that share their values; () if there are none.

    Only columns that change about as often as the clock starts again are labels of recordings.

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
    """The column whose few values tell batteries or robots apart whose rows stand side by side; None for none.

    The rows of the instances take turns, or those of the rarer ones share their stamps with others, and none has a
    stamp twice. A flag of one battery may do the same: the name of the column must be that of instances, or a channel
    changes more from instance to instance than within each. Under the name of instances, those that take turns may have
    a stamp twice: the stamps are coarse.
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
    """Number of batteries or robots whose rows share each stamp without a column that tells them apart; 1 for none.

    Every stamp, a few aside, has as many rows, and from one of these to the next a channel changes more than from
    stamp to stamp. Rows of one battery under coarse stamps change less, but for a load that keeps time with them; the
    rest of the stamp in a column of its own says that they are of one.
    """
    if any(name != time and _STAMP & set(letters(name)) for name in table.columns):
        return 1
    time_s = table.columns[time]
    first = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0)
    rows_of_stamp = np.diff(first, append=time_s.size)
    count = int(np.median(rows_of_stamp))
    whole = first[rows_of_stamp == count]
    if not 1 < count <= _MOST_INSTANCES or whole.size < max(2, _MOST_STAMPS * first.size):
        return 1
    rows = whole[:, None] + np.arange(count)
    return count if _differ(table, channels, rows[:, 1:].ravel(), (rows[:-1].ravel(), rows[1:].ravel())) else 1


def names_instances(name: str) -> bool:
    """True for the name of a column that tells batteries or robots apart: Instance, Battery ID; not pack_voltage."""
    words = set(letters(name))
    return bool(words & _INSTANCE) and words <= _INSTANCE | _BESIDE_INSTANCE


def _are_labels(values: np.ndarray) -> bool:
    """True where the first rows hold a few whole numbers or texts, none missing."""
    head = values[:_HEAD_ROWS]
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
    """Median of the size of the changes that are known; 0 for none."""
    change = np.abs(later - before)
    known = np.isfinite(change)
    return float(np.median(change[known])) if known.any() else 0.0


def explain_unnamed_instances(table: Table, count: int) -> str:
    """The message on the rows of so many batteries or robots side by side, which no column tells apart."""
    return (
        f"{table.source}: {count} rows stand at each time and differ as those of {count} batteries or robots, and no "
        "column tells them apart; write each into a file of its own, or add a column with its name"
    )


def explain_instances(table: Table, name: str) -> str:
    """The message on the rows of several batteries or robots side by side, which the column `name` tells apart."""
    values = distinct(table.columns[name])
    options = " or ".join(f"--where {argument(f'{name}={value}')}" for value in values)
    return (
        f"{table.source}: the rows of {len(values)} batteries or robots take turns, told apart by {name!r}; choose one "
        f"with {options} (where={{{name!r}: {values[0]!r}}})"
    )


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
    return ", ".join(map(str, found[:_MOST_LISTED])) + (", ..." if len(found) > _MOST_LISTED else "")


def _plain(value) -> float | int | str:
    """A number without its NumPy type, whole where it is whole; anything else as text."""
    if not isinstance(value, int | float | np.number):
        return str(value)
    return int(value) if float(value).is_integer() else float(value)


def split_selection(text: str) -> tuple[Path, dict[str, str]]:
    """File and rows of `ocv.parquet:script=1,temp_C=25`; a file whose own name looks like that is a file."""
    found = None if Path(text).exists() else _SELECTION.fullmatch(text)
    if found is None:
        return Path(text), {}
    return Path(found["path"]), dict(part.split("=", 1) for part in found["where"].split(","))


def selected_name(name: str, where: Mapping[str, str]) -> str:
    """Name of a log together with the rows that were selected from its file."""
    chosen = ",".join(f"{column}={value}" for column, value in where.items())
    return f"{name}:{chosen}" if chosen else name
