"""`ohmward tune`: the noise of a battery file by maximum likelihood, on logs without a truth."""

from __future__ import annotations

import argparse
from functools import partial

from ohmward.battery.file import replace_battery
from ohmward.battery.tuning.tune import tune_noise
from ohmward.cli.battery_inputs import read_battery_log
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.sensor import load_battery_with_sensor
from ohmward.cli.tune.report import make_page
from ohmward.cli.tune.result import TuneTask, describe, summary


def run(args: argparse.Namespace) -> Outcome:
    """Tune, and write the battery file; the exit status is 1 where no noise explains the logs."""
    check_output("--output", args.output, (".toml",), [])
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    with progress() as report:
        logs = [read_battery_log(text, args, (), report) for text in log_files(args.logs)]
        given = dict(args.initial_soc)
        starts = {log.name: given[key] for log in logs for key in (log.name, "") if key in given}
        tuning = tune_noise(battery, logs, starts, counting(report, "looking for the most likely noise"))
    task = TuneTask(args.battery, battery, tuple(logs), tuning, tuple(contradictions))
    backup = replace_battery(tuning.battery, args.output) if args.output and tuning.explains else None
    written = {"output": args.output if tuning.explains else None, "backup": str(backup) if backup else None}
    figures = summary(task) | written | {"report": args.report}
    page = partial(make_page, task, figures)
    return Outcome(figures, describe(task, figures), task.notes, page, status=int(not tuning.explains))
