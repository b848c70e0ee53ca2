"""`ohmward compare`: estimators on one log, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial

from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.fit_check import is_judged, misfits
from ohmward.battery.soc.registry import DEFAULT, available, chosen_name
from ohmward.cli.battery_inputs import SocTask, estimate, make_soc_task
from ohmward.cli.compare.report import make_page
from ohmward.cli.compare.result import describe, summary
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import progress
from ohmward.errors import InputError
from ohmward.logs.log import Note


def run(args: argparse.Namespace) -> Outcome:
    """Run every estimator over the same log from the same start."""
    with progress() as report:
        task = make_soc_task(args, report)
        names = estimator_names(task.battery, args.filters, args.published)
        answers = {name: estimate(task, name, args, report) for name in names}
    wrong = _misfits(task, answers)
    task = task._replace(log=task.log.with_notes(*wrong))
    figures = summary(task, answers) | {"fits": not wrong}
    page = partial(make_page, task, answers, figures)
    status = int(bool(wrong))
    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page, status)


def _misfits(task: SocTask, answers: Mapping[str, SocRun]) -> tuple[Note, ...]:
    """The verdict of `ohmward soc` on the file: by its default estimator, or by the first one that can judge it."""
    default = chosen_name(DEFAULT, task.battery)
    by_rank = sorted(answers, key=lambda name: (name != default, not is_judged(answers[name].settings)))
    answer = answers[by_rank[0]]
    return misfits(task.battery, task.log, answer.settings, answer.estimates)


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
