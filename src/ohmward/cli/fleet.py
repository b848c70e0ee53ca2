"""`ohmward fleet`: thousands of logs of one battery type, one row for each."""

from __future__ import annotations

import argparse
import glob
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, add_log_options, count, positive, share
from ohmward.cli.progress import progress
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.fleet import Finished
    from ohmward.fleet.run import Work

_EXAMPLES = """\
  ohmward fleet 'logs/*.parquet' --battery battery.toml -o results
  ohmward fleet 'logs/**/*.csv' --battery battery.toml --filter ukf --processes 8 --estimates -o results --json
  ohmward fleet '/shared/logs/*.parquet' --battery battery.toml --dask tcp://10.0.0.5:8786 -o results
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "fleet", "state of charge of many logs, one row for each; can be resumed", _EXAMPLES)
    parser.add_argument("logs", nargs="+", metavar="LOGS", help="files or patterns, quoted: 'logs/**/*.parquet'")
    parser.add_argument("--battery", required=True, metavar="FILE.toml", help="battery file of all of them")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder for summary.csv and progress")
    group = parser.add_argument_group("estimation")
    group.add_argument("--filter", default="ekf", metavar="NAME", help="as in `ohmward soc` (default %(default)s)")
    group.add_argument("--initial-soc", type=share, metavar="S", help="at the start of every log; default: its voltage")
    group.add_argument(
        "--initial-soc-std", type=positive, default=0.03, metavar="S", help="how sure that is (default %(default)s)"
    )
    group.add_argument("--estimates", action="store_true", help="write the estimates of every log too, as Parquet")
    group = parser.add_argument_group("where")
    where = group.add_mutually_exclusive_group()
    where.add_argument("--processes", type=count, metavar="N", help="side by side; default: one for each processor")
    where.add_argument(
        "--dask", metavar="ADDRESS", help="on the workers of this scheduler, such as tcp://10.0.0.5:8786"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    add_log_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Estimate all, or what is left of an interrupted run."""
    from ohmward.battery.file import load_battery
    from ohmward.battery.soc.registry import make_estimator
    from ohmward.fleet import Job, ReadOptions, run_fleet

    if args.where:
        raise InputError("--where picks rows of one file; a fleet's files hold one recording each")
    make_estimator(args.filter, load_battery(args.battery))  # refused now, not in every process
    folder, paths = Path(args.output), find(args.logs)
    if args.dask:  # workers have other working folders
        folder, paths = folder.absolute(), [str(Path(path).absolute()) for path in paths]
    job = Job(
        battery=Path(args.battery).read_text(encoding="utf-8"),
        filter=args.filter,
        initial_soc=args.initial_soc,
        initial_soc_std=args.initial_soc_std,
        reading=ReadOptions(args.current_sign, tuple(args.column), tuple(args.unit), args.sort_time),
        estimates=str(folder / "estimates") if args.estimates else None,
    )
    with progress() as report:
        told = (lambda done, total: report(f"{done:,} of {total:,} logs", done / total)) if report else None
        finished = run_fleet(paths, job, folder, work(args), told)
    figures = summary(args, finished)
    return Outcome(figures, describe(figures, finished), status=0)


def work(args: argparse.Namespace) -> Work:
    """Where the batches are worked on."""
    from ohmward.fleet import in_processes, on_dask

    if args.dask:
        return partial(on_dask, address=args.dask)
    return partial(in_processes, processes=args.processes or os.cpu_count() or 1)


def find(patterns: list[str]) -> list[str]:
    """The files that the patterns match.

    Raises:
        InputError: one matches nothing.
    """
    found: list[str] = []
    for pattern in patterns:
        paths = [pattern] if Path(pattern).is_file() else glob.glob(pattern, recursive=True)  # noqa: PTH207 absolute too
        if not paths:
            raise InputError(f"no file matches {pattern!r}; check the pattern, and quote it for the shell")
        found += [path for path in paths if Path(path).is_file()]
    return found


def summary(args: argparse.Namespace, finished: Finished) -> dict[str, Any]:
    """The object of --json."""
    good = [row for row in finished.rows if not row.get("error")]
    return {
        "command": "fleet",
        "battery": args.battery,
        "filter": args.filter,
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
    }


def _most(function: Callable, rows: list[dict[str, Any]], name: str) -> float | None:
    """The least or largest value of those that have one."""
    return function((row[name] for row in rows if row[name] is not None), default=None)


def describe(figures: dict[str, Any], finished: Finished) -> str:
    """The same for people."""
    rows = {
        "logs": f"{figures['logs']:,}, {figures['resumed']:,} of them done before",
        "hours": f"{figures['hours']:,.1f} in {figures['samples']:,} samples",
        "least charge at the end": wording.percent(figures["soc_final_min"], 1),
        "least capacity": f"{wording.percent(figures['soh_capacity_min'], 1)} of the battery file's",
        "largest resistance": f"{wording.percent(figures['resistance_ratio_max'], 1)} of the battery file's",
        "could not be used": f"{figures['failed']:,}",
        "written": figures["summary"],
    }
    failures = [f"{row['path']}: {row['error']}" for row in finished.failed[:10]]
    more = len(finished.failed) - len(failures)
    failures += [f"and {more} more, see the column `error`"] if more > 0 else []
    return wording.paragraphs(wording.fields(rows), wording.bullets("Not used", failures))
