"""Learn a floor from drives on it: friction and stiffness of the traction, and the drag.

    lambda = h slip of the law at F / (mu N)      for every stretch and driven wheel, F from the motor current

Maximum a posteriori of ln mu, ln C, ln kappa, k and p by Gauss-Newton with Levenberg's damping, with the prior of any
floor (`terrain.floor`); the covariance is the sandwich of `parameters`. The drag is linear in its two shares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.calibration.parameters import regress, scores
from ohmward.traction.calibration.stretches import CalibrationDrive, Stretches, cut
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import (
    ACROSS_STD,
    FRICTION,
    FRICTION_STD,
    ROLLING,
    SIDE_STD,
    SPEED_POWER_STD,
    STIFFNESS,
    STIFFNESS_STD,
    Floor,
    drag_columns,
    inertial_forces,
    mean_load,
    slip_at_force,
    slip_factor,
    static_loads,
    travel_speed,
    wheel_motion,
)

_PRIOR = np.array([np.log(FRICTION), np.log(STIFFNESS), 0.0, 0.0, 0.0])
_PRIOR_STD = np.array([FRICTION_STD, STIFFNESS_STD, ACROSS_STD, SIDE_STD, SPEED_POWER_STD])
#: Gauss-Newton steps, damping of the first, step of the numerical derivative, and least sigma of the residuals.
_GAUSS_NEWTON_STEPS, _DAMPING, _NUDGE, _LEAST_RESIDUAL_STD = 30, 1e-3, 1e-4, 1e-9
#: Least slip of a drive that a law of two parameters leaves unexplained.
_LEAST_SLIP_STD = 0.005
#: Largest size of k and p.
_MOST_SHAPE = 0.9
_COASTING_S = 0.3
#: Standard deviation of a value that is held, because the fit would leave its range.
_HELD_STD = 1e-6


#: Largest friction of an identified floor, and its largest relative standard deviation: just above that of the prior.
MOST_FRICTION, MOST_FRICTION_STD = 2.5, 1.1 * FRICTION_STD


class Points(NamedTuple):
    """Stretches and driven wheels, (K, driven)."""

    #: lambda, and force over load
    slip_ratio: np.ndarray
    force_share: np.ndarray
    #: motion in the rolling direction and across it [m/s]
    along: np.ndarray
    across: np.ndarray
    travel_m_s: np.ndarray  #: (K, 1) speed of the rims
    drive: np.ndarray  #: (K,) number of the recording


class FloorFit(NamedTuple):
    """values: (5,) ln mu, ln C, ln kappa, k and p; cov: (5, 5); slip_std: unexplained part of a drive's slip."""

    values: np.ndarray
    cov: np.ndarray
    slip_std: float


def learn_floor(name: str, drives: Sequence[CalibrationDrive], robot: Robot) -> Floor:
    """The floor of these drives, for a robot whose radius and motors are calibrated.

    Raises:
        InputError: no steady stretch, or no motor currents.
    """
    at = points(cut(drives, robot), robot)
    law = fit_law(at)
    drag = fit_drag(cut(drives, robot, length_s=_COASTING_S), robot)
    friction, stiffness, across = np.exp(law.values[:3]).tolist()
    side, power = np.clip(law.values[3:], -_MOST_SHAPE, _MOST_SHAPE).tolist()
    std = np.sqrt(np.diag(law.cov)).tolist()
    return Floor(
        name,
        friction=friction,
        friction_std=std[0],
        stiffness=stiffness,
        stiffness_std=std[1],
        correlation=float(np.clip(law.cov[0, 1] / (std[0] * std[1]), -0.999, 0.999)),
        slip_std=law.slip_std,
        **drag,
        drives=len(drives),
        across=min(across, 1.0),
        across_std=std[2],
        side=side,
        side_std=std[3],
        speed_power=power,
        speed_power_std=std[4],
        slowest_m_s=float(at.travel_m_s.min()),
        fastest_m_s=float(at.travel_m_s.max()),
    )


def unidentified_floor(floor: Floor) -> str:
    """Reason why the drives do not identify a floor; empty if they do."""
    if floor.friction <= MOST_FRICTION and floor.friction_std <= MOST_FRICTION_STD:
        return ""
    return (
        f"friction {floor.friction:.3g} with a standard deviation of {100 * floor.friction_std:.0f} % (at most "
        f"{MOST_FRICTION:g} and {100 * MOST_FRICTION_STD:.0f} %): calibrate the robot first (--what "
        "radius,motor, parts=('radius', 'motor')), "
        "weigh its wheels (--wheel-load), or add drives in which the wheels slip more; no floor was learnt"
    )


def points(s: Stretches, robot: Robot) -> Points:
    """Slip and force of the driven wheels.

    Raises:
        InputError: no motor currents.
    """
    n, radius_m = robot.driven, robot.wheel.radius_m
    slip_m_s = radius_m * s.wheel_speed_rad_s[:, :n] - s.motion @ robot.rolling[:n].T
    share = traction(s, robot) / static_loads(robot)[:n]
    known = (np.isfinite(share) & np.isfinite(slip_m_s)).all(axis=1)
    if not known.any():
        raise InputError("a floor cannot be learnt without motor currents; the log has none")
    travel_m_s = travel_speed(s.rim)[:, None]
    along, across = (v[:, :n] for v in wheel_motion(robot, s.rim))
    return Points(*(v[known] for v in (slip_m_s / travel_m_s, share, along, across, travel_m_s, s.drive)))


