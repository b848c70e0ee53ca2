"""`ohmward compare`: estimators on one log, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from ohmward.battery.soc.comparison import Comparison, compare
from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.gaussian_sum import carries_errors
from ohmward.battery.soc.registry import DEFAULT, available, chosen_name, title_of
from ohmward.cli.battery_inputs import SocTask, make_soc_task
from ohmward.cli.outcome import Outcome, progress
from ohmward.cli.wording import paragraphs, table
from ohmward.figures import battery as pictures
from ohmward.figures.numbers import percent, quantity
from ohmward.figures.parts import wall_clock
from ohmward.report import Page
from ohmward.runs import duration


def run(args: argparse.Namespace) -> Outcome:
    """Run every estimator over the same log from the same start."""
    with progress() as report:
        task = make_soc_task(args, report)
        names = tuple(name.strip() for name in args.filters.split(",")) if args.filters else None
        if args.published and names is None:
            names = available(task.battery, with_published=True)
        compared = compare(
            replace(task.battery, idle_current_A=task.rest_current_A),
            task.log,
            names,
            truth=task.truth.soc if task.truth else None,
            initial_soc=task.initial_soc,
            initial_soc_std=task.initial_soc_std,
            progress=report,
        )
    judge = _judge(compared)
    wrong = judge.notes
    task = task._replace(log=task.log.with_notes(*wrong, *judge.exchanges))
    figures = summary(task, compared) | {"fits": not wrong}
    page = partial(make_page, task, compared, figures)
    status = int(bool(wrong))
    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page, status)


def _judge(compared: Comparison) -> SocRun:
    """Run that judges log and file as in `ohmward soc`: of the default estimator, or else the first that can."""
    default, runs = chosen_name(DEFAULT), compared.runs
    by_rank = sorted(runs, key=lambda name: (name != default, not carries_errors(runs[name].settings)))
    return runs[by_rank[0]]


#: Header, figure and text of each column of a table.
Columns = tuple[tuple[str, str, Callable[[Any], str]], ...]


def summary(task: SocTask, compared: Comparison) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "compare",
        "log": task.log.name,
        "battery": task.battery.name,
        "steps": len(task.log),
        "duration_s": task.log.duration_s,
        "estimators": compared.figures(),
        "soc_rms_differences": compared.soc_rms_differences(),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def describe(task: SocTask, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    tables = (table(header, rows) for header, rows in tables_of(task, figures))
    title = f"{figures['log']} with battery {figures['battery']!r}: {figures['steps']:,} samples"
    return paragraphs(title, *tables)


def tables_of(task: SocTask, figures: Mapping[str, Any]) -> list[tuple[list[str], list[list[str]]]]:
    """Header and rows of each table: as in [T] tables 3.1-3.3 and in [P]; without a truth, the mutual differences."""
    estimators = figures["estimators"]
    if task.truth:
        return [_table(estimators, _SIGNED), _table(estimators, _SIZES)]
    differences = figures["soc_rms_differences"]
    mutual = [[name, *(percent(row.get(other)) for other in differences)] for name, row in differences.items()]
    return [_table(estimators, _WITHOUT_TRUTH), (["SoC difference, RMS", *differences], mutual)]


_tenths = partial(percent, digits=1)
_millivolts = partial(quantity, unit="mV", scale=1e3)
_VOLTAGE: Columns = (
    ("voltage error: mean", "voltage_error_mean_V", _millivolts),
    ("std", "voltage_error_std_V", _millivolts),
    ("max", "voltage_max_error_V", _millivolts),
)
_PER_STEP: Columns = (("per step", "us_per_step", "{:.3g} us".format),)
_SIGNED: Columns = (
    *_VOLTAGE,
    ("SoC error: mean", "soc_error_mean", percent),
    ("std", "soc_error_std", percent),
    ("max", "soc_max_error", percent),
)
_SIZES: Columns = (
    ("SoC: MAE", "soc_mae", percent),
    ("RMSE", "soc_rmse", percent),
    ("max", "soc_max_error", percent),
    ("RMSE after 1 h", "soc_rmse_after_1h", percent),
    ("in 95 % band", "coverage_95", _tenths),
    *_PER_STEP,
)
_WITHOUT_TRUTH: Columns = (
    ("SoC at the end", "soc_final", _tenths),
    ("its std", "soc_std_final", _tenths),
    *_VOLTAGE,
    *_PER_STEP,
)


def _table(estimators: Mapping[str, Any], columns: Columns) -> tuple[list[str], list[list[str]]]:
    rows = [[name, *(text(figures[key]) for _, key, text in columns)] for name, figures in estimators.items()]
    return ["estimator", *(header for header, _, _ in columns)], rows


def make_page(task: SocTask, compared: Comparison, figures: Mapping[str, Any]) -> Page:
    """Tables, then states of charge and errors of all estimators on a common time axis."""
    log = task.log
    what = f"{len(compared.runs)} estimators, battery {task.battery.name!r}, {duration(log.duration_s)}"
    page = Page(f"{log.name}: estimators compared", what)
    for header, rows in tables_of(task, figures):
        page = page.table(header, [[None if cell == "-" else cell for cell in row] for row in rows])
    plots = pictures.comparison_figures(log, compared.runs, compared.truth)
    page = page.plot(*plots, pictures.current_figure(log), pictures.voltage_figure(log), clock=wall_clock(log))
    return page.heading("Estimators").table(["Name", "What it is"], [[n, title_of(n)] for n in compared.runs])
