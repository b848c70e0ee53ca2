"""One step of the robot for a filter: implicit in the slip of the driven wheels, explicit in everything else.

A gripping wheel settles in 0.5 ms, so its slip at the end of a step is the one that balances there (implicit Euler:
order 1, L-stable). From v* and omega*, where the step would end without traction, and the slip s = r omega - G v:

    v     = v*     + dt M^-1 G' F(s)
    omega = omega* - dt J_w^-1 r F(s)
    s     = s*     - A F(s),    A = dt (G M^-1 G' + r^2 J_w^-1)

The last line is one equation for each driven wheel, coupled by one part in a hundred through the body. Newton starts at
the slip before the step, where a steady wheel already is, or at a slip from the caller: a stiff wheel forgets its past,
so sigma points start where the step of their mean ends. The traction of a law that saturates is concave in the slip, so
the tangent at s = 0 gives a bound that no step may fall below, and from there the steps approach from one side.

A torque tau and a traction f that the model does not know change the end of the step by (slope k = dF/ds, damping
D = 1 + diag(A) k, neglecting the coupling of the wheels)

    dF/dtau     = k r dt J_w^-1 / D                 traction that the ground adds for the torque
    dv/dtau     = dt M^-1 G' dF/dtau                dv/df     =  dt M^-1 G' / D
    domega/dtau = dt J_w^-1 (1 - r dF/dtau)         domega/df = -dt J_w^-1 r / D

The friction ratio a and the stiffness ratio c of the ground scale its law to F = a law(c/a s): the height by a, the
slope at rest by c.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import linearize, maximum, minimum, where
from ohmward.traction.dynamics.forces import Forces, RobotInput, Scene, forces_at, momentum_rates, normal_loads
from ohmward.traction.friction.law import Contact
from ohmward.traction.speed_observer.states import Parts

#: Newton steps from the slip before the step, and from a slip that is near the end already.
SLIP_STEPS, FINISHING_STEPS = 3, 2


class SlipStep(NamedTuple):
    """End of a step, and its response to unknown torque and traction."""

    motion: np.ndarray  #: v (freedoms,) of the body
    omega: np.ndarray  #: (driven,) [rad/s]
    slip_m_s: np.ndarray  #: s (driven,)
    torque_response: np.ndarray  #: dv/dtau, domega/dtau (freedoms + driven, driven) [1/(N m)]
    force_response: np.ndarray  #: dv/df, domega/df (freedoms + driven, driven) [1/N]
    #: (driven,) traction due to the part of the slip that exceeds F / k0, with the slope k0 at rest
    nonlinear_N: np.ndarray
    #: D (driven,), factor by which the ground reduces other changes of the slip; 1 where a wheel spins
    damping: np.ndarray


def slip_step(parts: Parts, u: RobotInput, p: Scene, dt_s: Any, start_m_s: np.ndarray | None = None) -> SlipStep:
    """Body and wheels after `dt_s` of constant current; `u.grade_rad` is that of the step.

    start_m_s: (driven,) slip near the one that balances; without it Newton starts at the slip before the step.
    """
    robot = p.robot
    G, M, J_w = robot.rolling[: robot.driven], robot.inertia[: robot.freedoms], robot.inertia[robot.freedoms :]
    r = robot.wheel.radius_m * parts.radius_ratio
    load_N = normal_loads(u, robot, np.zeros(2))

    v, omega = step_without_traction(parts, u, p, dt_s, load_N)
    body_gain, wheel_gain = (G / M).T, dt_s / J_w
    A = dt_s * ((G / M) @ G.T) + np.diag(r**2 * wheel_gain)
    if start_m_s is None:
        start, steps = r * parts.omega - G @ parts.motion, SLIP_STEPS
    else:
        start, steps = start_m_s, FINISHING_STEPS
    s, F, k, k0 = balance_slip(r * omega - G @ v, A, start, steps, parts, load_N, p)

    D = 1.0 + np.diag(A) * k
    dF_dtau = k * r * wheel_gain / D
    return SlipStep(
        motion=v + dt_s * (body_gain @ F),
        omega=omega - r * wheel_gain * F,
        slip_m_s=s,
        torque_response=np.vstack([dt_s * (body_gain * dF_dtau), np.diag(wheel_gain * (1.0 - r * dF_dtau))]),
        force_response=np.vstack([dt_s * (body_gain / D), np.diag(-r * wheel_gain / D)]),
        nonlinear_N=k * (s - F / k0),
        damping=D,
    )


def step_without_traction(
    parts: Parts, u: RobotInput, p: Scene, dt_s: Any, load_N: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """v* (freedoms,) and omega* (driven,): the end of the step, explicit, if the ground gave no traction."""
    x = np.concatenate([parts.motion, parts.omega])
    x = x + dt_s * momentum_rates(x, u, p, without_traction(parts, u, p, load_N)) / p.robot.inertia
    return x[: p.robot.freedoms], x[p.robot.freedoms :]


def without_traction(parts: Parts, u: RobotInput, p: Scene, load_N: np.ndarray) -> Forces:
    """Forces on body and wheels except the traction of the driven wheels; load_N: (wheels,)."""
    x = np.concatenate([parts.motion, parts.omega])
    f = forces_at(x, u, p, load_N, np.zeros(p.robot.driven))
    return f._replace(rolling_N=parts.rolling_ratio * f.rolling_N)


def balance_slip(
    free_slip: np.ndarray, A: np.ndarray, start: np.ndarray, steps: int, parts: Parts, load_N: np.ndarray, p: Scene
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Slip s of s + A F(s) = free_slip after these Newton steps, F(s), slope k = dF/ds there, and k0 without slip.

    All (driven,), slopes in N s/m and >= 0; A in m/(N s). F is the law's, so never more than the ground can give.
    """
    a = np.diag(A)
    _, rest_slope = traction_and_slope(np.zeros(len(start)), parts, load_N, p)
    bound = free_slip / (1.0 + a * rest_slope)
    forward = np.array([b >= 0 for b in bound])
    s = start
    for _ in range(steps):
        F, k = traction_and_slope(s, parts, load_N, p)
        s = s - (s + A @ F - free_slip) / (1.0 + a * k)
        s = where(forward, maximum(s, bound), minimum(s, bound))
    return s, *traction_and_slope(s, parts, load_N, p), rest_slope


def traction_and_slope(
    slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene
) -> tuple[np.ndarray, np.ndarray]:
    """Traction F (driven,) [N] and its slope dF/ds (driven,) [N s/m], which is set to 0 where it is negative."""
    F, J = linearize(lambda s: traction(s, parts, load_N, p), slip_m_s)
    return F, maximum(np.diag(J), 0.0)


def traction(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """Traction F (driven,) [N] of the ground at these slip speeds (driven,)."""
    travel = p.robot.rolling @ parts.motion
    scaled = parts.stiffness / parts.friction * slip_m_s
    contacts = [Contact(s, v + s, v, N) for s, v, N in zip(scaled, travel, load_N, strict=False)]
    return parts.friction * np.array([t.traction.force_N(c) for t, c in zip(p.terrains, contacts, strict=False)])


def grip(slip_m_s: np.ndarray, parts: Parts, load_N: np.ndarray, p: Scene) -> np.ndarray:
    """Slope dF/ds at this slip over that at none (driven,): 1 for a wheel that grips, 0 for one that spins."""
    _, slope = traction_and_slope(slip_m_s, parts, load_N, p)
    _, rest_slope = traction_and_slope(np.zeros(len(slip_m_s)), parts, load_N, p)
    return slope / rest_slope
