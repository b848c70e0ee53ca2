"""True motion of the body, and stretches of nearly steady motion, cut from drives: the rows of every calibration.

The motion comes from poses measured by a camera or a total station, or from measured speeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.runs import between
from ohmward.traction.motion.outside_speed import STUCK_SHARE
from ohmward.traction.robot.robot import Robot, motion_from_wheels
from ohmward.traction.score import DriveTruth
from ohmward.traction.terrain.floor import travel_speed

#: Half the width [s] of the local fit that turns a pose into a motion.
HALF_WINDOW_S = 0.3
#: Largest speed across the way as a share of that along it, and largest angle between heading and way, of wheels that
#: only roll ahead; speeds and yaw rates more alike than this leave the point that the pose is of unknown.
MOST_ACROSS, MOST_TURNED_DEG, _SPEED_AND_TURN_ALIKE = 0.3, 10.0, 0.9


class CalibrationDrive(NamedTuple):
    """A recording and the true motion of the body in it."""

    log: DriveLog  #: in the robot's wheel order
    motion: np.ndarray  #: (T, freedoms), nan where it is not known
    yaw_scale_std: float = 0.0  #: relative error of its yaw rate that lasts, as by the scale of a gyro


def motion_from_pose(time_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray, heading_rad: np.ndarray) -> np.ndarray:
    """Forward speed, leftward speed and yaw rate (T, 3) of a body from its pose, (T,) each.

    x and y are fixed to the ground, the heading is counted from x towards y and may jump by 2 pi. Each speed is the
    slope of a straight line through the poses of the 0.6 s around it.

    Raises:
        InputError: fewer than 3 poses.
    """
    known = np.isfinite(x_m) & np.isfinite(y_m) & np.isfinite(heading_rad)
    if known.sum() < 3:
        raise InputError(f"a pose needs at least 3 samples with numbers, got {known.sum()}; check its columns")
    heading = np.interp(time_s, time_s[known], np.unwrap(heading_rad[known]))
    c, s = np.cos(heading), np.sin(heading)
    v_x, v_y, yaw_rate = (local_slope(time_s, values) for values in (x_m, y_m, np.where(known, heading, np.nan)))
    return np.column_stack([c * v_x + s * v_y, c * v_y - s * v_x, yaw_rate])


def motion_from_speed(
    robot: Robot, time_s: np.ndarray, speed_m_s: np.ndarray, yaw_rate_rad_s: np.ndarray | None = None
) -> np.ndarray:
    """Motion (T, freedoms) of a robot from its forward speed; straight ahead without a yaw rate.

    Speeds less frequent than the log's samples are interpolated linearly, with nan before the first and after the last.
    A skid-steered robot is assumed to turn about a point abreast of its centre of gravity.

    Raises:
        InputError: the robot moves sideways at will.
    """
    if robot.chassis.rollers:
        raise InputError(
            f"{robot.name} moves sideways too: one speed does not say how; give its pose (--pose X,Y,HEADING, "
            "motion_from_pose)"
        )
    yaw_rate = np.zeros_like(speed_m_s) if yaw_rate_rad_s is None else between(time_s, yaw_rate_rad_s)
    speed = between(time_s, speed_m_s)
    return without_lateral(robot, np.column_stack([speed, np.zeros_like(speed), yaw_rate]))


def motion_from_truth(robot: Robot, time_s: np.ndarray, truth: DriveTruth) -> np.ndarray:
    """Motion (T, freedoms) from all measured speeds, interpolated linearly.

    Raises:
        InputError: the robot moves sideways, and its lateral speed was not measured.
    """
    lateral, yaw_rate = truth.lateral_speed_m_s, truth.yaw_rate_rad_s
    if robot.freedoms == 3 and lateral is not None and yaw_rate is not None:
        return np.column_stack([between(time_s, values) for values in (truth.speed_m_s, lateral, yaw_rate)])
    return motion_from_speed(robot, time_s, truth.speed_m_s, yaw_rate)


def without_lateral(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """Motion (T, freedoms) of a robot from a planar motion (T, 3), without the lateral speed if it has none.

    Raises:
        InputError: it moves sideways more than its wheels allow.
    """
    known = np.isfinite(motion).all(axis=1)
    if known.any() and not robot.chassis.rollers:
        _check_heading(motion[known])
    return motion if robot.freedoms == 3 else motion[:, [0, 2]]


def _check_heading(motion: np.ndarray) -> None:
    """InputError for a motion (T, 3) that is not along its heading but for that of a point off the axle, u = x psi_dot.

    Its principal axis is at the angle atan2(2 sum(u v), sum(v^2 - u^2)) / 2 from the heading.
    """
    speed_m_s = travel_speed(motion[:, :2])
    motion = motion[speed_m_s <= 1.5 * np.quantile(speed_m_s, 0.9, method="higher")]  # without jumps of the pose
    v, u, yaw_rate = motion.T
    if not np.sum(v**2 + u**2) > len(motion) * SLOWEST_M_S**2:
        return
    if abs(v @ yaw_rate) < _SPEED_AND_TURN_ALIKE * np.linalg.norm(v) * np.linalg.norm(yaw_rate):
        u = u - np.linalg.lstsq(motion[:, [0, 2]], u, rcond=None)[0][1] * yaw_rate
    angle_rad = 0.5 * math.atan2(2.0 * float(u @ v), float(v @ v - u @ u))
    across = float(np.linalg.norm(u * math.cos(angle_rad) - v * math.sin(angle_rad)) / np.linalg.norm([u, v]))
    what = f"{100 * across:.0f} % of its speed across its way"
    fix = (
        "x, y or the heading counts the other way (--pose-scale 1,-1), the heading is in another unit (--pose-unit) or "
        "jumps, or the pose is too noisy"
    )
    if across <= MOST_ACROSS:
        angle_deg = math.degrees(angle_rad)
        if abs(angle_deg) <= MOST_TURNED_DEG:
            return
        what, fix = f"{angle_deg:.0f} deg to the left of its heading", "turn the heading by as much (--pose-turn)"
    raise InputError(f"by the pose the robot moves {what}, which its wheels do not allow: {fix}")


def local_slope(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Slope (T,) of the straight line through the values within `HALF_WINDOW_S` of each time; nan with fewer than 3."""
    known = np.isfinite(values)
    t, y = time_s[known], values[known]
    first, last = (np.searchsorted(t, time_s + side) for side in (-HALF_WINDOW_S, HALF_WINDOW_S))

    def window_sum(terms: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(terms)])
        return total[last] - total[first]

    t, y = t - t.mean(), y - y.mean()
    count, t_sum, y_sum = window_sum(np.ones_like(t)), window_sum(t), window_sum(y)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (window_sum(t * y) - t_sum * y_sum / count) / (window_sum(t * t) - t_sum**2 / count)
    return np.where(count >= 3, slope, np.nan)


