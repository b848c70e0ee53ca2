"""`ohmward compare`: all estimators on one log, side by side."""

from __future__ import annotations

import argparse
from functools import partial

from ohmward.battery.battery import Battery
from ohmward.battery.soc.registry import available
from ohmward.cli.battery_inputs import estimate, make_soc_task
from ohmward.cli.compare.report import make_page
from ohmward.cli.compare.result import describe, summary
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import progress
from ohmward.errors import InputError


def run(args: argparse.Namespace) -> Outcome:
    """Run every estimator over the same log from the same start."""
    with progress() as report:
        task = make_soc_task(args, report)
        answers = {name: estimate(task, name, args, report) for name in estimator_names(task.battery, args.filters)}
    figures = summary(task, answers)
    page = partial(make_page, task, answers, figures)
    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page)


def estimator_names(battery: Battery, wanted: str | None) -> tuple[str, ...]:
    """Names of the estimators to compare.

    wanted: separated by commas; None takes all that the battery file allows.

    Raises:
        InputError: the file allows none.
    """
    names = tuple(name.strip() for name in wanted.split(",")) if wanted else available(battery)
    if not names:
        raise InputError(
            f"battery {battery.name!r}: no estimator works with the models in its file; "
            "identify it with --model thevenin-2rc"
        )
    return names
