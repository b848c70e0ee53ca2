"""Noise of the sensors of a drive, as its log shows it: quantisation, white noise, errors of an external speed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.traction.robot.robot import Robot

#: Least standard deviations that a log may claim for its sensors: rad/s of an encoder, m/s of an external speed.
LEAST_ENCODER_RAD_S = 0.01
LEAST_SPEED_M_S = 0.05

#: Standard deviation of a normal error over its median absolute deviation.
_MAD = 1.4826
#: Fewer samples than this tell no noise.
_FEWEST_FOR_NOISE = 10
#: Changes below this are rounding.
_SAME = 1e-9
#: Standard deviations beyond which an error of the speed is an outlier, which tells no correlation.
_OUTLIER = 4.0
#: Speed [m/s] from which on wheels tell their radius.
_MOVING_M_S = 0.1


def encoder_std_rad_s(wheel_speed_rad_s: np.ndarray) -> float:
    """The largest noise [rad/s] of these wheels (T, wheels): of quantisation or of other jumps; there is a floor.

    A speed from counts moves in steps q = 2 pi / (counts dt): variance q^2/12 for each of its two counts.
    """
    stds = [LEAST_ENCODER_RAD_S]
    for speed in wheel_speed_rad_s.T:
        stds += [quantum(speed) / math.sqrt(6), noise_std(speed, 0.0)]
    return max(stds)


def quantum(values: np.ndarray) -> float:
    """Step in which a channel (T,) moves: the smallest one that is usual among its changes; 0 without changes."""
    change = np.abs(np.diff(values[np.isfinite(values)]))
    change = change[change > _SAME]
    return float(np.quantile(change, 0.01)) if change.size else 0.0


def noise_std(values: np.ndarray | None, least: float) -> float:
    """Standard deviation of the white noise of a channel (T,): of each sample against the line through its neighbours.

    Robust against the true motion, as long as that is slow; not below `least`.
    """
    known = np.empty(0) if values is None else values[np.isfinite(values)]
    if known.size < _FEWEST_FOR_NOISE:
        return max(least, 0.0)
    off_line = known[1:-1] - 0.5 * (known[:-2] + known[2:])
    return max(least, _MAD * float(np.median(np.abs(off_line))) / math.sqrt(1.5))


def speed_std_m_s(robot: Robot, log: DriveLog) -> float:
    """Standard deviation of an external speed that does not carry its own: against the wheels, which mostly grip.

    Filters, lags and satellites make errors that last. With a correlation rho from each to the next, a mean of many is
    as good as one of uncorrelated errors with sqrt((1 + rho)/(1 - rho)) times the standard deviation.
    """
    if log.speed_std_m_s is not None and "speed_std_m_s" in log.channels:
        return float(np.nanmedian(log.speed_std_m_s))
    error = speed_minus_wheels_m_s(robot, log)
    if error.size < _FEWEST_FOR_NOISE:
        return LEAST_SPEED_M_S
    std = _MAD * float(np.median(np.abs(error - np.median(error))))
    rho = correlation(error, _OUTLIER * std)
    return max(LEAST_SPEED_M_S, std * math.sqrt((1 + rho) / (1 - rho)))


def speed_minus_wheels_m_s(robot: Robot, log: DriveLog) -> np.ndarray:
    """External speeds (N,) minus those of the driven wheels on the radius that fits best; may be empty.

    Both as they come: an age is known to some hundredths of a second only, and what the speed changes in it is noise.
    """
    speed, wheels = speed_and_wheels_m_s(robot, replace(log, speed_age_s=None))
    moving = np.abs(wheels) > _MOVING_M_S
    radius_ratio = float(np.median(speed[moving] / wheels[moving])) if moving.any() else 1.0
    return speed - radius_ratio * wheels


def speed_and_wheels_m_s(robot: Robot, log: DriveLog) -> tuple[np.ndarray, np.ndarray]:
    """External speeds and those by the driven wheels at the times that they tell of, each (N,); may be empty."""
    n = robot.driven
    rolled = log.wheel_speed_rad_s[:, :n] @ np.linalg.pinv(robot.rolling[:n])[0] * robot.wheel.radius_m
    speed = np.full(len(log), np.nan) if log.speed_m_s is None else log.speed_m_s
    seen, given = np.isfinite(rolled), np.isfinite(speed)
    if not seen.any():
        return np.empty(0), np.empty(0)
    age_s = 0.0 if log.speed_age_s is None else np.nan_to_num(log.speed_age_s[given])
    return speed[given], np.interp(log.time_s[given] - age_s, log.time_s[seen], rolled[seen])


def correlation(error: np.ndarray, limit: float) -> float:
    """Correlation of each error (N,) with the next, in [0, 0.9], among those below the limit."""
    near = np.abs(error[1:]) < limit
    a, b = error[1:][near], error[:-1][near]
    power = float(a @ a)
    return float(np.clip(a @ b / power, 0.0, 0.9)) if power > 0 else 0.0


def usual_step_s(log: DriveLog) -> float:
    """Median time [s] between samples; 0 with one sample."""
    return float(np.median(np.diff(log.time_s))) if len(log) > 1 else 0.0


def first_speed_m_s(robot: Robot, wheel_speed_rad_s: np.ndarray) -> float:
    """Size [m/s] of the first speed that the wheels (T, driven) show."""
    known = wheel_speed_rad_s[np.isfinite(wheel_speed_rad_s)]
    return abs(float(known[0])) * robot.wheel.radius_m if known.size else 0.0
