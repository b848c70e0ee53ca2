"""What the commands about driving share: their options, and a robot, its ground and its logs made ready."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ohmward.cli.parser import pair, positive
from ohmward.cli.reading import split_selection
from ohmward.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from ohmward.logs import DriveLog
    from ohmward.traction import Robot, Terrain
    from ohmward.traction.score import DriveTruth

#: Robots that come with the package, by the name that --robot takes; any other is a file.
BUILT_IN = ("rlma", "robotino")
DEFAULT_TERRAIN = "dry asphalt"

#: What --truth may name, in order, and what it is measured in.
TRUTHS = {"speed": "speed", "yaw rate": "rotation", "lateral speed": "speed"}


class NotedTruth(NamedTuple):
    """The reference of a drive, and where it comes from in one sentence."""

    values: DriveTruth
    note: str


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
    from ohmward.traction.friction.terrain import ADHESION, ROADS, SOILS, hard_terrain, soft_terrain

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


def read_drive_truth(log: DriveLog, robot: Robot, text: str) -> NotedTruth:
    """The truth in the columns that --truth names: speed, then yaw rate, then lateral speed, separated by commas.

    The slip ratios are those of the columns `<wheel>_slip_true`, where the log has them for all driven wheels.

    Raises:
        InputError: there is no such column.
    """
    import numpy as np

    from ohmward.traction.score import DriveTruth

    named = dict(zip(TRUTHS, truth_columns(text), strict=False))
    known = {kind: _column(log, name, kind) for kind, name in named.items() if name}
    slips = [f"{place.name}_slip_true" for place in robot.places[: robot.driven]]
    slip = np.column_stack([log.extra[name] for name in slips]) if set(slips) <= set(log.extra) else None
    truth = DriveTruth(known["speed"], known.get("yaw rate"), known.get("lateral speed"), slip)
    note = ", ".join(f"{kind} from {name!r}" for kind, name in named.items() if name)
    how = "from the speeds of body and wheels" if slip is None else f"from {', '.join(map(repr, slips))}"
    return NotedTruth(truth, f"truth: {note}; slip {how}")


def truth_columns(text: str | None) -> list[str]:
    """The columns that --truth names, in the order of `TRUTHS`; an empty name leaves one out.

    Raises:
        InputError: too many, or none for the speed.
    """
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not names[0] or len(names) > len(TRUTHS):
        raise InputError(f"--truth takes the columns of {', '.join(TRUTHS)}, separated by commas; got {text!r}")
    return names


def _column(log: DriveLog, name: str, kind: str) -> np.ndarray:
    """(T,) the column in SI units."""
    from ohmward.logs.columns import guess, listed
    from ohmward.logs.units import unit_in_name

    if name not in log.extra:
        has = list(log.extra)
        there = f"it has: {listed(has)}" if has else "it has no further numeric columns"
        raise InputError(f"{log.name}: there is no column {name!r} for --truth{guess(name, has)}; {there}")
    unit = unit_in_name(name, (TRUTHS[kind],))
    return log.extra[name] * (unit.scale if unit else 1.0)
