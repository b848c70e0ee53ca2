"""Radius, track and motors of a robot from drives, each by a linear regression over stretches of them.

    beta = H^-1 (A' y / sigma^2 + P0^-1 beta0),   H = A' A / sigma^2 + P0^-1
    cov  = H^-1 (sum over groups g g' + P0^-1) H^-1,   g = A_g' e_g / sigma^2     (sandwich; White 1980)

sigma is that of the residuals e. Groups are drives if there are ten of them, else rows: a sandwich of few groups is too
small. With drives as groups it holds although the rows of one drive are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.traction.calibration.stretches import SLOWEST_M_S, CalibrationDrive, Stretches, cut
from ohmward.traction.odometry.model import RADIUS_STD, STEERING_ZERO_RAD, OdometryNoise
from ohmward.traction.robot.chassis import Differential, Mecanum, Omni, SkidSteer, Steered, TwoWheeled
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import (
    STIFFNESS,
    drag_columns,
    inertial_forces,
    static_loads,
    travel_speed,
)

#: Largest relative standard deviation with which a number of the robot file counts as identified: the rule for all.
MOST_STD = {
    "wheel.radius_m": 0.1,
    "chassis.track_m": 0.2,
    "chassis.effective_track_m": 0.2,
    "chassis.wheelbase_m": 0.2,
    "chassis.arm_m": 0.2,
    "motor.torque_constant_Nm_per_A": 0.1,
    "motor.friction_Nm": 0.5,
    "motor.damping_Nms_per_rad": 0.5,
}
#: Largest factor between a radius found and the robot file's: beyond, wheels slip all the time, or a unit is wrong.
MOST_RADIUS_RATIO = 2.0


class Parameter(NamedTuple):
    """A number of the robot file."""

    name: str  #: its path in the robot, with its unit: "motor.friction_Nm"
    value: float  #: as calibrated, or the robot's own where it was not
    std: float  #: standard deviation of that
    reason: str = ""  #: reason why it could not be identified; empty if it was

    @property
    def identified(self) -> bool:
        """True if the drives identify it."""
        return not self.reason


def is_identified(name: str, value: float, std: float) -> bool:
    """True if drives identify the number `name` of the robot file: positive, and as certain as `MOST_STD` requires."""
    return value > 0 and std <= MOST_STD[name] * value


def with_parameters(robot: Robot, parameters: Iterable[Parameter]) -> Robot:
    """The robot with those numbers that were identified."""
    for p in parameters:
        if p.identified:
            part, _, name = p.name.partition(".")
            old: Any = getattr(robot, part)
            changed = {name: p.value}
            if name == "wheelbase_m":  # the centre of gravity keeps its place between the axles
                changed["rear_m"] = old.rear_m * p.value / old.wheelbase_m
            robot = replace(robot, **{part: replace(old, **changed)})
    return robot


#: Number of drives from which groups are drives.
FEWEST_DRIVES = 10
#: Least residual over y, for drives without noise: with less, the priors are lost in rounding.
_LEAST_RESIDUAL = 1e-7


class Regression(NamedTuple):
    """beta: (p,); cov: (p, p); std: of the residuals."""

    beta: np.ndarray
    cov: np.ndarray
    std: float


def regress(A: np.ndarray, y: np.ndarray, drive: np.ndarray, prior: np.ndarray, prior_std: np.ndarray) -> Regression:
    """Fit y = A beta.

    Args:
        A: (K, p).
        y: (K,).
        drive: (K,) number of the recording of each row.
        prior: (p,) mean.
        prior_std: (p,) standard deviation; infinity for no prior.
    """
    P0_inv = np.diag(1 / prior_std**2)
    beta = np.linalg.lstsq(A, y, rcond=None)[0]
    least = max(_LEAST_RESIDUAL * float(np.sqrt(np.mean(y**2))), 1e-12)
    for _ in range(20):
        std = max(float(np.sqrt(np.mean((y - A @ beta) ** 2))), least)
        H = A.T @ A / std**2 + P0_inv
        beta = np.linalg.solve(H, A.T @ y / std**2 + P0_inv @ prior)
    H_inv = np.linalg.inv(H)
    g = scores(A, y - A @ beta, drive) / std**2
    return Regression(beta, H_inv @ (g.T @ g + P0_inv) @ H_inv, std)


def scores(A: np.ndarray, residual: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """A_g' e_g of every group, (groups, p), corrected for the degrees of freedom of the fit."""
    numbers, group = np.unique(drive, return_inverse=True)
    if numbers.size < FEWEST_DRIVES:
        group = np.arange(residual.size)
    count = int(group.max()) + 1
    total = np.zeros((count, A.shape[1]))
    np.add.at(total, group, A * residual[:, None])
    return total * np.sqrt(count / max(count - A.shape[1], 1))


