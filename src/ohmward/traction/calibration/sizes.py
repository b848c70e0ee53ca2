"""A robot whose radius and track nobody measured, from drives with a speed or pose from outside and a gyro."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.calibration.calibrate import Calibration, calibration_notes, drive_notes, with_sensed_motion
from ohmward.traction.calibration.parameters import (
    TURNS_BY,
    Parameter,
    calibrate_radius,
    calibrate_track,
    with_parameters,
)
from ohmward.traction.calibration.stretches import CalibrationDrive, cut
from ohmward.traction.odometry.model import RADIUS_STD
from ohmward.traction.robot.packaged import generic_robot
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import travel_speed

#: Wheel radius and track [m] with which a drive is read; the results do not depend on them.
_START_RADIUS_M, _START_TRACK_M = 0.05, 0.5
#: Argument of `generic_robot` for a number of the robot file that drives show, and its factor on that.
_ARGUMENTS = {
    "chassis.track_m": ("track_m", 1.0),
    "chassis.arm_m": ("track_m", 2.0),
    "chassis.wheelbase_m": ("wheelbase_m", 1.0),
}


class Sizes(NamedTuple):
    """Arguments of `generic_robot`, None for a size that drives are to show."""

    mass_kg: float
    wheel_radius_m: float | None = None
    track_m: float | None = None
    wheelbase_m: float | None = None
    gear_ratio: float = 1.0
    layout: str = "two-wheel"

    def robot(self) -> Robot:
        """The generic robot, with sizes to read a drive with where none are known."""
        radius_m, track_m = self.wheel_radius_m or _START_RADIUS_M, self.track_m or _START_TRACK_M
        return generic_robot(self.mass_kg, radius_m, track_m, self.wheelbase_m, self.gear_ratio, self.layout)

    def turning(self) -> tuple[str, float]:
        """Argument for the size by which this layout turns, "" where no drive shows it, and its factor."""
        return _ARGUMENTS.get(TURNS_BY.get(type(self.robot().chassis), ""), ("", 1.0))

    def start(self) -> Robot:
        """The robot for which the drives are read.

        Raises:
            InputError: no drive shows the track of this layout.
        """
        if self.track_m is None and self.turning()[0] != "track_m":
            raise InputError(f"no drive shows the track of a {self.layout} robot; measure it: --track M (track_m)")
        return self.robot()


def robot_from_drives(drives: Sequence[CalibrationDrive | DriveLog], sizes: Sizes) -> Calibration:
    """Generic robot with the radius and the track, wheelbase or arm that drives show, if they were not given.

    Also the effective track of a skid-steered robot and the zero of a steering angle.

    drives: read for `sizes.start()`; without a speed from outside the radius must be given.

    Raises:
        InputError: the drives do not show a size; the message names the argument that gives it.
    """
    robot = sizes.start()
    known = [with_sensed_motion(robot, drive, sizes.wheel_radius_m is not None) for drive in drives]
    found: list[Parameter] = []
    if sizes.wheel_radius_m is None:
        rows = cut(known, robot)
        scale = float(travel_speed(rows.motion).sum() / travel_speed(rows.rim).sum())
        robot = replace(robot, wheel=replace(robot.wheel, radius_m=scale * robot.wheel.radius_m))
        found.append(_required(calibrate_radius(known, robot), "--radius (wheel_radius_m)"))
        robot = with_parameters(robot, found)
        rolling = math.sqrt(2.0) if sizes.layout == "mecanum" else 1.0
        sizes = sizes._replace(wheel_radius_m=rolling * robot.wheel.radius_m)
    radius_std = found[0].std / found[0].value if found else RADIUS_STD
    size, factor = sizes.turning()
    if size and getattr(sizes, size) is None:
        turning = calibrate_track(known, robot, radius_std)
        value_m = _required(turning[0], f"--{size.removesuffix('_m')} ({size})").value
        known_size: dict[str, Any] = {size: factor * value_m}
        sizes = sizes._replace(**known_size)
        found += turning
    elif robot.chassis.scrubs:
        found += calibrate_track(known, robot, radius_std)
    robot = with_parameters(sizes.robot(), found)
    each = zip(drives, known, strict=True)
    notes = [note for drive, sensed in each for note in drive_notes(robot, drive, sensed)]
    return Calibration(robot, tuple(found), None, tuple(known), (*notes, *calibration_notes(known, robot, found)))


def _required(found: Parameter, option: str) -> Parameter:
    if not found.identified:
        raise InputError(f"the drives do not show {found.name}: {found.reason}; give {option}, or another drive")
    return found
