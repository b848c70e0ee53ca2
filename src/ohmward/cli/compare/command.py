"""`ohmward compare`: estimators on one log, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.fit_check import is_judged, misfits
from ohmward.battery.soc.registry import DEFAULT, available, chosen_name, title_of
from ohmward.battery.soc.score import soc_rms_differences, soc_scores, voltage_score
from ohmward.cli import wording
from ohmward.cli.battery_inputs import SocTask, make_soc_task
from ohmward.cli.outcome import Outcome, progress
from ohmward.cli.wording import FOOTER, duration, with_assumptions
from ohmward.errors import InputError
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.logs.log import Note
from ohmward.report import Page


def run(args: argparse.Namespace) -> Outcome:
    """Run every estimator over the same log from the same start."""
    with progress() as report:
        task = make_soc_task(args, report)
        names = estimator_names(task.battery, args.filters, args.published)
        answers = {name: task.estimate(name, report) for name in names}
    wrong = _misfits(task, answers)
    task = task._replace(log=task.log.with_notes(*wrong))
    figures = summary(task, answers) | {"fits": not wrong}
    page = partial(make_page, task, answers, figures)
    status = int(bool(wrong))
    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page, status)


def _misfits(task: SocTask, answers: Mapping[str, SocRun]) -> tuple[Note, ...]:
    """The verdict of `ohmward soc` on the file: by its default estimator, or by the first one that can judge it."""
    default = chosen_name(DEFAULT)
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


Column = Callable[[Mapping[str, Any]], str]


def summary(task: SocTask, answers: Mapping[str, SocRun]) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "compare",
        "log": task.log.name,
        "battery": task.battery.name,
        "steps": len(task.log),
        "duration_s": task.log.duration_s,
        "estimators": {name: _figures(task, answer) for name, answer in answers.items()},
        "soc_rms_differences": soc_rms_differences({name: answer.estimates for name, answer in answers.items()}),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def describe(task: SocTask, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    tables = (wording.table(header, rows) for header, rows in tables_of(task, figures))
    title = f"{figures['log']} with battery {figures['battery']!r}: {figures['steps']:,} samples"
    return wording.paragraphs(title, *tables, wording.assumptions(task.notes))


def tables_of(task: SocTask, figures: Mapping[str, Any]) -> list[tuple[list[str], list[list[str]]]]:
    """Header and rows of each table: as [T] tables 3.1-3.3, as [P], and the mutual differences without a truth."""
    estimators = figures["estimators"]
    if task.truth:
        return [_table(estimators, _SIGNED), _table(estimators, _SIZES)]
    return [_table(estimators, _WITHOUT_TRUTH), _difference_table(figures["soc_rms_differences"])]


def _figures(task: SocTask, answer: SocRun) -> dict[str, Any]:
    log, estimates = task.log, answer.estimates
    voltage = voltage_score(log, estimates)
    return {
        "seconds": answer.seconds,
        "us_per_step": 1e6 * answer.seconds / len(log),
        "soc_final": float(estimates.soc[-1]),
        "soc_std_final": float(estimates.soc_std[-1]),
        "voltage_error_mean_V": voltage.mean if voltage else None,
        "voltage_error_std_V": voltage.std if voltage else None,
        "voltage_max_error_V": voltage.max_error if voltage else None,
        "voltage_rmse_V": voltage.rmse if voltage else None,
        "flags": answer.counts(),
        **soc_scores(log, estimates, task.truth.soc if task.truth else None),
    }


def _percent(key: str, digits: int = 2) -> Column:
    return lambda figures: wording.percent(figures[key], digits)


def _millivolts(key: str) -> Column:
    return lambda figures: wording.quantity(figures[key], "mV", 1e3)


_SIGNED: dict[str, Column] = {
    "voltage error: mean": _millivolts("voltage_error_mean_V"),
    "std": _millivolts("voltage_error_std_V"),
    "max": _millivolts("voltage_max_error_V"),
    "SoC error: mean": _percent("soc_error_mean"),
    "std ": _percent("soc_error_std"),
    "max ": _percent("soc_max_error"),
}
_SIZES: dict[str, Column] = {
    "SoC: MAE": _percent("soc_mae"),
    "RMSE": _percent("soc_rmse"),
    "max": _percent("soc_max_error"),
    "RMSE after 1 h": _percent("soc_rmse_after_1h"),
    "in 95 % band": _percent("coverage_95", 1),
    "per step": lambda figures: f"{figures['us_per_step']:.3g} us",
}
_WITHOUT_TRUTH: dict[str, Column] = {
    "SoC at the end": _percent("soc_final", 1),
    "its std": _percent("soc_std_final", 1),
    **dict(list(_SIGNED.items())[:3]),
    "per step": _SIZES["per step"],
}


def _table(estimators: Mapping[str, Any], columns: Mapping[str, Column]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for name, figures in estimators.items():
        rows.append([name, *(cell(figures) for cell in columns.values())])
    return ["estimator", *columns], rows


def _difference_table(differences: Mapping[str, Mapping[str, float]]) -> tuple[list[str], list[list[str]]]:
    rows = []
    for name, row in differences.items():
        rows.append([name, *(wording.percent(row.get(other)) for other in differences)])
    return ["SoC difference, RMS", *differences], rows


def make_page(task: SocTask, answers: Mapping[str, SocRun], figures: Mapping[str, Any]) -> Page:
    """Tables, the state of charge of all on one clock, their errors."""
    log = task.log
    what = f"{len(answers)} estimators, battery {task.battery.name!r}, {duration(log.duration_s)}"
    page = Page(f"{log.name}: estimators compared", what, FOOTER)
    for header, rows in tables_of(task, figures):
        page = page.table(header, [[None if cell == "-" else cell for cell in row] for row in rows])
    estimates = {name: answer.estimates for name, answer in answers.items()}
    plots = [pictures.soc_comparison_figure(log, estimates, task.truth.soc if task.truth else None)]
    if task.truth:
        plots.append(pictures.soc_errors_figure(log, estimates, task.truth.soc))
    page = page.plot(*plots, pictures.current_figure(log), pictures.voltage_figure(log), clock=wall_clock(log))
    page = page.heading("Estimators").table(["Name", "What it is"], [[n, title_of(n)] for n in answers])
    return with_assumptions(page, task.notes)
