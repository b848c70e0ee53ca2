"""Effective radius of the wheels: travel of the body over their rotation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.traction.calibration.parameter import Parameter
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
    radius_m = float(fit.beta[0])
    return Parameter("wheel.radius_m", radius_m, float(np.hypot(np.sqrt(fit.cov[0, 0]), creep * radius_m)))


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