#: The number to which the yaw rate of each chassis is inversely proportional, at the same wheel speeds.
TURNS_BY: Mapping[type, str] = {
    Differential: "chassis.track_m",
    TwoWheeled: "chassis.track_m",
    SkidSteer: "chassis.effective_track_m",
    Steered: "chassis.wheelbase_m",
    Omni: "chassis.arm_m",
}
#: Zero of a steering angle, and its largest standard deviation [rad] that counts as identified.
ZERO, MOST_ZERO_STD_RAD = "chassis.steering_zero_rad", 0.5 * STEERING_ZERO_RAD
#: Number of turning stretches from which the share counts as identified.
FEWEST_TURNS = 3
#: Standard deviation of an unknown effective track, relative to the track: skid-steered robots on hard ground have 1.2
#: to 2 times their track; the driver of Clearpath's Husky takes 1.875.
TRACK_STD = 0.5


def calibrate_radius(drives: Sequence[CalibrationDrive], robot: Robot) -> Parameter:
    """The radius with which the wheels' turns give the true speed over ground.

    v = r |G^+ omega|, fitted over the steady stretches; from the undriven wheels if they have encoders, because these
    do not creep. With driven wheels the radius includes the creep of that floor, so calibrate on the floor that grips
    best; its sigma allows for the creep of an ordinary floor.

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
        given = f"{radius_m:.3g} ± {BAND_95 * std_m:.2g} m"
        reason = f"the drives give {given}: the wheels slip much, or there are too few stretches"
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
) -> tuple[Parameter, ...]:
    """The track with which the difference of the sides' speeds gives the true yaw rate; scrubbing makes it wider.

        psi_dot = s r (omega_r - omega_l) / b + o,      b_eff = b / s

    s is the share of the sides' difference that becomes a turn (steering efficiency over 1; A. Mandow et al.,
    "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007), o the offset of a gyro, which stretches
    at rest show. It is fitted to the turn that the wheels predict, after the radius, which straight stretches
    determine. The wheelbase of a steered robot and the arm of an omni robot are as inversely proportional to the yaw
    rate, see `TURNS_BY`. A steered robot has the zero of its steering angle as a second parameter; its reading beyond
    the zero makes the turn d psi_dot / d delta in the same stretches.

    Args:
        drives: with the motion of the body, turns among them.
        robot: with its radius calibrated.
        radius_share_std: relative error of that radius, which the track shares.

    Raises:
        InputError: a mecanum robot, or no stretch.
    """
    chassis = robot.chassis
    if isinstance(chassis, Mecanum):
        raise InputError(
            f"{robot.name} turns by the sum of its track and wheelbase, which no drive tells apart: measure both, and "
            "leave the track out (--what, parts=)"
        )
    name = TURNS_BY[type(chassis)]
    own_m = chassis.turning_track_m if isinstance(chassis, SkidSteer) else getattr(chassis, name.partition(".")[2])
    rows = cut(drives, robot, turning=True)
    by_wheels, yaw_rate = rows.rim[:, -1], rows.motion[:, -1]
    unknown: tuple[Parameter, ...] = (
        Parameter(name, own_m, TRACK_STD * own_m, "the robot hardly turns, or not as its wheels do"),
    )
    if isinstance(chassis, Steered):
        reason = "stretches at other speeds, or at rest, would tell it from the offset of the gyro"
        unknown += (Parameter(ZERO, chassis.steering_zero_rad, STEERING_ZERO_RAD, reason),)
    if (own_m * np.abs(by_wheels) >= SLOWEST_M_S).sum() < FEWEST_TURNS:
        return unknown
    if not yaw_rate.any():
        reason = "the wheels turn the robot, but no yaw rate was measured beside its true speed"
        return tuple(parameter._replace(reason=reason) for parameter in unknown)
    A = np.column_stack([by_wheels, np.ones_like(by_wheels), *_turn_by_zero(robot, rows.rim)])
    prior_std = np.array([np.inf, OdometryNoise().gyro_offset_std_rad_s, np.inf])[: A.shape[1]]
    fit = regress(A, yaw_rate, rows.drive, np.zeros_like(prior_std), prior_std)
    share, std = float(fit.beta[0]), float(np.sqrt(fit.cov[0, 0]))
    if not is_identified(name, share, std):
        return unknown
    scale_std = max(drive.yaw_scale_std for drive in drives)
    found = Parameter(name, own_m / share, own_m / share * math.hypot(std / share, radius_share_std, scale_std))
    if not isinstance(chassis, Steered):
        return (found,)
    # exact for a sine of the angle; else to its third power
    zero_rad, gradient = float(np.arctan(fit.beta[2] / share)), np.array([-fit.beta[2] / share, 0.0, 1.0]) / share
    zero_std_rad = float(np.sqrt(gradient @ fit.cov @ gradient))
    if zero_std_rad > MOST_ZERO_STD_RAD:
        return found, unknown[1]
    return found, Parameter(ZERO, chassis.steering_zero_rad - zero_rad, zero_std_rad)


def _turn_by_zero(robot: Robot, rim: np.ndarray) -> list[np.ndarray]:
    """Change of the yaw rate (K,) with the steering angle for a motion (K, 2) of a steered robot; [] for others.

    d/d delta (v tan(delta) / L) = v (1 + tan(delta)^2) / L,   d/d delta (u sin(delta) / L) = v / L
    """
    chassis = robot.chassis
    if not isinstance(chassis, Steered):
        return []
    speed_m_s, yaw_rate = rim.T
    across_m_s = chassis.wheelbase_m * yaw_rate
    if chassis.measured == "rear":
        safe_m_s = np.where(np.abs(speed_m_s) < SLOWEST_M_S, np.inf, speed_m_s)
        speed_m_s = speed_m_s + across_m_s**2 / safe_m_s
    return [speed_m_s / chassis.wheelbase_m]


#: Prior of the rolling resistance of the floor, share of the load: mean and standard deviation.
ROLLING = (0.02, 0.02)
_KAPPA_STD, _ROLLER_STD, _LOSS_STD_SHARE = 0.5, 0.2, 1.0
CONSTANT = "motor.torque_constant_Nm_per_A"
_UNSTEADY_S = 0.5
#: Columns of the fit; the two between are the rolling resistance and that of rollers.
KAPPA, _, _, FRICTION, DAMPING = range(5)
#: Smallest ratio of fast to slow speeds in the drives that identify the damping.
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
    """Torque constant, friction and damping of the motors; the robot's own value if the drives identify none.

        n K_m I (1 - (1 - eta) d) = kappa [ J domega/dt + r (F_inertia + F_drag) ] + tau_c tanh(omega/omega_0) + b omega

    for every stretch and driven wheel, linear in kappa, the shares of the drag, tau_c and b (`motor`, `terrain.floor`);
    the ground is level. kappa is the robot file's torque constant over the true one: only accelerations show it,
    through the mass. d is the direction of the current and the rotation. An omni robot driven in several directions
    separates the friction of its motors from the drag of its rollers; with wheels that only roll forward the two look
    the same, and the prior of the rolling resistance decides.

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
    fit = regress(row.columns, row.torque_Nm, row.drive, prior, prior_std)
    kappa = fit.beta[KAPPA]
    identified = is_identified(CONSTANT, float(kappa), float(np.sqrt(fit.cov[KAPPA, KAPPA])))
    if not identified:
        prior_std[KAPPA] = _HELD
        fit = regress(row.columns, row.torque_Nm, row.drive, prior, prior_std)
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
    torque_Nm = _LOSS_STD_SHARE * float(np.mean(np.abs(row.torque_Nm)))
    fastest = float(np.abs(row.columns[:, DAMPING]).max())
    roller_std = _ROLLER_STD if robot.chassis.rollers else _HELD
    motor = robot.motor
    mean = np.array([1.0, rolling[0], 0.0, motor.friction_Nm, motor.damping_Nms_per_rad])
    return mean, np.array([_KAPPA_STD, max(rolling[1], _HELD), roller_std, torque_Nm, torque_Nm / fastest])


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
    """The loss in column i if it is identified, else the robot's own."""
    value = float(fit.beta[i] / fit.beta[KAPPA])
    std = float(np.sqrt(fit.cov[i, i]) / fit.beta[KAPPA])
    return Parameter(name, value, std) if is_identified(name, value, std) else Parameter(name, own, std, reason)
