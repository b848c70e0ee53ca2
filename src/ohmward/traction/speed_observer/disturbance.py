"""Disturbance acceleration of a drive: what neither the robot file nor a level ground explains.

    d = | G' (tau - J_w d omega/dt) / r | / m - | dv/dt |      as vectors, of the body

tau is the motors' torque, and v the motion that the wheels show while they grip. A slope is in d, rolling resistance,
and every friction that the robot file lacks. Its median is robust against slip, which is rare.
"""

from __future__ import annotations

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import Robot

#: Window [s] over which speeds change by more than the noise of encoders.
WINDOW_S = 0.3

#: Speed [rad/s] from which on a wheel turns.
TURNS_RAD_S = 0.2

#: Fewer samples than this tell no disturbance.
_FEWEST = 20


def disturbance_m_s2(robot: Robot, log: DriveLog) -> float:
    """Median of d [m/s^2] over the samples in which the robot moves; 0 where the log cannot tell."""
    n = robot.driven
    speed, current = log.wheel_speed_rad_s[:, :n], log.motor_current_A
    rows = np.isfinite(speed).all(axis=1) & np.isfinite(current).all(axis=1)
    time_s, speed, torque = log.time_s[rows], speed[rows], wheel_torque(robot.motor, current[rows], speed[rows])
    half = max(1, round(0.5 * WINDOW_S / float(np.median(np.diff(time_s))))) if time_s.size > 1 else 1
    moving = np.abs(speed[half:-half]).max(axis=1, initial=0.0) > TURNS_RAD_S
    if time_s.size < _FEWEST + 2 * half or moving.sum() < _FEWEST:
        return 0.0
    wheel_rate = window_slope(speed, time_s, half)
    force_N = (window_mean(torque, half) - robot.inertia[robot.freedoms :] * wheel_rate) / robot.wheel.radius_m
    linear = slice(0, robot.freedoms - 1)
    forced = (force_N @ robot.rolling[:n])[:, linear] / robot.mass_kg
    measured = (wheel_rate @ np.linalg.pinv(robot.rolling[:n]).T * robot.wheel.radius_m)[:, linear]
    return float(np.median(np.linalg.norm(forced - measured, axis=1)[moving]))


def window_slope(values: np.ndarray, time_s: np.ndarray, half: int) -> np.ndarray:
    """Change (T - 2 half, N) of each column over the window, by its length."""
    return (values[2 * half :] - values[: -2 * half]) / (time_s[2 * half :] - time_s[: -2 * half])[:, None]


def window_mean(values: np.ndarray, half: int) -> np.ndarray:
    """Mean (T - 2 half, N) of each column over the window."""
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
