from itertools import pairwise

import numpy as np
import pytest

ca = pytest.importorskip("casadi")

from ohmward_lab.simulate.electrochemical_step import (  # noqa: E402
    CellEquations,
    VoltageLimits,
    _solver,
    minimum_degree_order,
    step_function,
)


def linear_cell(kind=ca.SX):
    """x' = -x / 50 s + i / 1000, 0 = z - 2 x, V = 3 - z - 0.1 i: an RC pair behind a resistor."""
    x, z, u = kind.sym("x"), kind.sym("z"), kind.sym("u", 2)
    return CellEquations(x, z, u, -x / 50.0 + u[0] / 1000.0, z - 2.0 * x, ca.vertcat(3.0 - z - 0.1 * u[0], u[1]))


def run(step, dt_s, current_A, duration_s=100.0):
    state = np.array([0.0, 0.0, 0.0, 3.0])
    for _ in range(round(duration_s / dt_s)):
        state, outputs = (np.array(part).ravel() for part in step(state, [dt_s, current_A, 298.15]))
    return state, outputs


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_the_step_is_of_second_order_and_keeps_the_algebraic_equation(kind):
    step = step_function(linear_cell(kind), VoltageLimits(0.0, 5.0))
    exact = 0.05 * (1.0 - np.exp(-2.0))
    errors = []
    for dt_s in (20.0, 10.0, 5.0):
        state, outputs = run(step, dt_s, 1.0)
        errors.append(abs(state[0] - exact))
        assert state[1] == pytest.approx(2.0 * state[0], abs=1e-12)
        assert outputs[1] == pytest.approx(3.0 - 2.0 * state[0] - 0.1)
    assert all(3.5 < coarse / fine < 4.5 for coarse, fine in pairwise(errors))


def test_the_current_is_what_the_voltage_limits_leave():
    step = step_function(linear_cell(), VoltageLimits(2.9, 3.05))
    _, discharged = run(step, 1.0, 10.0)
    assert discharged[1] == pytest.approx(2.9, abs=2e-3) and 0.0 < discharged[0] < 1.1
    _, charged = run(step, 1.0, -10.0)
    assert charged[1] == pytest.approx(3.05, abs=2e-3) and -0.6 < charged[0] < 0.0


def test_the_sparse_factors_solve_the_system():
    rng = np.random.default_rng(0)
    size = 30
    dense = np.where(rng.random((size, size)) < 0.1, rng.standard_normal((size, size)), 0.0) + 5.0 * np.eye(size)
    b = rng.standard_normal(size)
    found = np.array(ca.DM(_solver(ca, ca.SX, ca.sparsify(ca.SX(dense)))(ca.SX(b)))).ravel()
    assert found == pytest.approx(np.linalg.solve(dense, b), abs=1e-12)


def test_a_hub_is_eliminated_last():
    # an arrow: everything is coupled to row 0, which would fill the matrix if it came first
    arrow = np.eye(6)
    arrow[0] = arrow[:, 0] = 1.0
    assert minimum_degree_order(ca.sparsify(ca.DM(arrow)).sparsity())[-2:].count(0) == 1
