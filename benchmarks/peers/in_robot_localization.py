"""The extended Kalman filter of robot_localization in `two_d_mode`, written from its documentation and source.

Its node needs ROS; this is its arithmetic, in NumPy: a model of constant acceleration with eight states, the process
noise of its documentation times the step, one correction for each message, no rejection of outliers. Each wheel report
gives the forward speed, no sideways speed and the yaw rate, each gyro sample the yaw rate, as `odom0_config` and
`imu0_config` usually say.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

X, Y, YAW, VX, VY, TURN, AX, AY = range(8)
#: Variances per second of `process_noise_covariance` in the documentation, for these states.
PROCESS_NOISE = np.diag([0.05, 0.05, 0.06, 0.025, 0.025, 0.02, 0.01, 0.01])
#: `twist_covariance_diagonal` of `diff_drive_controller` in the examples of ros2_controllers, of vx, vy and the turn.
WHEEL_VARIANCES = (0.001, 0.001, 0.01)
#: `initial_estimate_covariance`.
FIRST_VARIANCE = 1e-9


class Track(NamedTuple):
    """Pose at the end (3,) and its covariance (3, 3)."""

    pose: np.ndarray
    cov: np.ndarray


def run(
    dt_s: np.ndarray, speed_m_s: np.ndarray, turn_rad_s: np.ndarray, gyro_rad_s: np.ndarray, gyro_std: float
) -> Track:
    """The pose after samples (T,) of wheels and gyro; nan where one has none."""
    x, P = np.zeros(8), FIRST_VARIANCE * np.eye(8)
    wheels, gyro = np.eye(8)[[VX, VY, TURN]], np.eye(8)[[TURN]]
    R_wheels, R_gyro = np.diag(WHEEL_VARIANCES), np.array([[gyro_std**2]])
    for dt, speed, turn, rate in zip(
        dt_s.tolist(), speed_m_s.tolist(), turn_rad_s.tolist(), gyro_rad_s.tolist(), strict=True
    ):
        x, P = predict(x, P, dt)
        if math.isfinite(speed):
            x, P = correct(x, P, np.array([speed, 0.0, turn]), wheels, R_wheels)
        if math.isfinite(rate):
            x, P = correct(x, P, np.array([rate]), gyro, R_gyro)
    return Track(x[:3], P[:3, :3])


def predict(x: np.ndarray, P: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance a step later."""
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    along, across = x[VX] * dt + x[AX] * dt * dt / 2, x[VY] * dt + x[AY] * dt * dt / 2
    F = np.eye(8)
    F[X, [YAW, VX, VY, AX, AY]] = -s * along - c * across, c * dt, -s * dt, c * dt * dt / 2, -s * dt * dt / 2
    F[Y, [YAW, VX, VY, AX, AY]] = c * along - s * across, s * dt, c * dt, s * dt * dt / 2, c * dt * dt / 2
    F[YAW, TURN] = F[VX, AX] = F[VY, AY] = dt
    moved = np.array([c * along - s * across, s * along + c * across, x[TURN] * dt, x[AX] * dt, x[AY] * dt, 0, 0, 0])
    return x + moved, F @ P @ F.T + PROCESS_NOISE * dt


def correct(x: np.ndarray, P: np.ndarray, y: np.ndarray, H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance after a measurement, in Joseph's form."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(8) - K @ H
    return x + K @ (y - H @ x), left @ P @ left.T + K @ R @ K.T
