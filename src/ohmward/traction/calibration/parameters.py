"""Radius, track and motors of a robot from drives, each by a linear regression over stretches of them.

    beta = H^-1 (A' y / sigma^2 + P0^-1 beta0),   H = A' A / sigma^2 + P0^-1
    cov  = H^-1 (sum over groups g g' + P0^-1) H^-1,   g = A_g' e_g / sigma^2     (sandwich; White 1980)

sigma is that of the residuals e. Groups are drives if there are ten of them, else twenty pieces of the drives: a
sandwich of few groups is too small. It holds although the rows of one group are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.runs import from_to
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
#: Largest factors between a size found and the robot file's: beyond, a unit is wrong, or a radius is a diameter; the
#: factor of a radius beyond which that is a warning.
MOST_RADIUS_RATIO, MOST_TURNING_RATIO, DOUBTFUL_RADIUS_RATIO = 1.8, 10.0, 1.2
#: Relative error of a radius that lasts for seconds, from which it is a warning: hard floors and tyres have less.
CORRELATED_SHARE = 0.05
#: Largest relative difference of the radii that the speeds of both sides ask for, in wheels that count alike.
MOST_UNEQUAL = 0.1


class Parameter(NamedTuple):
    """A number of the robot file."""

    name: str  #: its path in the robot, with its unit: "motor.friction_Nm"
    value: float  #: as calibrated, or the robot's own where it was not
    std: float  #: standard deviation of that
    reason: str = ""  #: reason why it could not be identified; empty if it was
    warning: str = ""  #: what contradicts it; empty if nothing does

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


#: Number of drives from which groups are drives, else that of pieces of the drives.
FEWEST_DRIVES, PIECES = 10, 20
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
        group = np.arange(residual.size) * min(PIECES, residual.size) // residual.size
    count = int(group.max()) + 1
    total = np.zeros((count, A.shape[1]))
    np.add.at(total, group, A * residual[:, None])
    return total * np.sqrt(count / max(count - A.shape[1], 1))


#: Standard deviations of its own value, beyond the band of all, from which a part of the drives contradicts them.
_CONTRADICTS_STDS = 3.0


def correlated_error(residual: np.ndarray, fitted: np.ndarray, drive: np.ndarray) -> float:
    """Relative standard deviation of the error that lasts from stretch to stretch, which no mean takes out.

    rho_1 = sum e_k e_k+1 / sum e_k^2 (Bartlett 1946: standard deviation 1 / sqrt(K) for white noise). Above twice that
    there is slip, which has one sign, a true motion that is late or in another frame, or a contradiction.

    residual, fitted, drive: (K,), in the order of time.
    """
    same = drive[1:] == drive[:-1]
    product = (residual[1:] * residual[:-1])[same]
    variance = float(np.mean(residual**2))
    if product.size < FEWEST_DRIVES or product.mean() <= 2.0 * variance / math.sqrt(product.size):
        return 0.0
    return math.sqrt(float(product.mean() / np.mean(fitted**2)))


def contradiction(
    drives: Sequence[CalibrationDrive], rows: Stretches, fitted: np.ndarray, residual: np.ndarray, share_std: float
) -> tuple[str, float]:
    """The drive, or the quarter of a single one, that contradicts all most, and the factor of its own value to theirs.

    fitted, residual: (K,) of all.  share_std: relative standard deviation of their value.  ("", 1.0) where none does.
    """
    part = rows.drive if len(drives) > 1 else 4 * np.arange(fitted.size) // fitted.size
    power, product = (np.bincount(part, fitted * values) for values in (fitted, residual))
    power = np.maximum(power, 1e-12)
    own_std = np.sqrt(np.mean(residual**2) / power)
    beyond = np.abs(product / power) - BAND_95 * share_std - _CONTRADICTS_STDS * own_std
    worst = int(beyond.argmax())
    if not beyond[worst] > 0.0:
        return "", 1.0
    when = "" if len(drives) > 1 else f" {from_to(rows.time_s[part == worst])}"
    return f"log {drives[worst if len(drives) > 1 else 0].log.name!r}{when}", 1.0 + float(product[worst] / power[worst])


def _unequal_sides(robot: Robot, rows: Stretches) -> str:
    """Reason not to believe wheels whose sides ask for different radii: v = (r_l omega_l + r_r omega_r) / 2."""
    if not isinstance(robot.chassis, Differential | TwoWheeled) or rows.drive.size < FEWEST_DRIVES:
        return ""
    own_m, n = robot.wheel.radius_m, robot.driven
    left = np.array([place.y_m > 0 for place in robot.places[:n]])
    A = 0.5 * np.column_stack([rows.wheel_speed_rad_s[:, :n][:, side].mean(axis=1) for side in (left, ~left)])
    fit = regress(A, rows.motion[:, 0], rows.drive, np.full(2, own_m), np.full(2, own_m))
    std_m = math.sqrt(fit.cov[0, 0] + fit.cov[1, 1] - 2.0 * fit.cov[0, 1])
    if not abs(fit.beta[0] - fit.beta[1]) > MOST_UNEQUAL * abs(fit.beta.mean()) + _CONTRADICTS_STDS * std_m:
        return ""
    return (
        f"the left wheel asks for a radius of {fit.beta[0]:.3g} m, the right one for {fit.beta[1]:.3g} m: an encoder "
        "is dead or counts otherwise than the other, the wheels slip, or the true speed is wrong"
    )


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
    best; its sigma allows for the creep of an ordinary floor, and for an error that lasts (`correlated_error`).

    Raises:
        InputError: no steady stretch.
    """
    rows = cut(drives, robot)
    passive = _passive_turns(robot, rows)
    turns = travel_speed(rows.rim) / robot.wheel.radius_m if passive is None else passive
    known = np.isfinite(turns)
    rows, turns = Stretches(*(values[known] for values in rows)), turns[known]
    speed_m_s = travel_speed(rows.motion)
    fit = regress(turns[:, None], speed_m_s, rows.drive, np.zeros(1), np.array([np.inf]))
    creep = 0.0
    if passive is None:  # of driven wheels under these forces on a floor of ordinary stiffness
        torque_Nm = wheel_torque(robot.motor, rows.current_A, rows.wheel_speed_rad_s[:, : robot.driven])
        share = np.abs(torque_Nm) / robot.wheel.radius_m / static_loads(robot)[: robot.driven]
        creep = float(np.nanmean(share)) / STIFFNESS if np.isfinite(share).any() else 0.02
    own_m, radius_m = robot.wheel.radius_m, max(float(fit.beta[0]), 1e-9)  # > 0 for one that never moved
    fitted_m_s = radius_m * turns
    residual_m_s = speed_m_s - fitted_m_s
    share_std = math.hypot(math.sqrt(fit.cov[0, 0]) / radius_m, creep)
    part, factor = contradiction(drives, rows, fitted_m_s, residual_m_s, share_std)
    correlated = correlated_error(residual_m_s, fitted_m_s, rows.drive)
    std_m = radius_m * math.hypot(share_std, correlated)
    given = f"the drives give {radius_m:.3g} ± {BAND_95 * std_m:.2g} m"
    apart = f", {part} alone gives {factor * radius_m:.3g} m" if part else ""
    ratio = max(radius_m / own_m, own_m / radius_m)
    reason, warning = _unequal_sides(robot, rows), ""
    if ratio > MOST_RADIUS_RATIO:
        reason = reason or (
            f"{given} for {own_m:.3g} m: the wheels slip all the time, a unit is wrong, or the radius of the robot "
            "file, as where it is the diameter"
        )
    elif not is_identified("wheel.radius_m", radius_m, std_m):
        reason = reason or (
            f"{given}{apart}: the wheels slip much, the true motion is late or in another frame, drives contradict "
            "each other, or there are too few stretches"
        )
    elif ratio > DOUBTFUL_RADIUS_RATIO:
        warning = f"{given}{apart}, the robot file {own_m:.3g} m: measure it; wheels that slip all the time look alike"
    elif part or correlated > CORRELATED_SHARE:
        warning = f"{given}{apart}: slip, which makes it too small, or a true motion that is late or wrong"
    return Parameter("wheel.radius_m", own_m if reason else radius_m, std_m, reason, "" if reason else warning)


