"""`ohmward health`: capacity and resistance against new over months of logs, and the time left."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

import numpy as np

from ohmward.battery.health.health import health_of
from ohmward.battery.health.history import common_error, in_order_of_time, newness, points_of, unlearnt
from ohmward.battery.learning.learn import learn
from ohmward.battery.learning.lesson import Lesson
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.health.report import make_page
from ohmward.cli.health.result import HealthTask, describe, summary
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import Report, progress
from ohmward.cli.sensor import load_battery_with_sensor
from ohmward.errors import InputError
from ohmward.logs import Log
from ohmward.logs.note import counted

#: Seed of the batteries that are drawn for the time left: equal logs give equal pages.
_SEED = 1


def run(args: argparse.Namespace) -> Outcome:
    """Learn from every log in order of time, then judge the trend."""
    if not args.worn > 0.0:
        raise InputError(f"--worn must be above 0, got {args.worn:g}; 0.8 is 80 % of the capacity when new")
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    with progress() as report:
        logs, unread = _read_logs(args, report)
        dated = in_order_of_time(logs)
        learnt = learn(unlearnt(battery), dated.logs, progress=report)
    _require_lesson(learnt.lessons)
    new = newness(battery, learnt.lessons, args.new_capacity_ah)
    points = points_of(dated, learnt.lessons, new)
    common = common_error(learnt.battery, learnt.lessons)
    health = health_of(battery, points, np.random.default_rng(_SEED), args.worn, common)
    notes = [f"warning: {text}" for text in contradictions] + [f"info: {text}" for text in (*dated.notes, *new.notes)]
    task = HealthTask(battery, new, dated, learnt.lessons, health, notes + unread + _reading_notes(dated.logs))
    figures = summary(task) | {"report": args.report}
    return Outcome(figures, describe(figures), task.notes, partial(make_page, task, figures))


def _read_logs(args: argparse.Namespace, report: Report | None) -> tuple[list[Log], list[str]]:
    """The logs that can be read, and a warning for each that cannot; raises InputError where none can."""
    logs, refusals = [], []
    for text in log_files(args.logs):
        try:
            logs.append(read_battery_log(text, args, report=report))
        except InputError as refusal:
            refusals.append(refusal)
    if not logs:
        raise refusals[0]
    return logs, [f"warning: left out: {refusal}" for refusal in refusals]


def _require_lesson(lessons: Sequence[Lesson]) -> None:
    """Refuse logs none of which teaches anything: the health would be that of the label."""
    if not any(lesson.verdict == "learnt" for lesson in lessons):
        first = lessons[0]
        raise InputError(
            f"none of {counted(len(lessons), 'log')} tells the health of this battery; {first.log}: {first.reason}"
        )


def _reading_notes(logs: tuple[Log, ...]) -> list[str]:
    """Warnings of reading, with the name of the log."""
    return [f"warning: {log.name}: {note.text}" for log in logs for note in log.notes if note.level == "warning"]
