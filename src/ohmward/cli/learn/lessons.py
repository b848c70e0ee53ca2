"""Lessons of a run of `ohmward learn`: each log read, its battery found, and what it taught as plain numbers."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.lesson import Lesson
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.learn.files import BatteryFiles
from ohmward.cli.learn.journal import Journal, Row
from ohmward.cli.outcome import plain
from ohmward.cli.parser import selected_name, split_selection
from ohmward.cli.progress import Report
from ohmward.errors import InputError
from ohmward.logs.serial_number import serial_numbers


@dataclass(frozen=True)
class LogTask:
    """A log, or the rows of one battery in it."""

    text: str  #: as it was named, its rows included
    serial_number: str = ""  #: of its battery, "" where the log does not tell

    @property
    def path(self) -> str:
        """The file."""
        return str(split_selection(self.text)[0])

    @property
    def name(self) -> str:
        """Name of the log."""
        path, where = split_selection(self.text)
        return selected_name(path.stem, where)


def log_tasks(text: str, args: argparse.Namespace, files: BatteryFiles) -> list[LogTask]:
    """A task for each battery whose serial number is in the log, one for a log without any.

    Raises:
        InputError: the log cannot be read, or holds several batteries where the output is one file.
    """
    path, where = split_selection(text)
    found = serial_numbers(path, dict(args.where) | where)
    if len(found) < 2:
        return [LogTask(text, found[0][1] if found else "")]
    tasks = [LogTask(f"{text}{',' if where else ':'}{column}={serial}", serial) for column, serial in found]
    if files.one_for_each:
        return tasks
    own = files.after[files.open("")].serial_number
    if not own:
        numbers = ", ".join(task.serial_number for task in tasks)
        raise InputError(
            f"it holds batteries with several serial numbers ({numbers}); choose one with --where "
            f"{found[0][0]}={found[0][1]}, or give a folder as --output"
        )
    return [task for task in tasks if task.serial_number == own] or tasks[:1]


def teach(text: str, args: argparse.Namespace, files: BatteryFiles, starts: Mapping[str, float]) -> list[Row]:
    """The lessons of a log; the batteries in `files` have learnt them."""
    try:
        tasks = log_tasks(text, args, files)
    except InputError as error:
        return [refused(LogTask(text), str(error))]
    rows = []
    for task in tasks:
        try:
            rows += _teach(task, args, files, starts)
        except InputError as error:
            rows.append(refused(task, str(error)))
    return rows


def _teach(task: LogTask, args: argparse.Namespace, files: BatteryFiles, starts: Mapping[str, float]) -> list[Row]:
    key = files.open(task.serial_number)
    log = read_battery_log(task.text, args, extra=None)
    start = starts.get(log.name, starts.get(""))
    learnt = learn(files.after[key], [log], initial_soc={} if start is None else {log.name: start})
    if learnt.battery is not files.after[key]:
        # as the file will have it, so that a run that goes on after an interruption ends with the same file
        files.after[key] = BATTERY_FILE.parse(BATTERY_FILE.dump(learnt.battery))
    head = {"path": task.path, "serial_number": task.serial_number or None, "battery_file": key or None}
    notes = [str(note) for note in log.notes]
    return [head | as_row(lesson) | {"notes": notes} for lesson in learnt.lessons]


def refused(task: LogTask, reason: str) -> Row:
    """Row of a log that could not be read or is of no battery of the run."""
    return {
        "path": task.path,
        "serial_number": task.serial_number or None,
        "battery_file": None,
        "log": task.name,
        "verdict": "set aside",
        "reason": _without_name(reason, Path(task.path).name, task.name),
        "notes": [],
    }


def as_row(lesson: Lesson) -> Row:
    """A lesson as JSON knows it."""
    return plain(_as_plain(lesson._replace(reason=_without_name(lesson.reason, lesson.log))))


def _without_name(reason: str, *names: str) -> str:
    """The reason without the name of the log at its head, which stands beside it anyway."""
    for name in names:
        reason = reason.removeprefix(f"{name}: ")
    return reason


def _as_plain(value: Any) -> Any:
    """Named tuples as objects of their fields."""
    if hasattr(value, "_asdict"):
        return {name: _as_plain(item) for name, item in value._asdict().items()}
    if isinstance(value, tuple | list):
        return [_as_plain(item) for item in value]
    return value


def teach_all(
    texts: list[str], args: argparse.Namespace, files: BatteryFiles, journal: Journal, report: Report | None
) -> list[Row]:
    """Rows of all logs, those of the journal as they were."""
    starts = dict(args.initial_soc)
    done = {row["text"]: row for row in journal.rows}
    rows: list[Row] = []
    for k, text in enumerate(texts):
        if report:
            report(f"{k + 1} of {len(texts)}: {Path(text).name}", k / len(texts))
        if text in done:
            for key, battery in done[text]["batteries"].items():
                files.restore(key, BATTERY_FILE.parse(battery))
            rows += done[text]["lessons"]
            continue
        before = dict(files.after)
        lessons = teach(text, args, files, starts)
        changed = {key: BATTERY_FILE.dump(b) for key, b in files.after.items() if before.get(key) is not b}
        journal.add({"text": text, "lessons": lessons, "batteries": changed})
        rows += lessons
    return rows
