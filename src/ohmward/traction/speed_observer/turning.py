"""Effective track of a skid-steered robot, where its file has none and its log has wheels and a gyro.

    b_eff = sum (v_right - v_left) psi_dot / sum psi_dot^2

The sides of a robot that scrubs differ by more than its yaw rate times its track; with the track alone, left wheels,
right wheels and gyro contradict each other in every turn, and the observer calls the difference slip.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.traction.robot.chassis import SkidSteer
from ohmward.traction.robot.robot import Robot

#: The track is found where the yaw rate is at least so large [rad/s, root of its mean square], and the sides differ by
#: it with this correlation: the wheels of a robot that slides sideways say little of its turns.
TURNING_RAD_S, ALIKE = 0.1, 0.9


def with_effective_track(robot: Robot, log: DriveLog) -> Robot:
    """The robot with the effective track that wheels and gyro of the log show; unchanged where none or one is known."""
    chassis = robot.chassis
    if not isinstance(chassis, SkidSteer) or chassis.effective_track_m is not None or log.yaw_rate_rad_s is None:
        return robot
    by_wheels = yaw_rate_of_wheels(robot, log.wheel_speed_rad_s)
    known = np.isfinite(by_wheels) & np.isfinite(log.yaw_rate_rad_s)
    sides_m_s, gyro = chassis.track_m * by_wheels[known], log.yaw_rate_rad_s[known]
    power = float(gyro @ gyro)
    if power <= TURNING_RAD_S**2 * max(known.sum(), 1):
        return robot
    together = float(sides_m_s @ gyro)
    if together < ALIKE * np.sqrt(power * float(sides_m_s @ sides_m_s)):
        return robot
    return replace(robot, chassis=replace(chassis, effective_track_m=together / power))


def yaw_rate_of_wheels(robot: Robot, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Yaw rate (T,) [rad/s] by the driven wheels of a log (T, wheels) and the track, as if no wheel scrubbed."""
    n = robot.driven
    return robot.wheel.radius_m * wheel_speed_rad_s[:, :n] @ np.linalg.pinv(robot.rolling[:n])[-1]
