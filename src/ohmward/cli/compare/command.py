"""`ohmward compare`: estimators on one log, side by side."""

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
        names = estimator_names(task.battery, args.filters, args.published)
        answers = {name: estimate(task, name, args, report) for name in names}
    figures = summary(task, answers)
    page = partial(make_page, task, answers, figures)
    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page)


def estimator_names(battery: Battery, wanted: str | None, with_published: bool = False) -> tuple[str, ...]:
    """Names of the estimators to compare.

    wanted: separated by commas; None takes all that the battery file allows.
    with_published: among these, those that reproduce a publication too.

    Raises:
        InputError: the file allows none.
    """
    if wanted:
        return tuple(name.strip() for name in wanted.split(","))
    names = available(battery, with_published)
    if not names:
        raise InputError(
            f"battery {battery.name!r}: no estimator works with the models in its file; "
            "identify it with --model thevenin"
        )
    return names
