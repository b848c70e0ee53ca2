"""`ohmward mission`: energy of a drive, consumption on each ground, range, and the forecast of a plan."""

from __future__ import annotations

import argparse
from functools import partial

from ohmward.cli.mission.inputs import (
    check,
    earlier_consumption,
    read_logs,
    settings_of,
)
from ohmward.cli.mission.report import make_page
from ohmward.cli.mission.result import describe, summary
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import counting, progress
from ohmward.cli.sensor import load_battery_with_sensor
from ohmward.energy import save_consumption
from ohmward.energy.mission import analyse
from ohmward.energy.plan_file import EXAMPLE, load_plan
from ohmward.traction import load_robot


def run(args: argparse.Namespace) -> Outcome:
    """Learn from the log, look ahead, write the table."""
    if args.plan_example:
        return Outcome({"command": "mission", "plan_example": EXAMPLE}, EXAMPLE.rstrip("\n"))
    check_output("--output", args.output, (".toml",), [p for p in (args.log, args.plan, args.battery) if p])
    check(args)
    battery, contradictions = load_battery_with_sensor(args.battery, args)
    robot = load_robot(args.robot) if args.robot else None
    plan = load_plan(args.plan) if args.plan else None
    before, origin = earlier_consumption(args, robot)
    log, drive, ground = read_logs(args, robot)
    settings = settings_of(args, robot)
    with progress() as report:
        told = counting(report, "ukf") if drive else None
        result = analyse(
            battery, before, log, drive=drive, robot=robot, ground=ground, plan=plan, settings=settings, progress=told
        )
    if args.output:
        save_consumption(result.consumption, args.output)
    warnings = [f"warning: {text}" for text in contradictions]
    figures = summary(result, robot, [origin, *warnings, *map(str, result.notes)])
    written = {"output": args.output, "report": args.report}
    return Outcome(figures | written, describe(figures), figures["notes"], partial(make_page, result, figures))
