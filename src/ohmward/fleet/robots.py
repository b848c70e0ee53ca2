"""The robots of a fleet: whose log a file is, by a column, a serial number, its name or its folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.battery_columns import serial_column
from ohmward.logs.hints import FileHints
from ohmward.logs.read import open_table
from ohmward.logs.selection import labels_in, split_selection
from ohmward.logs.table import TableFile

#: Ways to tell the robot beside the name of a column; the first tries the others in turn.
AUTO, ALONE, SERIAL, NAME, FOLDER = "auto", "log", "serial", "name", "folder"
WAYS = (AUTO, ALONE, SERIAL, NAME, FOLDER)
_COLUMN = re.compile(r"^(?:robot|vehicle|device|machine|agv|amr|unit)(?:[ _]?(?:id|name|no|number))?$", re.IGNORECASE)
#: A name with a date, or a number behind a separator, at its end: `amr-00_2026-01-01`, `mower 3 run 12`.
_DATED = re.compile(r"^(?P<robot>.*?[^\W_].*?)[ _.-]+(?:\d{4}[-_.]?\d{2}[-_.]?\d{2}|\d{9,}).*$")
_NUMBERED = re.compile(r"^(?P<robot>.*?[^\W_].*?)[ _.-]+(?:run|log|part|day|trip|bag)?[ _.-]*\d+$", re.IGNORECASE)


class Robots(NamedTuple):
    """Logs by their robots."""

    by: str  #: the way, or the name of the column, that told them
    logs: dict[str, list[str]]  #: robot -> its logs; with rows of a file where it holds several robots


def robots_of(texts: Sequence[str], by: str | None = None, hints: FileHints | None = None) -> Robots:
    """The robots of logs.

    texts: names of logs, or of logs and the rows wanted of them.
    by: one of `WAYS`, or the name of a column; `auto`, the default, takes the first that gives a robot several logs: a
        column of robots, serial numbers, names, folders; where none does, each log is alone.

    Raises:
        InputError: no log has the column, or a serial number.
    """
    by = by or AUTO
    files = {text: file for text in texts if (file := _opened(text, hints)) is not None}
    if by == ALONE:
        return Robots(by, {text: [text] for text in texts})
    if by not in WAYS:
        return _required(by, texts, files, lambda names: next((n for n in names if n.lower() == by.lower()), None))
    if by == SERIAL:
        return _required(by, texts, files, serial_column)
    if by in (NAME, FOLDER):
        return Robots(by, _grouped(texts, _of_name if by == NAME else _of_folder))
    for found in _candidates(texts, files):
        if any(len(logs) > 1 for logs in found.logs.values()) and len(found.logs) < len(texts):
            return found
    return Robots(ALONE, {text: [text] for text in texts})


def _candidates(texts: Sequence[str], files: dict[str, TableFile]) -> Iterable[Robots]:
    for find in (_robot_column, serial_column):
        columns = [find(file.names) for file in files.values()]
        if columns and all(columns):
            yield Robots(str(columns[0]), _by_column(texts, files, find))
    if all(_of_name(text) != _stem(text) for text in files):
        yield Robots(NAME, _grouped(texts, _of_name))
    if len({_of_folder(text) for text in texts}) > 1:
        yield Robots(FOLDER, _grouped(texts, _of_folder))


Find = Callable[[tuple[str, ...]], str | None]


def _required(by: str, texts: Sequence[str], files: dict[str, TableFile], find: Find) -> Robots:
    """The robots by a column that at least one log has."""
    if not any(find(file.names) for file in files.values()):
        what = "a serial number" if by == SERIAL else f"the column {by!r}"
        raise InputError(f"--by {by}: no log has {what}; name another column, or one of {', '.join(WAYS)}")
    return Robots(by, _by_column(texts, files, find))


def _by_column(texts: Sequence[str], files: dict[str, TableFile], find: Find) -> dict[str, list[str]]:
    """Robots by the values of a column; a log without it goes to the robot of its name."""
    robots: dict[str, list[str]] = {}
    left = []
    for text in texts:
        column = find(files[text].names) if text in files else None
        try:
            values = [] if column is None else labels_in(files[text], column)
        except OhmwardError:
            values = []
        if not values:
            left.append(text)
        mark = "," if split_selection(text)[1] else ":"
        for value in values:
            robots.setdefault(value, []).append(text if len(values) == 1 else f"{text}{mark}{column}={value}")
    for text in left:
        robots.setdefault(_of_name(text), []).append(text)
    return robots


def _robot_column(names: tuple[str, ...]) -> str | None:
    return next((name for name in names if _COLUMN.match(name)), None)


def _grouped(texts: Sequence[str], robot: Callable[[str], str]) -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for text in texts:
        groups.setdefault(robot(text), []).append(text)
    return groups


def _of_name(text: str) -> str:
    """The name of a log before its date or its number."""
    stem = _stem(text)
    found = _DATED.match(stem) or _NUMBERED.match(stem)
    return found["robot"] if found else stem


def _stem(text: str) -> str:
    """The name of a log before its ending."""
    name = Path(split_selection(text)[0]).name
    return name.partition(".")[0] or name


def _of_folder(text: str) -> str:
    """The folder that a log lies in."""
    return Path(split_selection(text)[0]).resolve().parent.name


def _opened(text: str, hints: FileHints | None) -> TableFile | None:
    try:
        return open_table(split_selection(text)[0], hints)
    except OhmwardError:
        return None
