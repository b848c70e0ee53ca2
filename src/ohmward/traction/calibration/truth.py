"""True motion of the body: from its pose as a camera or a total station saw it, or from measured speeds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.robot.robot import Robot
from ohmward.traction.score import DriveTruth

#: Half the width [s] of the local fit that turns a pose into a motion.
HALF_WINDOW_S = 0.3


class CalibrationDrive(NamedTuple):
    """A recording and the true motion of the body in it."""

    log: DriveLog  #: in the robot's wheel order
    motion: np.ndarray  #: (T, freedoms), nan where it is not known


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

    Between speeds that come less often than the log's samples it is a straight line, nan before the first and after the
    last. A skid-steered robot is taken to turn about a point abreast of its centre of gravity.

    Raises:
        InputError: the robot moves sideways at will.
    """
    if robot.chassis.rollers:
        raise InputError(
            f"{robot.name} moves sideways too: one speed does not say how; give its pose (--pose X,Y,HEADING)"
        )
    yaw_rate = np.zeros_like(speed_m_s) if yaw_rate_rad_s is None else between(time_s, yaw_rate_rad_s)
    speed = between(time_s, speed_m_s)
    return without_lateral(robot, np.column_stack([speed, np.zeros_like(speed), yaw_rate]))


def motion_from_truth(robot: Robot, time_s: np.ndarray, truth: DriveTruth) -> np.ndarray:
    """Motion (T, freedoms) from every speed that was measured, straight lines between them.

    Raises:
        InputError: the robot moves sideways, and how fast was not measured.
    """
    lateral, yaw_rate = truth.lateral_speed_m_s, truth.yaw_rate_rad_s
    if robot.freedoms == 3 and lateral is not None and yaw_rate is not None:
        return np.column_stack([between(time_s, values) for values in (truth.speed_m_s, lateral, yaw_rate)])
    return motion_from_speed(robot, time_s, truth.speed_m_s, yaw_rate)


def without_lateral(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """Motion (T, freedoms) of a robot from that of a free body (T, 3), whose lateral speed it may lack."""
    return motion if robot.freedoms == 3 else motion[:, [0, 2]]


def between(time_s: np.ndarray, values: np.ndarray, longest_s: float = np.inf) -> np.ndarray:
    """Values (T,) with straight lines across gaps up to `longest_s`, nan before the first and after the last."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    t = time_s[known]
    line = np.interp(time_s, t, values[known], left=np.nan, right=np.nan)
    after = np.minimum(np.searchsorted(t, time_s), t.size - 1)
    gap_s = t[after] - t[np.maximum(after - 1, 0)]
    return np.where(known | (gap_s <= longest_s), line, np.nan)


def local_slope(time_s: np.ndarray, values: np.ndarray, half_window_s: float = HALF_WINDOW_S) -> np.ndarray:
    """Slope (T,) of the straight line through the values within `half_window_s` of each time; nan with fewer than 3."""
    known = np.isfinite(values)
    t, y = time_s[known], values[known]
    first, last = (np.searchsorted(t, time_s + side) for side in (-half_window_s, half_window_s))

    def window_sum(terms: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(terms)])
        return total[last] - total[first]

    t, y = t - t.mean(), y - y.mean()
    count, t_sum, y_sum = window_sum(np.ones_like(t)), window_sum(t), window_sum(y)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (window_sum(t * y) - t_sum * y_sum / count) / (window_sum(t * t) - t_sum**2 / count)
    return np.where(count >= 3, slope, np.nan)
