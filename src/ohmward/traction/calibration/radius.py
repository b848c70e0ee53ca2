"""Effective radius of the wheels: travel of the body over their rotation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.traction.calibration.parameter import MOST_RADIUS_RATIO, Parameter, is_told
from ohmward.traction.calibration.regression import regress
from ohmward.traction.calibration.stretches import Stretches, cut
from ohmward.traction.calibration.truth import CalibrationDrive
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.demand import static_loads, travel_speed
from ohmward.traction.terrain.floor import STIFFNESS


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
    if not is_told(name, radius_m, std_m):
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