def _passive_turns(robot: Robot, rows: Stretches) -> np.ndarray | None:
    """Travel over radius [rad/s] from the wheels that are not driven; None without their encoders."""
    free = robot.rolling[robot.driven :]
    if len(free) < robot.freedoms or not np.isfinite(rows.wheel_speed_rad_s[:, robot.driven :]).all(axis=1).any():
        return None
    return travel_speed(rows.wheel_speed_rad_s[:, robot.driven :] @ np.linalg.pinv(free).T)


def calibrate_track(
    drives: Sequence[CalibrationDrive], robot: Robot, radius_share_std: float = RADIUS_STD
) -> tuple[Parameter, ...]:
    """The track with which the difference of the sides' speeds gives the true yaw rate; scrubbing makes it wider.

        psi_dot = s r (omega_r - omega_l) / b + o,      b_eff = b / s

    s is the share of the sides' difference that becomes a turn (steering efficiency over 1; A. Mandow et al.,
    "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007), o the offset of a gyro, which stretches
    at rest show. It is fitted to the turn that the wheels predict, after the radius, which straight stretches
    determine, with unequal radii of both sides, which turns to both sides tell from the track. The wheelbase of a
    steered robot and the arm of an omni robot are as inversely proportional to the yaw rate, see `TURNS_BY`. A steered
    robot has the zero of its steering angle as a second parameter; its reading beyond the zero makes the turn
    d psi_dot / d delta in the same stretches.

    Args:
        drives: with the motion of the body, turns among them.
        robot: with its radius calibrated.
        radius_share_std: relative error of that radius, which the track shares; infinity where it is not identified.

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
    A = np.column_stack([by_wheels, np.ones_like(by_wheels), _turn_ahead(robot, rows.rim)])
    rough = max(abs(float(by_wheels @ yaw_rate) / float(by_wheels @ by_wheels)), 1.0 / MOST_TURNING_RATIO)
    unequal_std = np.inf if isinstance(chassis, Steered) else math.sqrt(2.0) * RADIUS_STD * rough
    prior_std = np.array([np.inf, OdometryNoise().gyro_offset_std_rad_s, unequal_std])
    fit = regress(A, yaw_rate, rows.drive, np.zeros_like(prior_std), prior_std)
    share, std = float(fit.beta[0]), float(np.sqrt(fit.cov[0, 0]))
    if reason := _wrong_turn(robot, rows, own_m, share, std, radius_share_std):
        return unknown[0]._replace(reason=reason), *unknown[1:]
    if not is_identified(name, share, std):
        return unknown
    scale_std, track_m = max(drive.yaw_scale_std for drive in drives), own_m / share
    share_std = math.hypot(std / share, radius_share_std, scale_std)
    part, factor = contradiction(drives, rows, share * by_wheels, yaw_rate - A @ fit.beta, share_std)
    given = f"the drives give {track_m:.3g} ± {BAND_95 * share_std * track_m:.2g} m"
    warning = f"{given}, {part} alone {track_m / factor:.3g} m: slip, or a true motion that is late or wrong"
    found = Parameter(name, track_m, share_std * track_m, warning=warning if part else "")
    if not isinstance(chassis, Steered):
        return (found,)
    # exact for a sine of the angle; else to its third power
    zero_rad, gradient = float(np.arctan(fit.beta[2] / share)), np.array([-fit.beta[2] / share, 0.0, 1.0]) / share
    zero_std_rad = float(np.sqrt(gradient @ fit.cov @ gradient))
    if zero_std_rad > MOST_ZERO_STD_RAD:
        return found, unknown[1]
    return found, Parameter(ZERO, chassis.steering_zero_rad - zero_rad, zero_std_rad)


def _wrong_turn(robot: Robot, rows: Stretches, own_m: float, share: float, std: float, radius_share_std: float) -> str:
    """Reason why turns do not show a size of own_m in the robot file; "" if they may."""
    if share < -_CONTRADICTS_STDS * std < 0.0:
        return (
            "the robot turns the other way than its wheels: left and right wheels are exchanged, or the sign of the "
            "gyro, heading or steering angle is wrong"
        )
    if not (0.0 if robot.chassis.scrubs else 1 / MOST_TURNING_RATIO) < share < MOST_TURNING_RATIO:
        return (
            f"the drives give {own_m / share:.3g} m for {own_m:.3g} m: the unit of the yaw rate (--unit) or of the "
            "heading (--pose-unit) is wrong, or the robot hardly turns"
        )
    if not math.isfinite(radius_share_std):
        return "the radius is not identified; where the file's is right, calibrate the track alone (--what track)"
    return _unequal_sides(robot, rows)


def _turn_ahead(robot: Robot, rim: np.ndarray) -> np.ndarray:
    """Change of the yaw rate (K,) of a robot ahead with what makes it turn, for a motion (K, freedoms).

    The angle delta of a steered robot, and of others the relative difference eps of the radii of both sides:

    d/d delta (v tan(delta) / L) = v (1 + tan(delta)^2) / L,   d/d delta (u sin(delta) / L) = v / L
    d/d eps ((1 + eps/2) v_r - (1 - eps/2) v_l) / b = v / b
    """
    chassis, speed_m_s, yaw_rate = robot.chassis, rim[:, 0], rim[:, -1]
    if isinstance(chassis, Omni | Mecanum):
        return np.zeros_like(speed_m_s)
    if not isinstance(chassis, Steered):
        return speed_m_s / (chassis.turning_track_m if isinstance(chassis, SkidSteer) else chassis.track_m)
    across_m_s = chassis.wheelbase_m * yaw_rate
    if chassis.measured == "rear":
        safe_m_s = np.where(np.abs(speed_m_s) < SLOWEST_M_S, np.inf, speed_m_s)
        speed_m_s = speed_m_s + across_m_s**2 / safe_m_s
    return speed_m_s / chassis.wheelbase_m


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
    torque_Nm, columns, drive = rows(stretches, robot)
    motor = robot.motor
    loss_std_Nm = _LOSS_STD_SHARE * float(np.mean(np.abs(torque_Nm)))
    roller_std = _ROLLER_STD if robot.chassis.rollers else _HELD
    damping_std = loss_std_Nm / float(np.abs(columns[:, DAMPING]).max())
    # of kappa, rolling, roller, friction and damping
    prior = np.array([1.0, rolling[0], 0.0, motor.friction_Nm, motor.damping_Nms_per_rad])
    prior_std = np.array([_KAPPA_STD, max(rolling[1], _HELD), roller_std, loss_std_Nm, damping_std])
    slow, fast = np.quantile(travel_speed(stretches.rim), [0.1, 0.9])
    if not fast >= _SPEED_RATIO * slow:
        prior_std[DAMPING] = _HELD
    fit = regress(columns, torque_Nm, drive, prior, prior_std)
    kappa, kappa_std = float(fit.beta[KAPPA]), float(np.sqrt(fit.cov[KAPPA, KAPPA]))
    own = motor.torque_constant_Nm_per_A
    if is_identified(CONSTANT, kappa, kappa_std):
        found = [Parameter(CONSTANT, own / kappa, kappa_std * own / kappa**2)]
    else:
        reason = "the robot hardly accelerates, and only its mass shows it"
        found = [Parameter(CONSTANT, own, _KAPPA_STD * own, reason)]
        prior_std[KAPPA] = _HELD
        fit = regress(columns, torque_Nm, drive, prior, prior_std)
    return (*found, *_losses(fit, robot, prior_std))


def _losses(fit: Regression, robot: Robot, prior_std: np.ndarray) -> Iterator[Parameter]:
    """Friction and damping, over kappa; the robot's own where they are not identified."""
    motor, kappa = robot.motor, float(fit.beta[KAPPA])
    alike = "the speeds are too much alike"
    if prior_std[DAMPING] != _HELD:
        alike = f"it is small, or {alike}"
    for i, name, own, reason in (
        (FRICTION, "motor.friction_Nm", motor.friction_Nm, "the rolling resistance of the floor hides it"),
        (DAMPING, "motor.damping_Nms_per_rad", motor.damping_Nms_per_rad, alike),
    ):
        value, std = float(fit.beta[i]) / kappa, float(np.sqrt(fit.cov[i, i])) / kappa
        yield Parameter(name, value, std) if is_identified(name, value, std) else Parameter(name, own, std, reason)


def rows(s: Stretches, robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stretches and driven wheels as rows (K,): torque of the currents, columns (K, 5) of the fit, and the drive.

    Those without a current are left out.

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
    return torque[known], columns[known], np.repeat(s.drive, n).reshape(known.shape)[known]
