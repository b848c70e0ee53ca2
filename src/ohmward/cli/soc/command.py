"""`ohmward soc`: state of charge along a log, with its uncertainty, and its errors where there is a truth."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ohmward.cli import wording
from ohmward.cli.estimating import SocTask, add_task_options, estimate, make_task
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, add_output_options
from ohmward.cli.progress import Report, counting, progress
from ohmward.filters.consistency import BAND_95

if TYPE_CHECKING:
    import numpy as np

    from ohmward.battery.soc.estimator import SocRun

_EXAMPLES = """\
  ohmward soc day.csv --battery battery.toml
  ohmward soc day.csv --battery battery.toml --initial-soc 1.0 --filter ukf -o estimates.csv --report soc.html
  ohmward soc day.csv --battery battery.toml --truth soc_true --json
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "soc", "state of charge along a log, with its uncertainty", _EXAMPLES)
    add_task_options(parser)
    parser.add_argument(
        "--filter",
        default="ekf",
        metavar="NAME",
        help="ekf, ukf, aekf, aukf, hybrid, rc-kf, rc-soc, rc-aukf, textbook-ekf, textbook-ukf, coulomb or ocv "
        "(default %(default)s)",
    )
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv or .parquet")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Estimate, compare with the truth, write the estimates."""
    check_output("--output", args.output, (".csv", ".parquet"), [args.log, args.battery])
    with progress() as report:
        task = make_task(args, report)
        answer = estimate(task, args.filter, args, report)
        if args.output:
            _write(task, answer, args.output, report)
    figures = summary(task, args.filter, answer)

    def page():
        from ohmward.cli.soc.report import make_page

        return make_page(task, args.filter, answer, figures)

    return Outcome(figures | {"output": args.output, "report": args.report}, describe(task, figures), task.notes, page)


def summary(task: SocTask, name: str, answer: SocRun) -> dict[str, Any]:
    """The object of --json."""
    from ohmward.cli.scoring import soc_scores, voltage_score

    log, estimates = task.log, answer.estimates
    voltage = voltage_score(log, estimates)
    return {
        "command": "soc",
        "log": log.name,
        "battery": task.battery.name,
        "filter": name,
        "steps": len(log),
        "seconds": answer.seconds,
        "duration_s": log.duration_s,
        "soc_initial": float(estimates.soc[0]),
        "soc_final": float(estimates.soc[-1]),
        "soc_std_final": float(estimates.soc_std[-1]),
        "soc_min": float(estimates.soc.min()),
        "soc_max": float(estimates.soc.max()),
        "voltage_rmse_V": voltage.rmse if voltage else None,
        "current_offset_A": float(estimates.current_offset_A[-1]),
        "soh_capacity": float(estimates.soh_capacity[-1]),
        "resistance_ratio": float(estimates.resistance_ratio[-1]),
        "flags": answer.counts(),
        **soc_scores(log, estimates, task.truth.soc if task.truth else None),
        "truth": task.truth.note if task.truth else None,
        "notes": task.notes,
    }


def describe(task: SocTask, figures: dict[str, Any]) -> str:
    """The same for people."""
    from ohmward.battery.soc.registry import ESTIMATORS

    title = f"{figures['log']} with battery {figures['battery']!r}\n{figures['filter']}: "
    assumed = [note.removeprefix("info: ") for note in task.notes]
    return wording.paragraphs(
        title + ESTIMATORS[figures["filter"]].title,
        wording.fields(result(figures)),
        errors(figures) if task.truth else "",
        wording.bullets("Assumed", assumed),
    )


def result(figures: dict[str, Any]) -> dict[str, str]:
    """The key figures of a run with their units, by name."""
    flags = ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in figures["flags"].items())
    band = wording.percent(BAND_95 * figures["soc_std_final"], 1)
    rows = {
        "SoC at the end": f"{wording.percent(figures['soc_final'], 1)} ± {band} (95 %)",
        "SoC before": f"started at {wording.percent(figures['soc_initial'], 1)}, "
        f"ran from {wording.percent(figures['soc_min'], 1)} to {wording.percent(figures['soc_max'], 1)}",
        "voltage error": wording.quantity(figures["voltage_rmse_V"], "mV RMS", 1e3),
        "current offset": wording.quantity(figures["current_offset_A"], "mA", 1e3),
        "capacity": f"{wording.percent(figures['soh_capacity'], 1)} of the battery file's",
        "resistance": f"{wording.percent(figures['resistance_ratio'], 1)} of the battery file's",
        "flagged samples": flags or "none",
        "steps": f"{figures['steps']:,} in {figures['seconds']:.2g} s",
    }
    return {name: value for name, value in rows.items() if value.split()[0] != "-"}


def errors(figures: dict[str, Any]) -> str:
    """Errors against the truth as a table."""
    rows = [
        [title, *(wording.percent(figures[key + suffix]) for suffix in ("", "_after_1h"))]
        for title, key in (
            ("root mean square error", "soc_rmse"),
            ("mean absolute error", "soc_mae"),
            ("largest error", "soc_max_error"),
            ("truth inside the 95 % band", "coverage_95"),
        )
    ]
    return wording.table(["against the truth", "whole log", "after 1 h"], rows)


def _write(task: SocTask, answer: SocRun, path: str, report: Report | None) -> None:
    """The estimates beside what was measured, as a file that `ohmward` can read as a log."""
    from ohmward.logs import write_table

    write_table(estimate_table(task, answer), path, counting(report, f"writing {Path(path).name}"))


def estimate_table(task: SocTask, answer: SocRun) -> dict[str, np.ndarray]:
    """Columns (T,) of the estimates file, by name."""
    log, e = task.log, answer.estimates
    clock = {} if log.start_unix_s is None else {"unix_time_s": log.start_unix_s + log.time_s}
    columns = {
        "time_s": log.time_s,
        **clock,
        "current_A": log.current_A,
        "voltage_V": log.voltage_V,
        "soc": e.soc,
        "soc_std": e.soc_std,
        "voltage_expected_V": e.voltage_V,
        "voltage_expected_std_V": e.voltage_std_V,
        "innovation_V": e.innovation_V,
        "current_offset_A": e.current_offset_A,
        "soh_capacity": e.soh_capacity,
        "resistance_ratio": e.resistance_ratio,
        "flags": e.flags.astype(int),
    }
    return columns | ({"soc_truth": task.truth.soc} if task.truth else {})
