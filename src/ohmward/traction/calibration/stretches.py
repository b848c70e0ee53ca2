"""Stretches of nearly steady motion, cut from drives: the rows of every fit of a calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.calibration.truth import CalibrationDrive, between
from ohmward.traction.motion.outside_speed import STUCK_SHARE
from ohmward.traction.robot.robot import Robot, motion_from_wheels
from ohmward.traction.terrain.demand import travel_speed

LENGTH_S = 1.0
#: Largest difference of the sides' speeds by the robot's turning, as a share of its speed, where it drives straight.
STRAIGHT_SHARE = 0.1
#: Least speed of the rims [m/s] in a stretch, and largest change of it as a share.
SLOWEST_M_S, STEADY_SHARE = 0.02, 0.3


class Stretches(NamedTuple):
    """K stretches, means over each with the weights of `parabola`."""

    drive: np.ndarray  #: (K,) number of the recording
    wheel_speed_rad_s: np.ndarray  #: (K, wheels), nan for a wheel without encoder
    current_A: np.ndarray  #: (K, driven), nan where no current was measured
    rim: np.ndarray  #: (K, freedoms) motion that the driven wheels make, for the robot's radius
    motion: np.ndarray  #: (K, freedoms) of the body
    acceleration: np.ndarray  #: (K, freedoms) of the body


def cut(
    drives: Sequence[CalibrationDrive],
    robot: Robot,
    *,
    steady: bool = True,
    turning: bool = False,
    length_s: float = LENGTH_S,
    keep_stuck: bool = False,
) -> Stretches:
    """All stretches of the drives in which the body's motion is known.

    Sensors may have rates of their own: between the samples of a slower one stand straight lines.

    steady: leave out those in which the wheels change their speed much, among them starts and stops.
    turning: keep the turns of a robot whose wheels scrub, which no other fit than that of the track can use.
    keep_stuck: keep those in which the wheels turned and the robot stood, see `stuck`.

    Raises:
        InputError: none is left.
    """
    each = (_of_drive(number, drive, robot, steady, turning, length_s) for number, drive in enumerate(drives))
    rows = [row for stretches in each for row in stretches]
    if not rows:
        raise InputError(
            f"no stretch of {length_s:g} s in which the wheels turn{' steadily' if steady else ''} and the "
            "motion of the body is known; give longer drives, or check the columns of the truth"
        )
    found = Stretches(*(np.array(column) for column in zip(*rows, strict=True)))
    if not keep_stuck:
        found = Stretches(*(values[~stuck(found)] for values in found))
    return found if turning or not robot.chassis.scrubs else _straight(found, robot)


def stuck(s: Stretches) -> np.ndarray:
    """Conditions (K,) that the wheels turn and the body hardly moves; those that turn on the spot are not judged.

    The speed of the body over that of the rims is below `STUCK_SHARE` of what the faster half of the stretches has in
    its upper quartile: such a stretch tells of no radius, motor or law of a floor.
    """
    rim_m_s, body_m_s = travel_speed(s.rim), travel_speed(s.motion)
    rolls = rim_m_s >= SLOWEST_M_S
    if not rolls.any():
        return rolls
    ratio = body_m_s / np.maximum(rim_m_s, SLOWEST_M_S)
    usual = np.quantile(ratio[rim_m_s >= np.median(rim_m_s[rolls])], 0.75)
    return rolls & (ratio < STUCK_SHARE * usual)


def _straight(found: Stretches, robot: Robot) -> Stretches:
    """Those in which hardly any wheel is dragged sideways; InputError where there are none."""
    by_turning_m_s = np.ptp(robot.rolling[:, -1]) * np.abs(found.motion[:, -1])
    straight = by_turning_m_s <= STRAIGHT_SHARE * travel_speed(found.motion)
    if not straight.any():
        raise InputError(
            f"{robot.name} drags its wheels sideways in turns, and no stretch of the drives is straight; add a drive "
            "straight ahead, or calibrate the track alone (--what track)"
        )
    return Stretches(*(values[straight] for values in found))


def _of_drive(
    number: int, drive: CalibrationDrive, robot: Robot, steady: bool, turning: bool, length_s: float
) -> Iterator[tuple]:
    log, t = drive.log, drive.log.time_s
    wheels, current = (_bridged(t, values, length_s) for values in (log.wheel_speed_rad_s, log.motor_current_A))
    rim = motion_from_wheels(robot, wheels[:, : robot.driven])
    pace = rim @ robot.rolling[: robot.driven].T if turning else rim[:, :-1]  # of the wheels, or of the body alone
    edges = np.searchsorted(t, np.arange(t[0], t[-1] - length_s / 2, length_s)).tolist()
    for first, last in zip(edges, [*edges[1:], t.size], strict=True):
        part = slice(first, last)
        if min(np.isfinite(values[part]).all(axis=1).sum() for values in (drive.motion, rim)) < 3:
            continue
        weight = parabola(t[part])
        mean = _mean(rim[part], weight)
        speed = np.abs(_mean(pace[part], weight)).max() if turning else travel_speed(mean)
        if speed >= SLOWEST_M_S and (not steady or _change(pace[part]) <= STEADY_SHARE * speed):
            yield (
                number,
                _mean(wheels[part], weight),
                _mean(current[part], weight),
                mean,
                _mean(drive.motion[part], weight),
                _slope(t[part], drive.motion[part]),
            )


def _bridged(time_s: np.ndarray, values: np.ndarray, length_s: float) -> np.ndarray:
    """The values (T, n) with straight lines across gaps shorter than a stretch."""
    return np.column_stack([between(time_s, column, length_s) for column in values.T])


def _change(pace: np.ndarray) -> float:
    """Largest difference [m/s] between the means of both halves of the known rows (rows, n)."""
    known = pace[np.isfinite(pace).all(axis=1)]
    half = len(known) // 2
    return float(np.abs(known[half:].mean(axis=0) - known[:half].mean(axis=0)).max())


def parabola(time_s: np.ndarray) -> np.ndarray:
    """Weights (rows,) with which the mean of a rate is the slope of the line through its integral.

    The slope of a least-squares line through v is the mean of dv/dt with weights 1 - x^2 over x in [-1, 1]: forces and
    accelerations taken so belong together even where they step within a stretch.
    """
    x = 2 * (time_s - time_s[0]) / (time_s[-1] - time_s[0]) - 1
    return 1 - (x * (1 - 1 / time_s.size)) ** 2


def _slope(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Slope (n,) of straight lines through the known values (rows, n) of a stretch."""
    known = np.isfinite(values).all(axis=1)
    t = time_s[known] - time_s[known].mean()
    return t @ values[known] / max(float(t @ t), 1e-12)


def _mean(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted mean over the known rows (rows, n), nan for a column without any."""
    known = np.isfinite(values) * weight[:, None]
    total = known.sum(axis=0)
    return np.where(total > 0, np.nan_to_num(values * known).sum(axis=0) / np.maximum(total, 1e-12), np.nan)
