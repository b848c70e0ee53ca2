"""`ohmward slip`: speed and wheel slip along a drive, with their uncertainty, and errors where there is a truth."""

from __future__ import annotations

import argparse
from functools import partial

from ohmward.cli.drive_inputs import make_terrain, read_drive_log, read_drive_truth, truth_names
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.slip.report import make_page
from ohmward.cli.slip.result import SlipTask, describe, estimate_table, summary
from ohmward.errors import InputError
from ohmward.logs import write_table
from ohmward.logs.write import TABLES
from ohmward.traction import load_robot
from ohmward.traction.observed_drive import ObservedDrive, observe_drive, observe_on_floors
from ohmward.traction.terrain.file import load_floors


def run(args: argparse.Namespace) -> Outcome:
    """Observe, compare with the truth, write the estimates; the exit status is 1 if the model does not fit the log."""
    check_output("--output", args.output, TABLES, [args.log, args.robot])
    task = make_task(args)
    observed = observe(task, args)
    if args.output:
        write_table(estimate_table(task, observed), args.output)
    figures = summary(task, args.filter, observed)
    page = partial(make_page, task, observed, figures)
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(task, figures), figures["notes"], page, status=int(not observed.fits))


def make_task(args: argparse.Namespace) -> SlipTask:
    """Robot, ground, drive and truth that the options name."""
    if args.floor and not args.floors:
        raise InputError("--floor NAME chooses from --floors FILE.toml; give that too")
    robot = load_robot(args.robot)
    terrain = make_terrain(args.terrain, robot)
    truths = truth_names(args.truth)
    log = read_drive_log(args.log, robot, args, extra=None if truths else (), leave=truths)
    return SlipTask(robot, terrain, log, read_drive_truth(log, robot, args.truth) if truths else None)


def observe(task: SlipTask, args: argparse.Namespace) -> ObservedDrive:
    """Speed and slip by the observer of --filter, on the floors of --floors if they are given."""
    if args.floors:
        return observe_on_floors(task.robot, task.log, load_floors(args.floors), args.filter, args.floor)
    with progress() as report:
        return observe_drive(task.robot, task.log, task.terrain, args.filter, counting(report, args.filter))
