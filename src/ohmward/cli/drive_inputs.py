"""Robot, ground, log of a drive and its truth, from the options of a command."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.cli.battery_inputs import read_options
from ohmward.cli.options import TRUTHS
from ohmward.errors import InputError
from ohmward.logs import DriveLog, read_drive
from ohmward.logs.bags.bag_table import OUTSIDE_YAW_RATE
from ohmward.logs.channels import WHEEL_SPEED
from ohmward.logs.log import ReadOptions
from ohmward.logs.read import open_table
from ohmward.logs.selection import selected_name, split_selection
from ohmward.logs.table import TableFile
from ohmward.logs.units import unit_in_name
from ohmward.logs.wheel_columns import wheel_places
from ohmward.traction import Robot
from ohmward.traction.calibration import CalibrationDrive, motion_from_pose, motion_from_truth
from ohmward.traction.calibration.stretches import without_lateral
from ohmward.traction.drive_checks import with_signed_speed
from ohmward.traction.score import DriveTruth

#: Wheels whose columns are asked for where none is recognised.
TWO_WHEELS = ("left", "right")


class DriveReference(NamedTuple):
    """Truth of a drive, and its origin in one sentence."""

    truth: DriveTruth
    note: str


class DriveOptions(NamedTuple):
    """How to read the drives of a robot."""

    robot: Robot | None  #: None where the columns name the wheels and all are driven
    reading: ReadOptions
    motor_shaft: bool
    counts_per_turn: float | None
    radius_m: float | None = None  #: of the wheels; None for the robot's, nan if it is not known

    @property
    def shaft_words(self) -> list[str]:
        """The words of `add_shaft_options` that these options come from."""
        count = [] if self.counts_per_turn is None else ["--counts-per-turn", f"{self.counts_per_turn:g}"]
        return [*(["--motor-shaft"] if self.motor_shaft else []), *count]

    def places_in(self, names: Sequence[str]) -> tuple[str, ...]:
        """Names of the wheels without a robot: those that --column names, else those in the names of columns."""
        ending = f"_{WHEEL_SPEED.name}"
        named = tuple(kind.removesuffix(ending) for kind, _ in self.reading.columns if kind.endswith(ending))
        return named or wheel_places(names)

    def read(
        self,
        text: str,
        extra: Collection[str] | None = None,
        leave: Collection[str] = (),
        file: TableFile | None = None,
    ) -> DriveLog:
        """The drive that an argument names.

        text: a file, or a file and a choice of its rows, `gray.parquet:exp=5`, which becomes part of the log's name.
        extra: further columns to keep; None keeps every numeric one.
        leave: columns that are truths, not sensors, whatever their names suggest.
        file: the same file, if it is open already.

        Raises:
            InputError: the file cannot be read as a drive of this robot.
        """
        path, where = split_selection(text)
        file = file or open_table(path, self.reading.hints)
        places = () if self.robot else self.places_in(file.part("drive").names) or TWO_WHEELS
        log = read_drive(
            file,
            self.robot or places,
            len(places) or None,
            radius_m=self.radius_m,
            at_motor_shaft=self.motor_shaft,
            counts_per_turn=self.counts_per_turn,
            columns=dict(self.reading.columns),
            units=dict(self.reading.units),
            where=dict(self.reading.where) | where,
            extra=extra,
            leave=leave,
            sort_time=self.reading.sort_time,
            hints=self.reading.hints,
        )
        return replace(log, name=selected_name(log.name, where))


def drive_options(args: argparse.Namespace, robot: Robot | None) -> DriveOptions:
    """How to read drives of this robot, from the options of `add_drive_options`."""
    return DriveOptions(robot, read_options(args), args.motor_shaft, args.counts_per_turn)


def read_drive_truth(log: DriveLog, robot: Robot, text: str) -> DriveReference:
    """The truth in the columns that --truth names: speed, then yaw rate, then lateral speed, separated by commas.

    The slip ratios come from the columns `<wheel>_slip_true`, if the log has them for all driven wheels.

    Raises:
        InputError: there is no such column.
    """
    named = dict(zip(TRUTHS, truth_names(text), strict=False))
    known = {}
    for kind, name in named.items():
        if name:
            unit = unit_in_name(name, (TRUTHS[kind],))  # assumed SI where the name has none
            known[kind] = log.column(name) * (unit.scale if unit else 1.0)
    slips = [f"{wheel}_slip_true" for wheel in robot.driven_wheels]
    slip = np.column_stack([log.extra[name] for name in slips]) if set(slips) <= set(log.extra) else None
    truth = DriveTruth(known["speed"], known.get("yaw rate"), known.get("lateral speed"), slip)
    note = ", ".join(f"{kind} from {name!r}" for kind, name in named.items() if name)
    how = "from the speeds of body and wheels" if slip is None else f"from {', '.join(map(repr, slips))}"
    return DriveReference(truth, f"truth: {note}; slip {how}")


def read_calibration_drive(
    text: str, robot: Robot, options: DriveOptions, args: argparse.Namespace
) -> CalibrationDrive | DriveLog:
    """One recording with the motion of the body, from the columns that --truth or --pose names; else from its sensors.

    Raises:
        InputError: both, or columns that the log does not have.
    """
    if args.truth and args.pose:
        raise InputError("give either --truth COLUMN, a measured speed, or --pose X,Y,HEADING")
    if args.pose:
        names = [name.strip() for name in args.pose.split(",")]
        log = options.read(text, leave=names)
        return CalibrationDrive(log, _pose_motion(log, names, robot, args))
    log = options.read(text, leave=truth_names(args.truth))
    if not args.truth:
        outside = log.extra.get(OUTSIDE_YAW_RATE)
        return log if outside is None or log.yaw_rate_rad_s is not None else replace(log, yaw_rate_rad_s=outside)
    known = read_drive_truth(log, robot, args.truth).truth
    log = with_signed_speed(robot, replace(log, speed_m_s=known.speed_m_s, speed_age_s=None))
    if known.yaw_rate_rad_s is None and known.lateral_speed_m_s is None:
        return log
    assert log.speed_m_s is not None
    return CalibrationDrive(log, motion_from_truth(robot, log.time_s, known._replace(speed_m_s=log.speed_m_s)))


def _pose_motion(log: DriveLog, names: Sequence[str], robot: Robot, args: argparse.Namespace) -> np.ndarray:
    """Motion (T, freedoms) from a pose in these columns.

    Raises:
        InputError: not three columns, or one that the log does not have.
    """
    unit_rad = np.radians(1.0) if args.pose_unit == "deg" else 1.0
    if of_topic := _pose_of_topic(log, names):
        x, y, heading_rad = of_topic
    elif len(names) == 3 and all(name in log.extra for name in names):
        x, y, heading_rad = (scale * log.extra[name] for name, scale in zip(names, (1.0, 1.0, unit_rad), strict=True))
    else:
        raise InputError(
            f"{log.name}: --pose takes three columns X,Y,HEADING of the log, got {args.pose!r}, or a topic, given to "
            f"--topic too; it has: {', '.join(log.extra)}"
        )
    scale = args.pose_scale  # metres per unit of x and y, or of both
    heading_rad = heading_rad + np.radians(args.pose_turn)
    return without_lateral(robot, motion_from_pose(log.time_s, scale[0] * x, scale[-1] * y, heading_rad))


def _pose_of_topic(log: DriveLog, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """x, y and heading [rad] (T,) of a topic of ROS with a position and a quaternion; None where there is none."""
    of_topic = {name.replace("translation", "position").replace("rotation", "orientation"): name for name in log.extra}
    ends = ("position.x", "position.y", *(f"orientation.{axis}" for axis in "xyzw"))
    found = [
        n for end in ends for n in of_topic if len(names) == 1 and n.startswith(f"{names[0]}/") and n.endswith(end)
    ]
    if len(found) != len(ends):
        return None
    x, y, a, b, c, d = (log.extra[of_topic[name]] for name in found)
    return x, y, np.arctan2(2.0 * (d * c + a * b), 1.0 - 2.0 * (b * b + c * c))


def truth_names(text: str | None) -> list[str]:
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
