"""Calibration of a robot in one call: radius first, then track and motors with it, then the floor with all."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_one_of
from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog, DriveSource, as_drive
from ohmward.logs.log import Note
from ohmward.runs import between
from ohmward.traction.calibration.floor import learn_floor, unidentified_floor
from ohmward.traction.calibration.parameters import (
    ROLLING,
    Parameter,
    calibrate_motor,
    calibrate_radius,
    calibrate_track,
    with_parameters,
)
from ohmward.traction.calibration.stretches import LENGTH_S, CalibrationDrive, cut, motion_from_speed, stuck
from ohmward.traction.drive_checks import found_faults, mended
from ohmward.traction.odometry.model import OdometryNoise
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.robot.robot import GRAVITY, Robot, motion_from_wheels
from ohmward.traction.terrain.floor import Floor, travel_speed

#: Parts of a robot that can be calibrated.
PARTS = ("radius", "track", "motor")
#: Shifts [s] in which a true motion may be late, and from which it is a warning.
_MOST_SHIFT_S, _LEAST_SHIFT_S = 3.0, 0.3
#: Factor between the sum of the loads and the weight from which they are not in newtons.
_OTHER_UNIT = 3.0


class Calibration(NamedTuple):
    """The calibrated robot, its parameters, the floor if one was learnt, the drives behind them, and warnings."""

    robot: Robot
    parameters: tuple[Parameter, ...]
    floor: Floor | None
    drives: tuple[CalibrationDrive, ...]
    notes: tuple[Note, ...] = ()


def calibrate(
    drives: CalibrationDrive | DriveSource | Sequence[CalibrationDrive | DriveSource],
    robot: Robot | str | PathLike[str],
    parts: Collection[str] | None = None,
    floor: str | None = None,
    rolling: tuple[float, float] = ROLLING,
) -> Calibration:
    """Calibrate a robot from drives on one floor.

    >>> drive = ow.read_drive("drive.csv", ow.load_robot("rlma"), columns={"speed": "speed_true_m_s"})
    >>> found = ow.calibrate(drive, "rlma")
    >>> ow.save_robot(found.robot, "robot.toml")

    drives: one or several, with the motion of the body; a DriveLog, path or DataFrame whose speed from outside was
        measured will do, and for the track alone one with a gyro.
    robot: its mass and geometry are assumed correct; or the path of its file, or the name of a packaged one.
    parts: one or some of `PARTS`; None for `usual_parts`, without motors if no drive has their currents.
    floor: name under which the floor is learnt; None learns none.
    rolling: rolling resistance of the floor, share of the load, and its standard deviation.

    Raises:
        InputError: the drives have no stretch to calibrate from, a part that there is not, a rolling resistance outside
            [0, 1].
    """
    robot = robot if isinstance(robot, Robot) else load_robot(robot)
    usual = parts is None
    parts = usual_parts(robot) if parts is None else (parts,) if isinstance(parts, str) else parts
    for part in parts:
        require_one_of("parts", part, PARTS)
    require_between("rolling", rolling, 0.0, 1.0)
    one = isinstance(drives, str | CalibrationDrive) or not isinstance(drives, Sequence)
    each: Any = [drives] if one else drives
    by_wheels = floor is None and set(parts) <= {"track"}
    each = [drive if isinstance(drive, CalibrationDrive) else as_drive(drive, robot) for drive in each]
    known = [with_sensed_motion(robot, drive, by_wheels) for drive in each]
    notes = [note for drive, sensed in zip(each, known, strict=True) for note in drive_notes(robot, drive, sensed)]
    if usual and "motor" in parts and not any(np.isfinite(drive.log.motor_current_A).any() for drive in known):
        parts = tuple(part for part in parts if part != "motor")
        notes.append(Note("the motors were not calibrated: no drive has their currents", "info"))
    found: list[Parameter] = []
    if "radius" in parts:
        found.append(calibrate_radius(known, robot))
        robot = with_parameters(robot, found)
    if "track" in parts:
        radius = [radius.std / radius.value if radius.identified else math.inf for radius in found]
        found += calibrate_track(known, robot, *radius)
        robot = with_parameters(robot, found)
    if "motor" in parts:
        found += calibrate_motor(known, robot, rolling)
        robot = with_parameters(robot, found)
    learnt = learn_floor(floor, known, robot) if floor else None
    notes += calibration_notes(known, robot, found)
    if learnt and (reason := unidentified_floor(learnt)):
        notes.append(Note(f"floor {floor!r} was not identified: {reason}", "warning"))
        learnt = None
    return Calibration(robot, tuple(found), learnt, tuple(known), tuple(notes))


def drive_notes(robot: Robot, drive: CalibrationDrive | DriveLog, sensed: CalibrationDrive) -> list[Note]:
    """Warnings of what was mended in the log of a drive, and of the faults that are left, with its name."""
    given = drive.log if isinstance(drive, CalibrationDrive) else drive
    mended_notes = [note for note in sensed.log.notes if note not in given.notes]
    found = [*found_faults(robot, sensed.log), *mended_notes]
    return [note._replace(text=f"{given.name}: {note.text}") for note in found]


def calibration_notes(drives: Sequence[CalibrationDrive], robot: Robot, found: Sequence[Parameter]) -> Iterator[Note]:
    """A warning for each parameter that something contradicts, and where the wheels turned and the robot stood."""
    yield from (Note(f"{parameter.name}: {parameter.warning}", "warning") for parameter in found if parameter.warning)
    for drive in drives:
        if late_s := lateness_s(drive, robot):
            when = f"{abs(late_s):.1f} s {'after' if late_s > 0.0 else 'before'} that of the wheels: shift its time"
            yield Note(f"{drive.log.name}: the true motion comes {when}", "warning")
    if count := int(stuck(cut(drives, robot, steady=False, turning=True, keep_stuck=True)).sum()):
        stretches = f"{count} stretch{'es' if count > 1 else ''} of {LENGTH_S:g} s"
        yield Note(f"{stretches} in which the wheels turn and the robot hardly moves: stuck, left out", "warning")


def lateness_s(drive: CalibrationDrive, robot: Robot) -> float:
    """Time [s] by which the true speed comes after that of the wheels, where a shift cures most of what is unlike.

    It is the shift of the largest correlation; 0 where that is small, or the speed is steady.
    """
    time_s = drive.log.time_s
    rim_m_s = travel_speed(motion_from_wheels(robot, drive.log.wheel_speed_rad_s[:, : robot.driven]))
    known = [
        (time_s[ok], speed[ok]) for speed in (rim_m_s, travel_speed(drive.motion)) if (ok := np.isfinite(speed)).any()
    ]
    grid_s = np.arange(time_s[0] + _MOST_SHIFT_S, time_s[-1] - _MOST_SHIFT_S, LENGTH_S / 10)
    if len(known) < 2 or grid_s.size < 10:
        return 0.0
    shifts_s = np.linspace(-_MOST_SHIFT_S, _MOST_SHIFT_S, 61)
    rim, *bodies = np.interp(grid_s, *known[0]), *(np.interp(grid_s + shift_s, *known[1]) for shift_s in shifts_s)
    with np.errstate(invalid="ignore", divide="ignore"):
        unlike = 1.0 - np.nan_to_num([np.corrcoef(rim, body)[0, 1] for body in bodies])
    best = int(unlike.argmin())
    cured = unlike[best] < 0.5 * unlike[shifts_s.size // 2]
    return float(shifts_s[best]) if cured and abs(shifts_s[best]) >= _LEAST_SHIFT_S else 0.0


def usual_parts(robot: Robot) -> tuple[str, ...]:
    """Parts that a calibration usually finds: the track only where no ruler can measure it, because wheels scrub.

    No ruler measures the zero of a steering angle either; motor currents of a steered robot are not used.
    """
    if isinstance(robot.chassis, Steered):
        return "radius", "track"
    return tuple(part for part in PARTS if part != "track" or robot.chassis.scrubs)


def with_sensed_motion(robot: Robot, log: CalibrationDrive | DriveLog, by_wheels: bool = False) -> CalibrationDrive:
    """The drive with the motion of the body by its speed from outside and its gyro, if it is not given.

    by_wheels: without a speed from outside the wheels give the speed, as the radius is assumed correct.

    Raises:
        InputError: no speed, or it does not determine the sideways motion.
    """
    if isinstance(log, CalibrationDrive):
        return log._replace(log=mended(robot, log.log))
    log = mended(robot, log)
    yaw_rate_rad_s = log.yaw_rate_rad_s
    scale_std = 0.0 if yaw_rate_rad_s is None else OdometryNoise().gyro_scale_std
    if log.speed_m_s is not None:
        return CalibrationDrive(log, motion_from_speed(robot, log.time_s, log.speed_m_s, yaw_rate_rad_s), scale_std)
    if not by_wheels or yaw_rate_rad_s is None:
        raise InputError(
            f"log {log.name!r} has no speed from outside{' and no gyro' if by_wheels else ''}; name its column "
            "(--column speed=NAME, --truth NAME, --pose X,Y,HEADING or TOPIC), or give CalibrationDrive(log, motion)"
        )
    wheels = np.column_stack([between(log.time_s, values) for values in log.wheel_speed_rad_s.T])
    motion = motion_from_wheels(robot, wheels[:, : robot.driven])
    motion[:, -1] = between(log.time_s, yaw_rate_rad_s)
    return CalibrationDrive(log, motion, scale_std)


def with_wheel_loads(robot: Robot, loads_N: Sequence[float]) -> Robot:
    """The robot with its wheels' loads as weighed, its mass their sum.

    Raises:
        InputError: the sum is far from the robot's weight.
    """
    weight_N = robot.mass_kg * GRAVITY
    found_N = sum(loads_N)
    if not weight_N / _OTHER_UNIT < found_N < _OTHER_UNIT * weight_N:
        raise InputError(
            f"the wheel loads (--wheel-load) add up to {found_N:.4g} N, the robot file's mass weighs {weight_N:.4g} N; "
            "give newtons, not kilograms or grams, or correct robot.mass_kg"
        )
    return replace(robot, mass_kg=found_N / GRAVITY, wheel_load_N=tuple(loads_N))
