"""`ohmward identify`: from logs of tests to a battery file."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from functools import partial

from ohmward.battery.file import replace_battery
from ohmward.battery.identification import IdentificationSettings, Identified, identify_in_detail
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.identify.report import make_page
from ohmward.cli.identify.result import describe, summary
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import split_selection
from ohmward.cli.progress import progress
from ohmward.cli.sensor import with_sensor
from ohmward.logs import Log


def run(args: argparse.Namespace) -> Outcome:
    """Identify the battery, write its file; the exit status is 1 if the model does not fit its tests."""
    check_output("--output", args.output, (".toml",), [str(split_selection(text)[0]) for text in args.logs])
    logs = [read_battery_log(text, args) for text in args.logs]
    began = time.perf_counter()
    found = _identify(logs, args)
    seconds = time.perf_counter() - began
    backup = replace_battery(found.battery, args.output) if args.output else None
    figures = summary(found, seconds)
    notes = _notes(logs) + figures["notes"]
    figures |= {"notes": notes, "output": args.output, "backup": str(backup) if backup else None, "report": args.report}
    page = partial(make_page, found, notes)
    return Outcome(figures, describe(found.battery, figures), notes, page, status=int(not found.fits))


def _identify(logs: Sequence[Log], args: argparse.Namespace) -> Identified:
    settings = IdentificationSettings(
        args.capacity_ah,
        args.model,
        args.chemistry,
        args.n_series,
        args.name,
        _starts(logs, args.initial_soc),
        args.idle_current,
        args.ocv,
    )
    with progress() as report:
        found = identify_in_detail(logs, settings, report)
    battery, _ = with_sensor(found.battery, args)
    return found._replace(battery=battery)


def _notes(logs: Sequence[Log]) -> list[str]:
    """Assumptions about the logs, with their names where there are several."""
    if len(logs) == 1:
        return [str(note) for note in logs[0].notes]
    return [f"{note.level}: {log.name}: {note.text}" for log in logs for note in log.notes]


def _starts(logs: Sequence[Log], given: Sequence[tuple[str, float]]) -> dict[str, float]:
    """Initial SoC by the log's name; a value without a name holds for all that are not named."""
    starts: dict[str, float] = {}
    for soc in (soc for name, soc in given if not name):
        starts |= dict.fromkeys((log.name for log in logs), soc)
    return starts | {name: soc for name, soc in given if name}
