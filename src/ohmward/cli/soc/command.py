"""`ohmward soc`: state of charge along a log, with its uncertainty, and its errors where there is a truth."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ohmward.battery.soc.fit_check import misfits
from ohmward.battery.soc.registry import chosen_name
from ohmward.cli.battery_inputs import estimate, estimate_cells, make_soc_task
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.soc.report import make_page
from ohmward.cli.soc.result import describe, estimate_table, summary
from ohmward.logs import write_table
from ohmward.logs.write import TABLES


def run(args: argparse.Namespace) -> Outcome:
    """Estimate, compare with the truth, write the estimates; the exit status is 1 if the battery file does not fit."""
    check_output("--output", args.output, TABLES, [args.log, args.battery])
    with progress() as report:
        task = make_soc_task(args, report)
        name = chosen_name(args.filter.lower(), task.battery)
        cells = estimate_cells(task, name, args, report)
        answer = cells.soc_run if cells else estimate(task, name, args, report)
        if args.output:
            writing = counting(report, f"writing {Path(args.output).name}")
            write_table(estimate_table(task, answer, cells), args.output, writing)
    if cells:
        task = task._replace(log=cells.log)
    wrong = misfits(task.battery, task.log, answer.settings, answer.estimates)
    task = task._replace(log=task.log.with_notes(*wrong))
    figures = summary(task, name, answer, cells) | {"fits": not wrong}
    page = partial(make_page, task, name, (answer, cells), figures)
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(task, figures), task.notes, page, status=int(bool(wrong)))
