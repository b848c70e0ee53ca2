"""`ohmward fleet`: thousands of logs of one battery type, one row for each."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ohmward.battery.file import BATTERY_FILE
from ohmward.battery.soc.registry import chosen_name, make_estimator
from ohmward.cli import wording
from ohmward.cli.battery_inputs import load_battery_with_sensor, read_options
from ohmward.cli.log_files import log_files
from ohmward.cli.outcome import Outcome
from ohmward.cli.progress import Report, progress
from ohmward.errors import InputError
from ohmward.fleet import Finished, Job, in_processes, on_dask, run_fleet
from ohmward.fleet.run import Executor

#: Logs of one kind that are listed for people.
_MOST_LISTED = 10


def run(args: argparse.Namespace) -> Outcome:
    """Estimate all, or what is left of an interrupted run."""
    if args.where:
        raise InputError("--where picks rows of one file; a fleet's files hold one recording each")
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    name = chosen_name(args.filter.lower(), battery)
    make_estimator(name, battery)  # refused now, not in every process
    folder = Path(args.output)
    paths = log_files(args.logs)
    if args.dask:  # workers have other working folders
        folder = folder.absolute()
        paths = [str(Path(path).absolute()) for path in paths]
    job = Job(
        battery=BATTERY_FILE.dump(battery) if contradictions else Path(args.battery).read_text(encoding="utf-8"),
        filter=name,
        initial_soc=args.initial_soc,
        initial_soc_std=args.initial_soc_std,
        reading=read_options(args),
        estimates=str(folder / "estimates") if args.estimates else None,
    )
    with progress() as report:
        finished = run_fleet(paths, job, folder, work(args), _progress_of(report))
    notes = [f"warning: {text}" for text in contradictions]
    figures = summary(args, finished) | {"filter": name, "notes": notes}
    return Outcome(figures, describe(figures, finished), notes, status=status(figures))


def _progress_of(report: Report | None) -> Callable[[int, int], None] | None:
    """Progress callback (done, total) that counts the logs; None where nobody watches."""
    if report is None:
        return None
    return lambda done, total: report(f"{done:,} of {total:,} logs", done / total)


def work(args: argparse.Namespace) -> Executor:
    """Executor of the batches: processes here, or the workers of a Dask scheduler."""
    if args.dask:
        return partial(on_dask, address=args.dask)
    return partial(in_processes, processes=args.processes or os.cpu_count() or 1)


def status(figures: dict[str, Any]) -> int:
    """Exit status: 2 where every log was refused, 1 where the battery file does not fit one, as of `ohmward soc`."""
    if figures["failed"] == figures["logs"]:
        return 2
    return int(bool(figures["misfits"]))


def summary(args: argparse.Namespace, finished: Finished) -> dict[str, Any]:
    """The object of --json."""
    good = [row for row in finished.rows if not row.get("error")]
    return {
        "command": "fleet",
        "battery": args.battery,
        "logs": len(finished.rows),
        "failed": len(finished.failed),
        "resumed": finished.resumed,
        "samples": sum(row["samples"] for row in good),
        "hours": sum(row["duration_s"] for row in good) / 3600.0,
        "soc_final_min": _most(min, good, "soc_final"),
        "soh_capacity_min": _most(min, good, "soh_capacity"),
        "resistance_ratio_max": _most(max, good, "resistance_ratio"),
        "summary": str(finished.summary),
        "errors": [{"path": row["path"], "error": row["error"]} for row in finished.failed],
        "misfits": [{"path": row["path"], "misfit": row["misfit"]} for row in good if row.get("misfit")],
    }


def _most(function: Callable, rows: list[dict[str, Any]], name: str) -> float | None:
    """The least or largest value of those that have one."""
    return function((row[name] for row in rows if row[name] is not None), default=None)


def describe(figures: dict[str, Any], finished: Finished) -> str:
    """Text for people."""
    rows = {
        "logs": f"{figures['logs']:,}, {figures['resumed']:,} of them done before",
        "hours": f"{figures['hours']:,.1f} in {figures['samples']:,} samples",
        "least charge at the end": wording.percent(figures["soc_final_min"], 1),
        "least capacity": f"{wording.percent(figures['soh_capacity_min'], 1)} of the battery file's",
        "largest resistance": f"{wording.percent(figures['resistance_ratio_max'], 1)} of the battery file's",
        "could not be used": f"{figures['failed']:,}",
        "battery file does not fit": f"{len(figures['misfits']):,}",
        "written": figures["summary"],
    }
    return wording.paragraphs(
        wording.fields(rows),
        wording.bullets("Not used", _first(figures["errors"], "error")),
        wording.bullets("Not to be trusted", _first(figures["misfits"], "misfit")),
        wording.assumptions(figures["notes"]),
    )


def _first(rows: list[dict[str, Any]], column: str) -> list[str]:
    """The logs with something in a column, at most `_MOST_LISTED` of them."""
    listed = [f"{row['path']}: {row[column]}" for row in rows[:_MOST_LISTED]]
    more = len(rows) - len(listed)
    return listed + ([f"and {more} more, see the column `{column}`"] if more > 0 else [])
