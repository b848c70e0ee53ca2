"""Effective radius of the wheels: travel of the body over their rotation.

Effective track: speed between the sides of a robot over its yaw rate, which scrubbing makes wider than the track.

    psi_dot = s r (omega_r - omega_l) / b,      b_eff = b / s

s is the share of the sides' difference that becomes a turn (steering efficiency over 1; A. Mandow et al., "Experimental
kinematics for wheeled skid-steer mobile robots", IROS 2007). It is fitted for the turn that the wheels predict, after
the radius, which straight stretches tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.calibration.regression import MOST_RADIUS_RATIO, Parameter, is_identified, regress
from ohmward.traction.calibration.stretches import SLOWEST_M_S, Stretches, cut
from ohmward.traction.calibration.truth import CalibrationDrive
from ohmward.traction.robot.chassis import Mecanum, Omni
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.make_observer import RADIUS_STD
from ohmward.traction.terrain.demand import static_loads, travel_speed
from ohmward.traction.terrain.floor import STIFFNESS

#: The share counts as identified from so many turning stretches on.
FEWEST_TURNS = 3
#: Standard deviation of the effective track of which nothing is known, relative to the track: skid-steered robots on
#: hard ground have 1.2 to 2 times their track; the driver of Clearpath's Husky takes 1.875.
TRACK_STD = 0.5


def calibrate_radius(drives: Sequence[CalibrationDrive], robot: Robot) -> Parameter:
    """The radius with which the wheels' turns give the true speed over ground.

    v = r |G^+ omega|, fitted over the steady stretches; from the wheels that are not driven where they have encoders,
    because these do not creep. With driven wheels the radius takes the creep of that floor with it, so calibrate on the
    floor that grips best; its sigma has room for the creep of an ordinary floor.

    Raises:
        InputError: no steady stretch.
    """
    rows = cut(drives, robot)
    passive = _passive_turns(robot, rows)
    turns = travel_speed(rows.rim) / robot.wheel.radius_m if passive is None else passive
    known = np.isfinite(turns)
    fit = regress(
        turns[known, None], travel_speed(rows.motion)[known], rows.drive[known], np.zeros(1), np.array([np.inf])
    )
    creep = _creep(robot, rows) if passive is None else 0.0
    name, own_m, radius_m = "wheel.radius_m", robot.wheel.radius_m, float(fit.beta[0])
    std_m = float(np.hypot(np.sqrt(fit.cov[0, 0]), creep * radius_m))
    if not 1 / MOST_RADIUS_RATIO < radius_m / own_m < MOST_RADIUS_RATIO:
        reason = (
            f"the drives give {radius_m:.3g} m for {own_m:.3g} m: the wheels slip all the time, or a unit or the "
            "radius of the robot file is wrong"
        )
        return Parameter(name, own_m, std_m, reason)
    if not is_identified(name, radius_m, std_m):
        reason = f"the drives give {radius_m:.3g} ± {std_m:.2g} m: the wheels slip much, or there are too few stretches"
        return Parameter(name, own_m, std_m, reason)
    return Parameter(name, radius_m, std_m)


def _passive_turns(robot: Robot, rows: Stretches) -> np.ndarray | None:
    """Travel over radius [rad/s] from the wheels that are not driven; None without their encoders."""
    free = robot.rolling[robot.driven :]
    if len(free) < robot.freedoms or not np.isfinite(rows.wheel_speed_rad_s[:, robot.driven :]).all(axis=1).any():
        return None
    return travel_speed(rows.wheel_speed_rad_s[:, robot.driven :] @ np.linalg.pinv(free).T)


def _creep(robot: Robot, rows: Stretches) -> float:
    """Creep ratio of driven wheels under these forces on a floor of ordinary stiffness."""
    torque = wheel_torque(robot.motor, rows.current_A, rows.wheel_speed_rad_s[:, : robot.driven])
    share = np.abs(torque) / robot.wheel.radius_m / static_loads(robot)[: robot.driven]
    return float(np.nanmean(share)) / STIFFNESS if np.isfinite(share).any() else 0.02


def calibrate_track(
    drives: Sequence[CalibrationDrive], robot: Robot, radius_share_std: float = RADIUS_STD
) -> Parameter:
    """The track with which the difference of the sides' speeds gives the true yaw rate.

    Args:
        drives: with the motion of the body, turns among them.
        robot: with its radius calibrated.
        radius_share_std: relative error of that radius, which the track shares.

    Raises:
        InputError: a robot whose wheels have rollers, or no steady stretch.
    """
    if isinstance(robot.chassis, Omni | Mecanum):
        raise InputError(f"{robot.name} has no left and right side; leave the track out of --what")
    name, track_m = "chassis.effective_track_m" if robot.chassis.scrubs else "chassis.track_m", robot.chassis.track_m
    unknown = Parameter(name, track_m, TRACK_STD * track_m, "the robot hardly turns, or not as its wheels do")
    rows = cut(drives, robot, turning=True)
    turns = track_m * np.abs(rows.rim[:, -1]) >= SLOWEST_M_S
    if turns.sum() < FEWEST_TURNS:
        return unknown
    by_wheels, yaw_rate = rows.rim[turns, -1:], rows.motion[turns, -1]
    fit = regress(by_wheels, yaw_rate, rows.drive[turns], np.zeros(1), np.array([np.inf]))
    share, std = float(fit.beta[0]), float(np.sqrt(fit.cov[0, 0]))
    if not is_identified(name, share, std):
        return unknown
    return Parameter(name, track_m / share, track_m / share * math.hypot(std / share, radius_share_std))