LENGTH_S = 1.0
#: Largest difference of the sides' speeds by the robot's turning, as a share of its speed, where it drives straight.
STRAIGHT_SHARE = 0.1
#: Least speed of the rims [m/s] in a stretch, and largest change of it as a share; largest one at rest.
SLOWEST_M_S, STEADY_SHARE, PARKED_M_S = 0.02, 0.3, 0.002


class Stretches(NamedTuple):
    """K stretches, means over each with the weights of `parabola`."""

    drive: np.ndarray  #: (K,) number of the recording
    wheel_speed_rad_s: np.ndarray  #: (K, wheels), nan for a wheel without encoder
    current_A: np.ndarray  #: (K, driven), nan where no current was measured
    rim: np.ndarray  #: (K, freedoms) motion that the driven wheels make, for the robot's radius
    motion: np.ndarray  #: (K, freedoms) of the body
    acceleration: np.ndarray  #: (K, freedoms) of the body
    time_s: np.ndarray  #: (K,) of their starts


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

    Sensors may have rates of their own: samples of a slower one are interpolated linearly.

    steady: leave out those in which the wheels change their speed much, among them starts and stops.
    turning: keep rests, and the turns of a robot whose wheels scrub, which no other fit than that of the track can use.
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
    if turning or not robot.chassis.scrubs:
        return found
    by_turning_m_s = np.ptp(robot.rolling[:, -1]) * np.abs(found.motion[:, -1])
    straight = by_turning_m_s <= STRAIGHT_SHARE * travel_speed(found.motion)  # hardly a wheel is dragged sideways
    if not straight.any():
        raise InputError(
            f"{robot.name} drags its wheels sideways in turns, and no stretch of the drives is straight; add a drive "
            "straight ahead, or calibrate the track alone (--what track, parts=('track',))"
        )
    return Stretches(*(values[straight] for values in found))


def stuck(s: Stretches) -> np.ndarray:
    """Conditions (K,) that the wheels turn and the body hardly moves; those that turn on the spot are not judged.

    The speed of the body over that of the rims is below `STUCK_SHARE` of what the faster half of the stretches has in
    its upper quartile: such a stretch says nothing about a radius, a motor or the law of a floor.
    """
    rim_m_s, body_m_s = travel_speed(s.rim), travel_speed(s.motion)
    rolls = rim_m_s >= SLOWEST_M_S
    if not rolls.any():
        return rolls
    ratio = body_m_s / np.maximum(rim_m_s, SLOWEST_M_S)
    usual = np.quantile(ratio[rim_m_s >= np.median(rim_m_s[rolls])], 0.75)
    return rolls & (ratio < STUCK_SHARE * usual)


def _of_drive(
    number: int, drive: CalibrationDrive, robot: Robot, steady: bool, turning: bool, length_s: float
) -> Iterator[tuple]:
    log, t = drive.log, drive.log.time_s
    wheels, current = (
        np.column_stack([between(t, column, length_s) for column in values.T])
        for values in (log.wheel_speed_rad_s, log.motor_current_A)
    )
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
        rests = turning and np.nanmax(np.abs(pace[part])) <= PARKED_M_S
        turns = speed >= SLOWEST_M_S and (not steady or _change(pace[part]) <= STEADY_SHARE * speed)
        if turns or rests:
            yield (
                number,
                _mean(wheels[part], weight),
                _mean(current[part], weight),
                mean,
                _mean(drive.motion[part], weight),
                _slope(t[part], drive.motion[part]),
                t[first],
            )


def _change(pace: np.ndarray) -> float:
    """Largest difference [m/s] between the means of both halves of the known rows (rows, n)."""
    known = pace[np.isfinite(pace).all(axis=1)]
    half = len(known) // 2
    return float(np.abs(known[half:].mean(axis=0) - known[:half].mean(axis=0)).max())


def parabola(time_s: np.ndarray) -> np.ndarray:
    """Weights (rows,) with which the mean of a rate is the slope of the line through its integral.

    The slope of a least-squares line through v is the mean of dv/dt with weights 1 - x^2 over x in [-1, 1]: forces and
    accelerations averaged so belong together even if they step within a stretch.
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