def traction(s: Stretches, robot: Robot) -> np.ndarray:
    """Force (K, driven) [N] of the ground on the driven wheels."""
    n, radius_m = robot.driven, robot.wheel.radius_m
    turning = robot.inertia[robot.freedoms :] * (s.acceleration @ robot.rolling[:n].T) / radius_m
    return (wheel_torque(robot.motor, s.current_A, s.wheel_speed_rad_s[:, :n]) - turning) / radius_m


def fit_law(p: Points) -> FloorFit:
    """Friction and stiffness, dependence of the slip on direction and speed, and the unexplained slip.

    At most the whole motion along the axle renews a contact: kappa is held at 1 where the fit would exceed it.
    """
    fit = _fit(p, _PRIOR_STD)
    if fit.values[2] <= 0:
        return fit
    held = _fit(p, np.where(np.arange(_PRIOR.size) == 2, _HELD_STD, _PRIOR_STD))
    held.cov[2, 2] = _PRIOR_STD[2] ** 2
    return held


def _fit(p: Points, prior_std: np.ndarray) -> FloorFit:
    slip, P0_inv = p.slip_ratio.ravel(), np.diag(prior_std**-2)
    values, damping = _PRIOR, _DAMPING
    std = max(float(np.std(slip - _slip(values, p))), _LEAST_RESIDUAL_STD)

    def loss(at: np.ndarray) -> float:
        return float(np.sum(((slip - _slip(at, p)) / std) ** 2) + np.sum(((at - _PRIOR) / prior_std) ** 2))

    for _ in range(_GAUSS_NEWTON_STEPS):
        residual, J = slip - _slip(values, p), _jacobian(values, p)
        H = J.T @ J / std**2 + P0_inv
        gradient = J.T @ residual / std**2 + P0_inv @ (_PRIOR - values)
        trial = values + np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
        if loss(trial) <= loss(values):
            values = trial
            damping = damping / 4
        else:
            damping = damping * 8
        std = max(float(np.sqrt(np.mean((slip - _slip(values, p)) ** 2))), _LEAST_RESIDUAL_STD)
    residual, J = slip - _slip(values, p), _jacobian(values, p)
    H_inv = np.linalg.inv(J.T @ J / std**2 + P0_inv)
    wheels = p.force_share.shape[1]
    g = scores(J, residual, np.repeat(p.drive, wheels)) / std**2
    cov = H_inv @ (g.T @ g + P0_inv) @ H_inv
    by_wheel = residual.reshape(-1, wheels)
    means = np.array([by_wheel[p.drive == d].mean(axis=0) for d in np.unique(p.drive)])  # of each drive
    slip_std = float(np.sqrt(np.mean((means if len(means) > 1 else by_wheel) ** 2)))
    return FloorFit(values, cov, max(slip_std, _LEAST_SLIP_STD))


def fit_drag(s: Stretches, robot: Robot) -> dict[str, float]:
    """Drag of a `Floor`: its shares of the load, and the force over the load that they leave unexplained."""
    force = traction(s, robot) - inertial_forces(robot, s.acceleration)
    known = np.isfinite(force).all(axis=1)
    force, drive = force[known], s.drive[known]
    D = drag_columns(robot, s.rim[known]).sum(axis=-2)
    n, omni = robot.driven, robot.chassis.rollers
    prior, prior_std = np.array([ROLLING, 0.0]), np.array([0.2, 0.5 if omni else 1e-6])
    fit = regress(D.reshape(-1, 2), force.ravel(), np.repeat(drive, n), prior, prior_std)
    negative = fit.beta < 0
    if negative.any():
        prior, prior_std = np.where(negative, 0.0, prior), np.where(negative, _HELD_STD, prior_std)
        fit = regress(D.reshape(-1, 2), force.ravel(), np.repeat(drive, n), prior, prior_std)
    shares = np.maximum(fit.beta, 0.0)
    expected = D @ shares
    scale = [np.sum(force[drive == d] * expected[drive == d]) / np.sum(expected[drive == d] ** 2) for d in set(drive)]
    spread = float(np.std(scale)) if len(scale) > 1 else 0.2
    rolling, roller = shares.tolist()
    force_std = max(fit.std / mean_load(robot), 0.005)
    return {"rolling": rolling, "roller": roller, "drag_std": max(spread, 0.02), "force_std": force_std}


def _slip(values: np.ndarray, p: Points) -> np.ndarray:
    """Slip (K driven,) that these values give."""
    log_speed = np.log(p.travel_m_s / np.sqrt(p.travel_m_s.min() * p.travel_m_s.max()))
    factor = slip_factor((np.exp(values[2]), *values[3:]), p.along, p.across, log_speed)
    return (factor * slip_at_force(p.force_share, np.exp(values[0]), np.exp(values[1]))).ravel()


def _jacobian(values: np.ndarray, p: Points) -> np.ndarray:
    """Slope of the slip over the values, (K driven, 5), by central differences."""
    nudges = _NUDGE * np.eye(values.size)
    return np.column_stack([(_slip(values + e, p) - _slip(values - e, p)) / (2 * _NUDGE) for e in nudges])
