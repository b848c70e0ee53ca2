"""`ohmward compare`: all estimators on one log, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ohmward.cli import wording
from ohmward.cli.estimating import SocTask, add_task_options, estimate, make_task
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, add_output_options
from ohmward.cli.progress import progress
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.battery.soc.estimator import SocRun

_EXAMPLES = """\
  ohmward compare day.csv --battery battery.toml
  ohmward compare day.csv --battery battery.toml --truth soc_true --report compare.html
  ohmward compare day.csv --battery battery.toml --truth soc_true --filters coulomb,ekf,ukf --initial-soc 0.8 --json
"""

Column = Callable[[Mapping[str, Any]], str]


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "compare", "all estimators on one log, side by side", _EXAMPLES)
    add_task_options(parser)
    parser.add_argument("--filters", metavar="A,B,...", help="only these; default: all that the battery file allows")
    add_output_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Run every estimator over the same log from the same start."""
    with progress() as report:
        task = make_task(args, report)
        answers = {name: estimate(task, name, args, report) for name in _names(task, args.filters)}
    figures = summary(task, answers)

    def page():
        from ohmward.cli.compare.report import make_page

        return make_page(task, answers, figures)

    return Outcome(figures | {"report": args.report}, describe(task, figures), task.notes, page)


def summary(task: SocTask, answers: Mapping[str, SocRun]) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "compare",
        "log": task.log.name,
        "battery": task.battery.name,
        "steps": len(task.log),
        "duration_s": task.log.duration_s,
        "estimators": {name: _figures(task, answer) for name, answer in answers.items()},
        "soc_rms_differences": differences(answers),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def differences(answers: Mapping[str, SocRun]) -> dict[str, dict[str, float]]:
    """Root mean square difference of the state of charge between every two estimators."""
    import numpy as np

    soc = {name: answer.estimates.soc for name, answer in answers.items()}
    return {a: {b: float(np.sqrt(np.mean((soc[a] - soc[b]) ** 2))) for b in soc if b != a} for a in soc}


def describe(task: SocTask, figures: Mapping[str, Any]) -> str:
    """The same for people."""
    assumed = [note.removeprefix("info: ") for note in task.notes]
    tables = (wording.table(header, rows) for header, rows in tables_of(task, figures))
    title = f"{figures['log']} with battery {figures['battery']!r}: {figures['steps']:,} samples"
    return wording.paragraphs(title, *tables, wording.bullets("Assumed", assumed))


def tables_of(task: SocTask, figures: Mapping[str, Any]) -> list[tuple[list[str], list[list[str]]]]:
    """Header and rows of each table: as [T] tables 3.1-3.3, as [P], and the mutual differences without a truth."""
    estimators = figures["estimators"]
    if task.truth:
        return [_table(estimators, _SIGNED), _table(estimators, _SIZES)]
    return [_table(estimators, _WITHOUT_TRUTH), _difference_table(figures["soc_rms_differences"])]


def _names(task: SocTask, wanted: str | None) -> tuple[str, ...]:
    from ohmward.battery.soc.registry import available

    names = tuple(name.strip() for name in wanted.split(",")) if wanted else available(task.battery)
    if not names:
        raise InputError(
            f"battery {task.battery.name!r}: no estimator works with the models in its file; "
            "identify it with --model thevenin-2rc"
        )
    return names


def _figures(task: SocTask, answer: SocRun) -> dict[str, Any]:
    from ohmward.cli.scoring import soc_scores, voltage_score

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
    rows = [[name, *(cell(figures) for cell in columns.values())] for name, figures in estimators.items()]
    return ["estimator", *columns], rows


def _difference_table(differences: Mapping[str, Mapping[str, float]]) -> tuple[list[str], list[list[str]]]:
    rows = [[a, *(wording.percent(row.get(b)) for b in differences)] for a, row in differences.items()]
    return ["SoC difference, RMS", *differences], rows
