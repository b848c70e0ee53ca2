"""Effective track: speed between the sides of a robot over its yaw rate, which scrubbing makes wider than the track.

    psi_dot = s r (omega_r - omega_l) / b,      b_eff = b / s

s is the share of the sides' difference that becomes a turn (steering efficiency over 1; A. Mandow et al., "Experimental
kinematics for wheeled skid-steer mobile robots", IROS 2007). It is fitted for the turn that the wheels predict, after
the radius, which straight stretches tell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.calibration.parameter import Parameter, is_told
from ohmward.traction.calibration.regression import regress
from ohmward.traction.calibration.stretches import SLOWEST_M_S, cut
from ohmward.traction.calibration.truth import CalibrationDrive
from ohmward.traction.robot.chassis import Omni
from ohmward.traction.robot.robot import Robot

#: The share counts as identified from so many turning stretches on.
FEWEST = 3
#: Standard deviation of the effective track of which nothing is known, relative to the track: skid-steered robots on
#: hard ground have 1.2 to 2 times their track; the driver of Clearpath's Husky takes 1.875.
TRACK_STD = 0.5


def calibrate_track(drives: Sequence[CalibrationDrive], robot: Robot) -> Parameter:
    """The track with which the difference of the sides' speeds gives the true yaw rate.

    Args:
        drives: with the motion of the body, turns among them.
        robot: with its radius calibrated.

    Raises:
        InputError: an omni robot, or no steady stretch.
    """
    if isinstance(robot.chassis, Omni):
        raise InputError(f"{robot.name} has no left and right side; leave the track out of --what")
    name, track_m = "chassis.effective_track_m" if robot.chassis.scrubs else "chassis.track_m", robot.chassis.track_m
    unknown = Parameter(name, track_m, TRACK_STD * track_m, "the robot hardly turns, or not as its wheels do")
    rows = cut(drives, robot, turning=True)
    turns = track_m * np.abs(rows.rim[:, -1]) >= SLOWEST_M_S
    if turns.sum() < FEWEST:
        return unknown
    by_wheels, yaw_rate = rows.rim[turns, -1:], rows.motion[turns, -1]
    fit = regress(by_wheels, yaw_rate, rows.drive[turns], np.zeros(1), np.array([np.inf]))
    share, std = float(fit.beta[0]), float(np.sqrt(fit.cov[0, 0]))
    if not is_told(name, share, std):
        return unknown
    return Parameter(name, track_m / share, track_m * std / share**2)
