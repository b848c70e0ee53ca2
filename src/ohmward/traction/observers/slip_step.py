"""One step of the robot for a filter: implicit in the slip of the wheels and in nothing else.

A wheel that grips settles in 0.5 ms, so its slip at the end of a step is what balances there. With the slip s* that
the wheels would have if the ground gave nothing,

    s + dt A F(s) = s*,   A = G M^-1 G' + diag(r^2 / J_w)

one equation for each driven wheel, coupled by one part in a hundred through the body. The force of a law that saturates
is concave in the slip, so Newton's steps from s = 0 approach the solution from one side and cannot overshoot; four are
within 1 mm/s from full grip to full spin. Rolling resistance and grade are explicit: order 1, L-stable, passive.

The ground's friction share a and stiffness share k scale a law to F = a law(k/a s): its height by a, its slope by k.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import linearize, maximum
from ohmward.traction.dynamics import Input, Scene, forces_at, momentum_rates, normal_loads
from ohmward.traction.laws import contact
from ohmward.traction.observers.states import Parts

NEWTON_STEPS = 4


class Moved(NamedTuple):
    """Where a step ends.

    motion: (freedoms,) of the body.
    omega: (driven,) [rad/s].
    traction_N: (driven,) force of the ground during the step.
    """

    motion: np.ndarray
    omega: np.ndarray
    traction_N: np.ndarray


def slip_step(parts: Parts, u: Input, p: Scene, dt_s: Any) -> Moved:
    """Body and wheels after `dt_s` of constant current; `u.grade_rad` is that of the step."""
    robot, n = p.robot, p.robot.driven
    free = robot.freedoms
    radius = robot.wheel.radius_m * parts.radius_share
    x = np.concatenate([parts.motion, parts.omega])
    load_N = normal_loads(u, robot, np.zeros(2))
    ballistic = x + dt_s * momentum_rates(x, u, p, forces_at(x, u, p, load_N, np.zeros(n))) / robot.inertia
    G = robot.rolling[:n]
    rows = G / robot.inertia[:free]
    A = rows @ G.T + np.diag(radius**2 / robot.inertia[free:])
    slip = balanced_slip(radius * ballistic[free:] - G @ ballistic[:free], dt_s * A, parts, load_N, p)
    F = traction(slip, parts, load_N, p)
    omega = ballistic[free:] - dt_s * radius / robot.inertia[free:] * F
    return Moved(ballistic[:free] + dt_s * (rows.T @ F), omega, F)


def balanced_slip(free_slip: np.ndarray, A: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """S (driven,) [m/s] of s + A F(s) = free_slip; A in m/s per newton."""
    stiffness = np.diag(A)
    slip = np.zeros(len(free_slip))
    for _ in range(NEWTON_STEPS):
        F, J = linearize(lambda s: traction(s, parts, load_N, p), slip)
        slope = np.array([maximum(J[k, k], 0.0) for k in range(len(J))])
        slip = slip - (slip + A @ F - free_slip) / (1.0 + stiffness * slope)
    return slip


def traction(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """Force (driven,) [N] of the ground at these slip speeds (driven,)."""
    travel = p.robot.rolling @ parts.motion
    return np.array(
        [
            a * p.terrains[k].traction.force_N(contact(travel[k] + parts.stiffness / a * s, travel[k], load_N[k]))
            for k, (s, a) in enumerate(zip(slip_m_s, parts.friction, strict=True))
        ]
    )


def grip(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """(driven,) slope of the force at this slip over the slope at none: 1 grips, 0 spins or slides."""
    _, here = linearize(lambda s: traction(s, parts, load_N, p), slip_m_s)
    _, rest = linearize(lambda s: traction(s, parts, load_N, p), np.zeros(len(slip_m_s)))
    return np.array([maximum(here[k, k], 0.0) / rest[k, k] for k in range(len(slip_m_s))])
