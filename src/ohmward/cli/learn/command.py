"""`ohmward learn`: from everyday logs to a battery file that knows more."""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from functools import partial

from ohmward.battery.battery import require_thevenin
from ohmward.battery.file import BATTERY_FILE
from ohmward.cli.learn.files import open_files
from ohmward.cli.learn.journal import Journal, journal_path
from ohmward.cli.learn.lessons import teach_all
from ohmward.cli.learn.report import make_page
from ohmward.cli.learn.result import describe, summary
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import split_selection
from ohmward.cli.progress import progress
from ohmward.cli.sensor import load_battery_with_sensor

#: Options that the lessons depend on beside the logs.
_OF_THE_JOB = ("current_sign", "column", "unit", "where", "sort_time", "initial_soc")


def run(args: argparse.Namespace) -> Outcome:
    """Learn log by log; write each battery file whole, at the end."""
    start, contradictions = load_battery_with_sensor(args.battery, args)
    require_thevenin(start)
    texts = log_files(args.logs)
    files = open_files(start, args.output, [str(split_selection(text)[0]) for text in texts])
    journal = Journal(None if args.dry_run else journal_path(args.output), _job(BATTERY_FILE.dump(start), args))
    resumed, began = len(journal.rows), time.perf_counter()
    with progress() as report:
        rows = teach_all(texts, args, files, journal, report)
    written = {} if args.dry_run else files.write()
    journal.finish()
    figures = summary(args, files, rows, written) | {
        "resumed": resumed,
        "seconds": time.perf_counter() - began,
        "notes": [f"warning: {text}" for text in contradictions] + _unused(args, rows) + _notes(rows),
    }
    nothing = not any(row["verdict"] != "set aside" for row in rows)
    return Outcome(figures, describe(figures), figures["notes"], partial(make_page, files, figures), int(nothing))


def _job(battery: str, args: argparse.Namespace) -> str:
    """Digest of the battery file and of the options that the lessons depend on."""
    options = {name: getattr(args, name) for name in _OF_THE_JOB}
    return hashlib.sha256(json.dumps([battery, options]).encode()).hexdigest()[:16]


def _unused(args: argparse.Namespace, rows: list[dict]) -> list[str]:
    """Warnings on states of charge that were given for logs that are not there."""
    names = {row["log"] for row in rows}
    unused = [name for name, _ in args.initial_soc if name and name not in names]
    return [f"warning: --initial-soc {name}: there is no log of this name" for name in unused]


def _notes(rows: list[dict]) -> list[str]:
    """Warnings about the logs, with their names; what every reader says of a good log is left out."""
    read = [(row["log"], note) for row in rows for note in row["notes"] if note.startswith("warning: ")]
    left_out = [(row["log"], note) for row in rows for note in row.get("left_out", [])]
    return [f"warning: {log}: {note.removeprefix('warning: ')}" for log, note in read + left_out]
