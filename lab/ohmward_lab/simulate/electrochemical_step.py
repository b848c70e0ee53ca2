"""One implicit time step of a discretised PyBaMM model, compiled by CasADi.

Once discretised in space, a porous-electrode model is a system of differential and algebraic equations

x' = f(x, z, u),   0 = g(x, z, u),   V = h(x, z, u),

x: concentrations and temperature; z: potentials; u: current and ambient temperature. A solver of variable order stops
at each of the ten thousand changes of current of a drive and starts again with tiny steps, some 5 ms each. Here each
interval of constant current is one step of a stiffly accurate, L-stable Runge-Kutta method of second order (Alexander
1977, SIAM J. Numer. Anal. 14, SDIRK2):

y1 = y + gamma h f(y1),   y+ = y + (1 - gamma) h f(y1) + gamma h f(y+),   gamma = 1 - 1 / sqrt(2),

g = 0 in both; Newton's method solves the stages, with one matrix for both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.optional import require

_GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
#: Iterations of each stage; two more change the voltage of a drive at 5 degC by less than 0.001 mV (Prada2013).
_SIMPLE_STEPS = 2
#: Iterations before those, with the matrix of the present guess, where potentials follow the current at once (Butler-
#: Volmer): more of them change the voltage at a jump of 3 C by less than 0.1 mV (Chen2020, DFN).
_FULL_STEPS = 3


class CellEquations(NamedTuple):
    """CasADi expressions of a model: x, z, u as symbols, f, g, and the outputs voltage [V] and temperature [K]."""

    x: Any
    z: Any
    u: Any
    f: Any
    g: Any
    outputs: Any


class VoltageLimits(NamedTuple):
    """Lowest and highest voltage [V] of one cell that protection and charger keep to."""

    low_V: float
    high_V: float


def step_function(equations: CellEquations, limits: VoltageLimits) -> Any:
    """CasADi function (y, inputs) -> (y+, outputs) of one step.

    y: x, z, the last current [A, > 0 discharges] and the last voltage [V].
    inputs: length of the step [s], demanded current [A, > 0 discharges], ambient temperature [K].
    outputs: current [A], voltage [V], temperature [K] at the end of the step.
    """
    ca = require("casadi", "simulated electrochemical cells")
    symbols = [ca.vertcat(equations.x, equations.z), equations.u]
    residual = ca.Function("residual", symbols, [ca.vertcat(equations.f, equations.g)])
    outputs = ca.Function("outputs", symbols, [equations.outputs])
    slope = ca.Function("slope", symbols, [ca.jacobian(residual(*symbols), symbols[0])])
    effect = ca.Function(
        "effect",
        symbols,
        [
            ca.jacobian(residual(*symbols), symbols[1])[:, 0],
            ca.jacobian(outputs(*symbols)[0], symbols[0]),
            ca.jacobian(outputs(*symbols)[0], symbols[1])[:, 0],
        ],
    )
    return _one_step(ca, (residual, outputs, slope, effect), (equations.x.numel(), equations.z.numel()), limits)


def _one_step(ca: Any, functions: tuple[Any, ...], sizes: tuple[int, int], limits: VoltageLimits) -> Any:
    residual, outputs, slope, effect = functions
    total = sum(sizes)
    mass = ca.sparsify(ca.diag(ca.DM([1.0] * sizes[0] + [0.0] * sizes[1])))
    kind = ca.SX if _expands(residual, slope, effect) else ca.MX
    state, inputs = kind.sym("state", total + 2), kind.sym("inputs", 3)
    y, last_A, last_V = state[:total], state[total], state[total + 1]
    h, demand_A, ambient_K = inputs[0], inputs[1], inputs[2]

    def solver(y: Any, u: Any) -> Any:
        return _solver(ca, kind, mass - _GAMMA * h * slope(y, u))

    before = ca.vertcat(last_A, ambient_K)
    solve = solver(y, before)
    # dV/di over the step: directly, and through the states that follow the current at once.
    by_current, by_state, directly = effect(y, before)
    ohm = directly + by_state @ solve(_GAMMA * h * by_current)
    current_A = _within_limits(
        ca, demand_A, last_A + (limits.low_V - last_V) / ohm, last_A + (limits.high_V - last_V) / ohm
    )
    u = ca.vertcat(current_A, ambient_K)

    def newton(Y: Any, base: Any, solve: Any) -> Any:
        """One step towards the root of mass (Y - base) = gamma h F(Y)."""
        return Y + solve(mass @ (base - Y) + _GAMMA * h * residual(Y, u))

    first = y
    for _ in range(_FULL_STEPS if sizes[1] else 0):
        solve = solver(first, u)
        first = newton(first, y, solve)
    for _ in range(_SIMPLE_STEPS):
        first = newton(first, y, solve)
    base = y + (1.0 - _GAMMA) * h * mass @ residual(first, u)
    after = first
    for _ in range(_SIMPLE_STEPS):
        after = newton(after, base, solve)
    terminal = outputs(after, u)
    return ca.Function(
        "step", [state, inputs], [ca.vertcat(after, current_A, terminal[0]), ca.vertcat(current_A, terminal)]
    )


def _within_limits(ca: Any, demand_A: Any, at_low_A: Any, at_high_A: Any) -> Any:
    """The demanded current, reduced where it would exceed a voltage limit; > 0 discharges."""
    discharge_A = ca.fmin(demand_A, ca.fmax(at_low_A, 0.0))
    charge_A = ca.fmax(demand_A, ca.fmin(at_high_A, 0.0))
    return ca.if_else(demand_A > 0, discharge_A, charge_A)


def _expands(*functions: Any) -> bool:
    """True where every function consists of scalar operations, without look-up tables."""
    try:
        for function in functions:
            function.expand()
    except RuntimeError:
        return False
    return True


def _solver(ca: Any, kind: Any, matrix: Any) -> Any:
    """The function b -> matrix^-1 b; scalar expressions are factored once."""
    if kind is ca.MX:
        return lambda b: ca.solve(matrix, b, "csparse")
    order = minimum_degree_order(matrix.sparsity())
    lower, upper = _factors(matrix, order)

    def solve(b: Any) -> Any:
        x = [b[row] for row in order]
        for k, column in enumerate(lower):
            for i, factor in column.items():
                x[i] = x[i] - factor * x[k]
        for k in reversed(range(len(x))):
            for j, value in upper[k].items():
                if j > k:
                    x[k] = x[k] - value * x[j]
            x[k] = x[k] / upper[k][k]
        solution = ca.SX(len(order), 1)
        for place, row in enumerate(order):
            solution[row] = x[place]
        return solution

    return solve


def minimum_degree_order(sparsity: Any) -> list[int]:
    """Order of elimination in which the row and column with fewest neighbours comes first: little fill-in."""
    neighbours: list[set[int]] = [set() for _ in range(sparsity.size1())]
    for i, j in zip(*sparsity.get_triplet(), strict=True):
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    left, order = set(range(len(neighbours))), []
    while left:
        k = min(left, key=lambda row: (len(neighbours[row]), row))
        left.remove(k)
        order.append(k)
        for i in neighbours[k]:
            neighbours[i] = (neighbours[i] | neighbours[k]) - {i, k}
    return order


def _factors(matrix: Any, order: list[int]) -> tuple[list[dict[int, Any]], list[dict[int, Any]]]:
    """L (by column, below the diagonal) and U (by row) of the reordered matrix; pivots stay on the diagonal."""
    place = {row: k for k, row in enumerate(order)}
    rows: list[dict[int, Any]] = [{} for _ in order]
    for entry, (i, j) in enumerate(zip(*matrix.sparsity().get_triplet(), strict=True)):
        rows[place[i]][place[j]] = matrix.nz[entry]
    lower: list[dict[int, Any]] = [{} for _ in order]
    for k, pivot_row in enumerate(rows):
        for i in range(k + 1, len(rows)):
            if k not in rows[i]:
                continue
            factor = lower[k][i] = rows[i].pop(k) / pivot_row[k]
            for j, value in pivot_row.items():
                if j > k:
                    rows[i][j] = rows[i].get(j, 0.0) - factor * value
    return lower, rows
