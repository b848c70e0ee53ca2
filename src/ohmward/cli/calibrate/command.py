"""`ohmward calibrate`: radius, motors and floors of a robot, from drives whose true motion is known."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ohmward.cli.calibrate.report import make_page
from ohmward.cli.calibrate.result import describe, summary
from ohmward.cli.drive_inputs import read_drive_log, read_drive_truth, truth_names
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import split_selection
from ohmward.cli.progress import Report, progress
from ohmward.errors import InputError
from ohmward.logs import DriveLog
from ohmward.logs.read import open_table
from ohmward.traction import Robot, load_robot, save_robot
from ohmward.traction.calibration import (
    Calibration,
    CalibrationDrive,
    calibrate,
    motion_from_pose,
    motion_from_truth,
    with_wheel_loads,
)
from ohmward.traction.calibration.calibrate import PARTS, usual_parts
from ohmward.traction.calibration.motor import ROLLING
from ohmward.traction.calibration.truth import without_lateral
from ohmward.traction.drive_checks import with_signed_speed
from ohmward.traction.terrain.file import Floors, load_floors, save_floors


def run(args: argparse.Namespace) -> Outcome:
    """Calibrate, write the robot and its floors."""
    check(args)
    robot = load_robot(args.robot)
    if args.wheel_load is not None:
        robot = with_wheel_loads(robot, args.wheel_load)
    with progress() as report:
        drives = read_drives(args, robot, report)
        found = calibrate(drives, robot, wanted(args, robot), args.floor, rolling(args.rolling))
    write(found, args)
    figures = summary(found) | {"output": args.output, "floors": args.floors, "report": args.report}
    return Outcome(figures, describe(found, figures), figures["notes"], partial(make_page, found, figures))


def check(args: argparse.Namespace) -> None:
    """Refuse what cannot work before anything is read.

    Raises:
        InputError: no truth or two, a floor without its file, or a file that cannot be written.
    """
    if (args.truth is None) == (args.pose is None):
        raise InputError("give either --truth COLUMN, a measured speed, or --pose X,Y,HEADING; see --help")
    if (args.floor is None) != (args.floors is None):
        raise InputError("--floor NAME and --floors FILE.toml belong together: the floor's name, and where it is kept")
    inputs = [str(split_selection(text)[0]) for text in args.logs]
    check_output("--output", args.output, (".toml",), inputs)
    check_output("--floors", args.floors, (".toml",), inputs)


def wanted(args: argparse.Namespace, robot: Robot) -> tuple[str, ...]:
    """Parts of the robot to calibrate.

    Raises:
        InputError: something else.
    """
    if args.what is None:
        return () if args.floor else usual_parts(robot)
    names = tuple(name.strip() for name in args.what.split(","))
    if unknown := [name for name in names if name not in PARTS]:
        raise InputError(f"--what takes {', '.join(PARTS)}, separated by commas; got {unknown[0]!r}")
    return names


def rolling(given: list[float] | None) -> tuple[float, float]:
    """Rolling resistance of the floor and its standard deviation, by default half of it."""
    if given is None:
        return ROLLING
    return given[0], given[1] if len(given) > 1 else 0.5 * given[0]


def read_drives(args: argparse.Namespace, robot: Robot, report: Report | None) -> tuple[CalibrationDrive, ...]:
    """The recordings that the arguments name, with the motion of the body."""
    texts: list[str] = []
    for text in args.logs:
        texts += recordings(text, args.each)
    drives = []
    for k, text in enumerate(texts, start=1):
        drives.append(read_one(text, robot, args))
        if report:
            report("reading", k / len(texts))
    return tuple(drives)


def recordings(text: str, each: str | None) -> list[str]:
    """The file with each value of the column `each`, in order; the file itself without one.

    Raises:
        InputError: no such column.
    """
    if each is None:
        return [text]
    path, where = split_selection(text)
    file = open_table(path)
    if each not in file.names:
        raise InputError(f"{path}: there is no column {each!r} for --each; it has: {', '.join(file.names)}")
    values = np.unique(np.asarray(file.load({each}).columns[each], dtype=float))
    chosen = "".join(f"{name}={value}," for name, value in where.items())
    return [f"{path}:{chosen}{each}={value:g}" for value in values[np.isfinite(values)]]


def read_one(text: str, robot: Robot, args: argparse.Namespace) -> CalibrationDrive:
    """One recording with the motion of the body."""
    names = truth_names(args.truth) if args.truth else [name.strip() for name in args.pose.split(",")]
    log = read_drive_log(text, robot, args, leave=names)
    if args.pose:
        return CalibrationDrive(log, pose_motion(log, names, args, robot))
    truth = read_drive_truth(log, robot, args.truth).truth
    signed = with_signed_speed(robot, replace(log, speed_m_s=truth.speed_m_s, speed_age_s=None))
    assert signed.speed_m_s is not None
    truth = truth._replace(speed_m_s=signed.speed_m_s)
    return CalibrationDrive(replace(log, notes=signed.notes), motion_from_truth(robot, log.time_s, truth))


def pose_motion(log: DriveLog, names: list[str], args: argparse.Namespace, robot: Robot) -> np.ndarray:
    """Motion (T, freedoms) from a pose.

    Raises:
        InputError: not three columns, or one that the log does not have.
    """
    if len(names) != 3 or any(name not in log.extra for name in names):
        raise InputError(
            f"{log.name}: --pose takes three columns X,Y,HEADING of the log, got {args.pose!r}; "
            f"it has: {', '.join(log.extra)}"
        )
    x, y, heading = (log.extra[name] for name in names)
    scale = np.radians(1.0) if args.pose_unit == "deg" else 1.0
    turned = scale * heading + np.radians(args.pose_turn)
    motion = motion_from_pose(log.time_s, args.pose_scale[0] * x, args.pose_scale[-1] * y, turned)
    return without_lateral(robot, motion)


def write(found: Calibration, args: argparse.Namespace) -> None:
    """Write the files that the options name."""
    if args.output:
        save_robot(found.robot, args.output)
    if args.floors and found.floor:
        known = load_floors(args.floors) if Path(args.floors).exists() else Floors(found.robot.name)
        save_floors(known.with_floor(found.floor), args.floors)
