"""Quasi-static model: at every instant the wheels have the slip that their force needs.

A wheel that grips settles within a millisecond, so for a filter at 100 Hz its slip is a function of its force and not a
state. The rotation of the wheels is then part of the body's inertia:

(M + sum G_i' G_i J_w / r^2) d(motion)/dt = sum G_i' tau_i / r + rolling resistance + grade
F_i = (tau_i - J_w domega_i/dt) / r,   s_i from F_tr(s_i) = F_i,   omega_i = (v_i + s_i) / r

The model holds on the rising branch only. Where the ground cannot give the force there is no such slip (nan), and the
wheel spins or locks, which `implicit_step` models. The body's equation neglects the change of slip itself, an error of
the order of J_w / (m r^2) times the slip.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.trace import linearize, where
from ohmward.traction.dynamics.forces import RobotInput, Scene, force_on_plane, forces_at, momentum_rates, normal_loads
from ohmward.traction.friction.law import TractionLaw, contact
from ohmward.traction.robot.robot import Robot, wheel_speeds

_QUASI_STATIC_STEPS = 16
_TOLERANCE = 1e-6


class WheelSlip(NamedTuple):
    """The driven wheels of a robot that grips, each (driven,)."""

    traction_N: np.ndarray  #:     force that they need
    slip_speed_m_s: np.ndarray  #: at which the ground gives it; nan where it cannot
    speed_rad_s: np.ndarray  #:    of the wheels, with their slip


def next_motion(motion: np.ndarray, u: RobotInput, p: Scene, dt_s: Any) -> np.ndarray:
    """Motion of the body (freedoms,) after `dt_s` of constant input: the midpoint rule, order 2.

    Raises:
        InputError: a chassis that drags its wheels sideways, which needs slip to turn.
    """
    if p.robot.chassis.scrubs:
        raise InputError("quasi-static slip needs wheels that are free sideways; use implicit_step for skid-steering")
    halfway = motion + dt_s / 2 * motion_rates(motion, u, p)
    return motion + dt_s * motion_rates(halfway, u, p)


def motion_rates(motion: np.ndarray, u: RobotInput, p: Scene) -> np.ndarray:
    """Rate of change of the body's motion (freedoms,) while all wheels grip."""
    robot, free = p.robot, p.robot.freedoms
    x = gripping(motion, robot)
    force = momentum_rates(x, u, p, forces_at(x, u, p, normal_loads(u, robot, np.zeros(2))))
    rows = robot.rolling[: robot.driven] / robot.wheel.radius_m
    inertia = np.diag(robot.inertia[:free]) + rows.T @ (robot.inertia[free:, None] * rows)
    return np.linalg.inv(inertia) @ (force[:free] + rows.T @ force[free:])


def wheel_slip(motion: np.ndarray, u: RobotInput, p: Scene) -> WheelSlip:
    """Slip of the driven wheels in this motion (freedoms,) of the body."""
    robot = p.robot
    x = gripping(motion, robot)
    f = forces_at(x, u, p, normal_loads(u, robot, np.zeros(2)))
    turning = robot.inertia[robot.freedoms :] * wheel_speeds(robot, motion_rates(motion, u, p))[: robot.driven]
    traction = (f.torque_Nm - f.friction_Nm - turning) / robot.wheel.radius_m
    of_all = np.concatenate([traction, np.zeros(len(robot.places) - robot.driven)])
    load_N = normal_loads(u, robot, force_on_plane(f._replace(traction_N=of_all), robot))
    share = np.broadcast_to(np.asarray(u.adhesion_share), load_N.shape)
    travel = robot.rolling @ motion
    slip = np.array([
        slip_at_force(p.terrains[k].traction, traction[k] / share[k], travel[k], load_N[k]) for k in range(robot.driven)
    ])  # fmt: skip
    return WheelSlip(traction, slip, x[robot.freedoms :] + slip / robot.wheel.radius_m)


def slip_at_force(law: TractionLaw, force_N: Any, travel_speed_m_s: Any, load_N: Any) -> Any:
    """Slip speed [m/s] of the rising branch at which the ground gives this force; nan where it cannot."""

    def excess(s: np.ndarray) -> np.ndarray:
        return np.array([law.force_N(contact(travel_speed_m_s + s[0], travel_speed_m_s, load_N)) - force_N])

    slip: Any = 0.0 * force_N
    for _ in range(_QUASI_STATIC_STEPS):
        value, slope = linearize(excess, np.array([slip]))
        slip = slip - value[0] / where(slope[0, 0] > 0, slope[0, 0], np.inf)
    left = excess(np.array([slip]))[0]
    return where(abs(left) <= _TOLERANCE * load_N, slip, np.nan)


def gripping(motion: np.ndarray, robot: Robot) -> np.ndarray:
    """The state (n,) of a robot with this motion on wheels without slip."""
    return np.concatenate([motion, wheel_speeds(robot, motion)[: robot.driven]])
