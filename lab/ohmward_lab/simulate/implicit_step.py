"""One step of a robot on the ground, implicit because wheels are stiff.

A gripping wheel settles with the time constant J_w / (r^2 N C1 C2), 0.5 ms for a robot of 42 kg; an explicit step has
to be shorter. Here every stage solves X = base + h rate(X), so a step of 10 ms is as stable as one of 10 us. Two
methods, both L-stable: they forget the stiff part instead of ringing.

EULER       order 1, one stage. Its numerical loss is >= 0: discrete time is passive too.
ALEXANDER   order 2, two stages, gamma = 1 - 1/sqrt(2) (Alexander 1977, SDIRK2).

Newton's method alone can oscillate for ever between the flat ends of a saturating law. So every stage starts with a few
chord steps: the force is assumed proportional to the slip, with the factor of the last step. The factor falls with the
slip, so these steps cannot overshoot (they minimise a bound of the stage's energy), though they may be slow; Newton
then finishes. The number of steps is fixed, so that the whole step is a fixed sequence of operations; `Step.defect_m_s`
is the remaining error.

A law that falls beyond its peak makes a wheel bistable: with h r^2 N |dF/ds| / J_w > 1 a stage has more than one
solution, and none is preferable. Then the step must be shorter (for a peak at 0.1 m/s: 3 ms EULER, 10 ms ALEXANDER).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import linearize, maximum
from ohmward.traction.dynamics.forces import (
    LOAD_PASSES,
    EnergyBalance,
    RobotInput,
    Scene,
    force_on_plane,
    forces_at,
    grips,
    kinetic_energy,
    momentum_rates,
    normal_loads,
    power,
)
from ohmward.traction.robot.robot import Robot

CHORD_STEPS = 4
NEWTON_STEPS = 5


class Method(NamedTuple):
    """A diagonally implicit Runge-Kutta method whose last stage is the result."""

    order: int  #: of convergence
    rows: tuple[tuple[float, ...], ...]  #:  of the coefficients, lower triangle


_GAMMA = 1 - 1 / math.sqrt(2)
EULER = Method(1, ((1.0,),))
ALEXANDER = Method(2, ((_GAMMA,), (1 - _GAMMA, _GAMMA)))


class Step(NamedTuple):
    """End of a step."""

    state: np.ndarray  #:      (n,) as `Robot.state_names`
    #:     balance [J] of the step. Losses are integrated over the stages, so that none is negative; `numerical`, the
    #: loss of the method itself, is of the order of the step to the power of the order of the method.
    energy: EnergyBalance
    #: largest error that Newton left in a stage, as a speed at the rim; large only if the ground's law falls so steeply
    #: that the step must be shorter
    defect_m_s: Any


def next_state(x: np.ndarray, u: RobotInput, p: Scene, dt_s: Any, method: Method = ALEXANDER) -> np.ndarray:
    """State after `dt_s` of constant input, (n,)."""
    return step(x, u, p, dt_s, method).state


def step(
    x: np.ndarray, u: RobotInput, p: Scene, dt_s: Any, method: Method = ALEXANDER, newton_steps: int = NEWTON_STEPS
) -> Step:
    """State after `dt_s` of constant input, with the energy balance of the step.

    x: (n,) as `Robot.state_names`.  dt_s: >= 0.
    """
    gains: list[np.ndarray] = []
    powers: list[EnergyBalance] = []
    defect: Any = 0.0
    for row in method.rows:
        base = x + sum(a / r[-1] * gain for a, r, gain in zip(row, method.rows, gains, strict=False))
        stage, load_N = solve_stage(base, row[-1] * dt_s, u, p, newton_steps)
        f = forces_at(stage, u, p, load_N)
        excess = stage - base - row[-1] * dt_s * momentum_rates(stage, u, p, f) / p.robot.inertia
        gains.append(stage - base)
        powers.append(power(stage, u, p, f))
        defect = maximum(defect, _largest(excess, p.robot))
    energy = integrate(powers, method, dt_s)._replace(
        kinetic=kinetic_energy(stage, p.robot.inertia) - kinetic_energy(x, p.robot.inertia),
        numerical=numerical_loss(gains, method, p.robot),
    )
    return Step(stage, energy, defect)


def integrate(powers: Sequence[EnergyBalance], method: Method, dt_s: Any) -> EnergyBalance:
    """Energies [J] of a step from the powers [W] at its stages: sum of b_i dt P_i."""
    weights_s = [b * dt_s for b in method.rows[-1]]
    terms = zip(*powers, strict=True)
    return EnergyBalance(*(sum(w * P for w, P in zip(weights_s, term, strict=True)) for term in terms))


def solve_stage(
    base: np.ndarray, h_s: Any, u: RobotInput, p: Scene, newton_steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """X (n,) of X = base + h rate(X), and the loads (wheels,) there.

    Loads follow the forces between iterations, but not in the Jacobian, and are fixed in the last ones: X is exact for
    these loads.
    """
    robot = p.robot
    load_N = normal_loads(u, robot, np.zeros(2))

    def residual(X: np.ndarray, grip: np.ndarray | None = None) -> np.ndarray:
        return X - base - h_s * momentum_rates(X, u, p, forces_at(X, u, p, load_N, grip)) / robot.inertia

    X = base
    for k in range(CHORD_STEPS + newton_steps):
        grip = grips(X, u, p, load_N) if k < CHORD_STEPS else None
        value, J = linearize(partial(residual, grip=grip), X)
        X = X - solve(J, value)
        if robot.height_m and k < LOAD_PASSES:
            load_N = normal_loads(u, robot, force_on_plane(forces_at(X, u, p, load_N), robot))
    return X, load_N


def solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """X of A X = b, (n,), by elimination from the last row upwards, without pivoting.

    The wheels stand last and do not act on each other, so they are eliminated first and leave no new entries.
    """
    A, b = A.copy(), b.copy()
    n = len(b)
    for k in range(n - 1, 0, -1):
        factors = A[:k, k] / A[k, k]
        A[:k, :k] = A[:k, :k] - np.outer(factors, A[k, :k])
        b[:k] = b[:k] - factors * b[k]
    for k in range(n):
        b[k] = (b[k] - A[k, :k] @ b[:k]) / A[k, k]
    return b


def numerical_loss(gains: list[np.ndarray], method: Method, robot: Robot) -> Any:
    """Energy [J] that the method itself takes: half of sum m_ij k_i M k_j, m_ij = b_i a_ij + b_j a_ji - b_i b_j.

    With the powers taken at the stages this closes the balance exactly (Burrage and Butcher's algebraic stability).
    """
    b, rows = method.rows[-1], method.rows
    total: Any = 0.0
    for i, row in enumerate(rows):
        for j in range(i + 1):
            m = b[i] * row[j] + (b[i] * row[j] if i == j else 0.0) - b[i] * b[j]
            pair = 0.5 * m if i == j else m
            total = total + pair / (rows[i][-1] * rows[j][-1]) * (robot.inertia @ (gains[i] * gains[j]))
    return total


def _largest(excess: np.ndarray, robot: Robot) -> Any:
    """The largest entry as a speed at the rim [m/s]; motions of the body count as they are."""
    rim = np.concatenate([np.ones(robot.freedoms), np.full(robot.driven, robot.wheel.radius_m)])
    return reduce(maximum, abs(rim * excess), 0.0)
