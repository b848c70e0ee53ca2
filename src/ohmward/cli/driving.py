"""What the commands about driving share: their options, and a robot, its ground and its logs made ready."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

from ohmward.cli.parser import pair, positive
from ohmward.cli.reading import split_selection
from ohmward.errors import InputError

if TYPE_CHECKING:
    from ohmward.logs import DriveLog
    from ohmward.traction import Robot, Terrain

#: Robots that come with the package, by the name that --robot takes; any other is a file.
BUILT_IN = ("rlma", "robotino")
DEFAULT_TERRAIN = "dry asphalt"


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """The robot and the ground that it is believed to drive on."""
    group = parser.add_argument_group("robot and ground")
    group.add_argument(
        "--robot",
        required=True,
        metavar="FILE.toml",
        help=f"robot file, or {' or '.join(BUILT_IN)}, which come with ohmward",
    )
    group.add_argument(
        "--terrain",
        default=DEFAULT_TERRAIN,
        metavar="NAME",
        help="ground that is believed at first, 'gravel' or 'soft soil' for example (default: %(default)s)",
    )


def add_drive_options(parser: argparse.ArgumentParser) -> None:
    """How to read the logs of drives, the same for every command."""
    group = parser.add_argument_group("reading logs of drives (CSV, Parquet)")
    for option, metavar, what in (
        ("--column", "KIND=NAME", "the column of front_left_wheel_speed, left_motor_current, yaw_rate, speed, ..."),
        ("--unit", "KIND=UNIT", "its unit, where the name is silent or wrong: wheel_speed=rpm, motor_current=mA"),
        ("--where", "NAME=VALUE", "only the rows with this value, where a file holds several recordings"),
    ):
        text = f"{what}; may be repeated"
        group.add_argument(option, metavar=metavar, type=pair, action="append", default=[], help=text)
    group.add_argument(
        "--motor-shaft", action="store_true", help="wheel speeds are those of the motors, before the gear"
    )
    group.add_argument(
        "--counts-per-turn", type=positive, metavar="N", help="of the encoders, where the columns hold their counts"
    )
    group.add_argument("--sort-time", action="store_true", help="sort rows that are out of order")


def make_robot(name: str) -> Robot:
    """The robot of --robot: one that comes with the package, or a file.

    Raises:
        InputError: the file cannot be read as a robot.
    """
    from ohmward.traction import RLMA, ROBOTINO, load_robot

    built_in = {"rlma": RLMA, "robotino": ROBOTINO}
    return built_in[name.lower()] if name.lower() in built_in else load_robot(name)


def make_terrain(name: str, robot: Robot) -> Terrain:
    """The ground of --terrain under this robot's wheels.

    Raises:
        InputError: there is no ground of that name; lists all.
    """
    from ohmward.traction.terrain import ADHESION, ROADS, SOILS, hard_terrain, soft_terrain

    if name in SOILS:
        return soft_terrain(name, robot.wheel.radius_m, robot.wheel.width_m)
    if name not in {*ADHESION, *ROADS}:
        raise InputError(f"--terrain must be one of {', '.join([*ADHESION, *ROADS, *SOILS])}; got {name!r}")
    return hard_terrain(name)


def read_drive_log(
    text: str,
    robot: Robot,
    args: argparse.Namespace,
    extra: Collection[str] | None = None,
    leave: Collection[str] = (),
) -> DriveLog:
    """The drive that an argument names, read as the options of `add_drive_options` say.

    text: a file, or a file and the rows wanted from it, `gray.parquet:exp=5`, then part of the log's name.
    extra: further columns to keep; None keeps every numeric one.
    leave: columns not to take for a sensor by their names: truths.

    Raises:
        InputError: the file cannot be read as a drive of this robot.
    """
    from ohmward.logs import read_drive

    path, where = split_selection(text)
    log = read_drive(
        path,
        [place.name for place in robot.places],
        robot.driven,
        radius_m=robot.wheel.radius_m,
        gear_ratio=robot.motor.gear_ratio,
        at_motor_shaft=args.motor_shaft,
        counts_per_turn=args.counts_per_turn,
        columns=dict(args.column),
        units=dict(args.unit),
        where=dict(args.where) | where,
        extra=extra,
        leave=leave,
        sort_time=args.sort_time,
    )
    chosen = ",".join(f"{name}={value}" for name, value in where.items())
    return replace(log, name=f"{log.name}:{chosen}") if chosen else log
