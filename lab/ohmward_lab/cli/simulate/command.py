"""`ohmward simulate`: a robot, its battery, its observer and its controller in closed loop; or a battery alone."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.errors import InputError
from ohmward.logs import write_table
from ohmward.logs.write import TABLES
from ohmward_lab.cli.simulate import cell
from ohmward_lab.cli.simulate.arguments import OF_CELLS
from ohmward_lab.cli.simulate.report import make_page
from ohmward_lab.cli.simulate.result import describe, summary
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import ClosedLoopRun, Scenario
from ohmward_lab.simulate.closed_loop.scenario_file import EXAMPLE, packaged_text


def run(args: argparse.Namespace) -> Outcome:
    """Print an example or the list, or simulate, write the log and report."""
    if args.example:
        return _example()
    if args.list:
        return _listed()
    if args.cell is not None:
        return cell.run(args)
    if given := [name for name in OF_CELLS if getattr(args, name) is not None]:
        raise InputError(f"--{given[0].replace('_', '-')} is of a battery alone: name it with --cell")
    scenario = _scenario(args)
    check_output("--output", args.output, TABLES, [args.scenario])
    answer = _simulate(scenario)
    if args.output:
        write_table(closed_loop.columns(answer), args.output)

    found = summary(answer)
    written = {"output": args.output, "report": args.report}
    return Outcome(found | written, describe(answer, found), answer.warnings, partial(make_page, answer))


def _scenario(args: argparse.Namespace) -> Scenario:
    if args.scenario is None:
        raise InputError(
            "name a scenario file, or one of `ohmward simulate --list`; --example prints one to start from"
        )
    scenario = closed_loop.find_scenario(args.scenario)
    return scenario if args.seed is None else replace(scenario, seed=args.seed)


def _simulate(scenario: Scenario) -> ClosedLoopRun:
    with progress() as report:
        return closed_loop.run(scenario, counting(report, scenario.name))


def _example() -> Outcome:
    text = packaged_text(EXAMPLE).rstrip()
    return Outcome({"command": "simulate", "example": text}, text)


def _listed() -> Outcome:
    scenarios = dict(closed_loop.packaged())
    text = f"ohmward simulate NAME\n\n{wording.fields(scenarios)}"
    return Outcome({"command": "simulate", "scenarios": scenarios}, text)
