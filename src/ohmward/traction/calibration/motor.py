"""Friction, damping and torque constant of the motors, from drives on level ground.

    n K_m I (1 - (1 - eta) d) = kappa [ J domega/dt + r (F_inertia + F_drag) ] + tau_c tanh(omega / omega_0) + b omega

for every stretch and driven wheel, linear in kappa, the shares of the drag, tau_c and b (`motor`, `terrain.demand`).
kappa is the robot file's torque constant over the true one: only accelerations show it, through the mass. d is the
direction of the current and the rotation. An omni robot driven in several directions tells the friction of its motors
from the drag of its rollers; with wheels that only roll forward the two look the same, and the prior of the rolling
resistance decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.calibration.regression import Parameter, Regression, is_identified, regress
from ohmward.traction.calibration.stretches import Stretches, cut
from ohmward.traction.calibration.truth import CalibrationDrive
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.demand import drag_columns, inertial_forces, travel_speed

#: Prior of the rolling resistance of the floor, share of the load: mean and standard deviation.
ROLLING = (0.02, 0.02)
_KAPPA_STD, _ROLLER_STD, _TORQUE_SHARE = 0.5, 0.2, 1.0
CONSTANT = "motor.torque_constant_Nm_per_A"
_UNSTEADY_S = 0.5
#: Columns of the fit.
KAPPA, ROLLING_SHARE, ROLLER_SHARE, FRICTION, DAMPING = range(5)
#: Damping needs drives of which the fast ones are at least so much faster than the slow ones.
_SPEED_RATIO = 2.0
#: Sigma of a parameter that the fit does not change.
_HELD = 1e-9


class RegressionRow(NamedTuple):
    """Stretches and driven wheels as rows (K,): torque of the currents, columns (K, 5) of the fit, and the drive."""

    torque_Nm: np.ndarray
    columns: np.ndarray
    drive: np.ndarray


def calibrate_motor(
    drives: Sequence[CalibrationDrive], robot: Robot, rolling: tuple[float, float] = ROLLING
) -> tuple[Parameter, ...]:
    """Torque constant, friction and damping of the motors; the robot's own value where the drives do not tell one.

    Args:
        drives: with the motion of the body.
        robot: with true mass, geometry and radius.
        rolling: rolling resistance of the floor, share of the load, and its standard deviation, 0 where
            it is known.

    Raises:
        InputError: no stretch in which the wheels turn, or no motor currents.
    """
    stretches = cut(drives, robot, steady=False, length_s=_UNSTEADY_S)
    row = rows(stretches, robot)
    prior, prior_std = _prior(row, robot, rolling)
    slow, fast = np.quantile(travel_speed(stretches.rim), [0.1, 0.9])
    if not fast >= _SPEED_RATIO * slow:
        prior_std[DAMPING] = _HELD
    fit = _fit(row, prior, prior_std)
    kappa = fit.beta[KAPPA]
    identified = is_identified(CONSTANT, float(kappa), float(np.sqrt(fit.cov[KAPPA, KAPPA])))
    if not identified:
        prior_std[KAPPA] = _HELD
        fit = _fit(row, prior, prior_std)
    return _constant(fit, robot, identified), *_losses(fit, robot, prior_std)


def rows(s: Stretches, robot: Robot) -> RegressionRow:
    """The fit's rows; those without a current are left out.

    Raises:
        InputError: no motor currents.
    """
    motor, radius_m, n = robot.motor, robot.wheel.radius_m, robot.driven
    omega = s.wheel_speed_rad_s[:, :n]
    turning = np.tanh(omega / motor.friction_speed_rad_s)
    loss = (1 - motor.gear_efficiency) * np.sign(s.current_A) * turning
    torque = motor.wheel_constant_Nm_per_A * s.current_A * (1 - loss)
    wheel_rate = s.acceleration @ robot.rolling[:n].T / radius_m
    inertia = robot.inertia[robot.freedoms :] * wheel_rate + radius_m * inertial_forces(robot, s.acceleration)
    drag = radius_m * drag_columns(robot, s.motion).sum(axis=-2)
    columns = np.concatenate([inertia[..., None], drag, turning[..., None], omega[..., None]], axis=-1)
    known = np.isfinite(torque) & np.isfinite(columns).all(axis=-1)
    if not known.any():
        raise InputError("the motor cannot be calibrated without motor currents; the log has none")
    return RegressionRow(torque[known], columns[known], np.repeat(s.drive, n).reshape(known.shape)[known])


def _prior(row: RegressionRow, robot: Robot, rolling: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Prior mean and sigma (5,) of kappa, rolling, roller, friction and damping."""
    torque_Nm = _TORQUE_SHARE * float(np.mean(np.abs(row.torque_Nm)))
    fastest = float(np.abs(row.columns[:, DAMPING]).max())
    roller_std = _ROLLER_STD if robot.chassis.rollers else _HELD
    motor = robot.motor
    mean = np.array([1.0, rolling[0], 0.0, motor.friction_Nm, motor.damping_Nms_per_rad])
    return mean, np.array([_KAPPA_STD, max(rolling[1], _HELD), roller_std, torque_Nm, torque_Nm / fastest])


def _fit(row: RegressionRow, prior: np.ndarray, prior_std: np.ndarray) -> Regression:
    return regress(row.columns, row.torque_Nm, row.drive, prior, prior_std)


def _constant(fit: Regression, robot: Robot, identified: bool) -> Parameter:
    """K_m = K_file / kappa."""
    file, kappa = robot.motor.torque_constant_Nm_per_A, float(fit.beta[KAPPA])
    if not identified:
        return Parameter(CONSTANT, file, _KAPPA_STD * file, "the robot hardly accelerates, and only its mass shows it")
    return Parameter(CONSTANT, file / kappa, float(np.sqrt(fit.cov[KAPPA, KAPPA])) * file / kappa**2)


def _losses(fit: Regression, robot: Robot, prior_std: np.ndarray) -> tuple[Parameter, Parameter]:
    """Friction and damping, over kappa."""
    motor = robot.motor
    alike = (
        "the speeds are too much alike"
        if prior_std[DAMPING] == _HELD
        else "it is small, or the speeds are too much alike"
    )
    return (
        _loss("motor.friction_Nm", FRICTION, fit, motor.friction_Nm, "the rolling resistance of the floor hides it"),
        _loss("motor.damping_Nms_per_rad", DAMPING, fit, motor.damping_Nms_per_rad, alike),
    )


def _loss(name: str, i: int, fit: Regression, own: float, reason: str) -> Parameter:
    """The loss in column i where it is clearly more than nothing, else the robot's own."""
    value = float(fit.beta[i] / fit.beta[KAPPA])
    std = float(np.sqrt(fit.cov[i, i]) / fit.beta[KAPPA])
    return Parameter(name, value, std) if is_identified(name, value, std) else Parameter(name, own, std, reason)
