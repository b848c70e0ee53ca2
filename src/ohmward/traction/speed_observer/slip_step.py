"""One step of the robot for a filter: implicit in the slip of the wheels and in nothing else.

A wheel that grips settles in 0.5 ms, so its slip at the end of a step is what balances there. With the slip s* that
the wheels would have if the ground gave nothing,

    s + dt A F(s) = s*,   A = G M^-1 G' + diag(r^2 / J_w)

one equation for each driven wheel, coupled by one part in a hundred through the body. Newton starts at the slip before
the step, where a steady wheel is already, or where the caller knows better: a stiff wheel forgets where it was, so
sigma points start where the step of their mean ends. The force of a law that saturates is concave in the slip, so the
tangent at s = 0 gives a bound that no step may fall below, and from there the steps approach from one side. Rolling
resistance and grade are explicit: order 1, L-stable.

The ground's friction share a and stiffness share k scale a law to F = a law(k/a s): its height by a, its slope by k.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import linearize, maximum, minimum, where
from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, forces_at, momentum_rates, normal_loads
from ohmward.traction.friction.law import Contact
from ohmward.traction.speed_observer.states import Parts

#: Newton steps from the slip before the step, and from a slip that is near the end already.
NEWTON_STEPS, FINISHING_STEPS = 3, 2


class Moved(NamedTuple):
    """Where a step ends.

    motion: (freedoms,) of the body.
    omega: (driven,) [rad/s].
    slip_m_s: (driven,) that balances.
    torque_response: (freedoms + driven, driven) of body and wheels to torque besides that of the currents [1/(N m)].
    force_response: (freedoms + driven, driven) of body and wheels to traction besides that of the law [1/N].
    bend_N: (driven,) force that the part of the slip makes which is there because the law bends.
    damping: (driven,) by which the ground divides what else would change the slip in the step; 1 where a wheel spins.
    """

    motion: np.ndarray
    omega: np.ndarray
    slip_m_s: np.ndarray
    torque_response: np.ndarray
    force_response: np.ndarray
    bend_N: np.ndarray
    damping: np.ndarray


class Balance(NamedTuple):
    """Slip that balances, each (driven,).

    slip_m_s: at the end of the step.
    traction_N: force of the ground during the step.
    slope: of the force over the slip [N s/m], >= 0.
    rest_slope: the same without slip.
    """

    slip_m_s: np.ndarray
    traction_N: np.ndarray
    slope: np.ndarray
    rest_slope: np.ndarray


def slip_step(parts: Parts, u: RobotInput, p: Scene, dt_s: Any, start_m_s: np.ndarray | None = None) -> Moved:
    """Body and wheels after `dt_s` of constant current; `u.grade_rad` is that of the step.

    start_m_s: (driven,) slip near the one that balances; without it Newton starts at the slip before the step.
    """
    robot, n = p.robot, p.robot.driven
    free = robot.freedoms
    radius = robot.wheel.radius_m * parts.radius_ratio
    x = np.concatenate([parts.motion, parts.omega])
    load_N = normal_loads(u, robot, np.zeros(2))
    ballistic = x + dt_s * momentum_rates(x, u, p, without_traction(parts, u, p, load_N)) / robot.inertia
    G = robot.rolling[:n]
    rows, wheels = G / robot.inertia[:free], dt_s / robot.inertia[free:]
    before = radius * parts.omega - G @ parts.motion
    A = dt_s * (rows @ G.T) + np.diag(radius**2 * wheels)
    start, steps = (start_m_s, FINISHING_STEPS) if start_m_s is not None else (before, NEWTON_STEPS)
    balance = balanced(start, radius * ballistic[free:] - G @ ballistic[:free], A, parts, load_N, p, steps)
    F: Any = balance.traction_N
    damping = 1.0 + np.diag(A) * balance.slope
    carried = balance.slope * radius * wheels / damping
    response = np.vstack([dt_s * (rows.T * carried), np.diag(wheels * (1.0 - radius * carried))])
    pushed = np.vstack([dt_s * (rows.T / damping), np.diag(-radius * wheels / damping)])
    bend_N = balance.slope * (balance.slip_m_s - F / balance.rest_slope)
    motion, omega = ballistic[:free] + dt_s * (rows.T @ F), ballistic[free:] - radius * wheels * F
    return Moved(motion, omega, balance.slip_m_s, response, pushed, bend_N, damping)


def without_traction(parts: Parts, u: RobotInput, p: Scene, load_N: np.ndarray) -> Forces:
    """What acts on body and wheels besides the traction of the driven wheels; load_N: (wheels,)."""
    x = np.concatenate([parts.motion, parts.omega])
    f = forces_at(x, u, p, load_N, np.zeros(p.robot.driven))
    return f._replace(rolling_N=parts.rolling_share * f.rolling_N)


def balanced(
    start: np.ndarray, free_slip: np.ndarray, A: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene, steps: int
) -> Balance:
    """Slip s (driven,) of s + A F(s) = free_slip after so many Newton steps; A in m/(N s), start: (driven,).

    The force returned is the law's, so never more than the ground can give.
    """
    diagonal, slip = np.diag(A), start
    _, rest = slopes(np.zeros(len(start)), parts, load_N, p)
    least = free_slip / (1.0 + diagonal * rest)
    for _ in range(steps):
        F, slope = slopes(slip, parts, load_N, p)
        step = slip - (slip + A @ F - free_slip) / (1.0 + diagonal * slope)
        slip = np.array([_beyond(*pair) for pair in zip(step, least, strict=True)])
    return Balance(slip, *slopes(slip, parts, load_N, p), rest)


def _beyond(slip: Any, least: Any) -> Any:
    """`slip`, but not between 0 and `least` nor on the other side of 0."""
    return where(least >= 0, maximum(slip, least), minimum(slip, least))


def slopes(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Force (driven,) [N] and its slope (driven,) [N s/m], which counts as 0 where it falls."""
    F, J = linearize(lambda s: traction(s, parts, load_N, p), slip_m_s)
    return F, np.array([maximum(J[k, k], 0.0) for k in range(len(J))])


def traction(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """Force (driven,) [N] of the ground at these slip speeds (driven,)."""
    travel = p.robot.rolling @ parts.motion
    scaled = parts.stiffness / parts.friction * slip_m_s
    contacts = [Contact(s, v + s, v, N) for s, v, N in zip(scaled, travel, load_N, strict=False)]
    return parts.friction * np.array([t.traction.force_N(c) for t, c in zip(p.terrains, contacts, strict=False)])


def grip(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """(driven,) slope of the force at this slip over the slope at none: 1 grips, 0 spins or slides."""
    _, here = slopes(slip_m_s, parts, load_N, p)
    _, rest = slopes(np.zeros(len(slip_m_s)), parts, load_N, p)
    return here / rest
