"""The step: order, stiffness, energy, passivity. Reference is SciPy's Radau on the equations of motion."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ohmward.trace import Kernel
from ohmward.traction import RLMA, RobotInput, RollingResistance, Terrain, rates, scene
from ohmward.traction.dynamics.forces import kinetic_energy
from ohmward.traction.friction.law import CoulombCreep
from ohmward_lab.simulate.implicit_step import ALEXANDER, EULER, next_state, solve, step
from traction.examples import HARD, LOW, ROBOTS, SLIPPERY, TERRAINS

METHODS = {"euler": EULER, "alexander": ALEXANDER}
P = scene(LOW, HARD)


@cache
def stepper(robot="front-driven", ground="hard", method="alexander"):
    """Compiled step(state, (current, grade, drawbar, dt)) -> (state, (Step, kinetic energy))."""
    p = scene(ROBOTS[robot], TERRAINS[ground])
    n, driven = len(p.robot.state_names), p.robot.driven

    def one(x, sample):
        current, grade, drawbar, dt = sample
        result = step(x, RobotInput(current, grade, 0.0, drawbar), p, dt, METHODS[method])
        return result.state, (result, kinetic_energy(result.state, p.robot.inertia))

    return Kernel(one, np.zeros(n), (np.zeros(driven), 0.0, 0.0, 0.0))


@cache
def compiled_rates():
    return Kernel(lambda x, current: rates(x, RobotInput(current), P), np.zeros(4), np.zeros(2))


def reference(x, u, duration):
    f = compiled_rates()
    solution = solve_ivp(lambda _, x: f(x, u.current_A), (0.0, duration), x, "Radau", rtol=1e-9, atol=1e-11)
    return solution.y[:, -1]


def run(x, u, duration, steps, method="alexander"):
    dt = duration / steps
    return stepper(method=method).scan(x, (np.tile(u.current_A, (steps, 1)), 0.0, 0.0, np.full(steps, dt)))


@pytest.mark.parametrize("method, order, counts", [("euler", 1, (320, 640)), ("alexander", 2, (160, 320))])
def test_the_order_of_convergence(method, order, counts):
    # from inside the slow manifold, where the solution is smooth
    u, start = RobotInput(np.array([4.0, 2.5])), reference(np.zeros(4), RobotInput(np.array([4.0, 2.5])), 0.02)
    exact = reference(start, u, 0.4)
    errors = [abs(run(start, u, 0.4, n, method)[0] - exact)[0] for n in counts]
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.15)


@pytest.mark.parametrize("method, tolerance", [("euler", 0.02), ("alexander", 0.002)])
def test_ten_milliseconds_are_enough_though_the_wheels_settle_in_half_of_one(method, tolerance):
    u = RobotInput(np.array([3.0, 3.0]))
    for x in (np.zeros(4), np.array([0.5, 0.0, 0.0, 0.0]), np.array([0.0, 0.3, 20.0, -5.0])):
        end, _ = run(x, u, 1.0, 100, method)
        np.testing.assert_allclose(end * [1, 1, 0.12, 0.12], reference(x, u, 1.0) * [1, 1, 0.12, 0.12], atol=tolerance)


def test_explicit_steps_of_ten_milliseconds_blow_the_slip_up():
    x = np.array([0.5, 0.0, 0.501 / 0.12, 0.501 / 0.12])
    for _ in range(4):
        x = x + 0.01 * rates(x, RobotInput(np.zeros(2)), P)
    assert abs(0.12 * x[2] - x[0]) > 0.1  # from 0.001


@pytest.mark.parametrize("method", METHODS)
def test_on_a_linear_law_it_is_the_methods_own_function_of_the_matrix(method):
    frictionless = Terrain("creep", CoulombCreep(10.0, 14.0), RollingResistance(0.0, 1.0, 0.0), "tests")
    p, h = scene(LOW, frictionless), 0.01
    A = np.column_stack([rates(e, RobotInput(np.zeros(2)), p) for e in 1e-3 * np.eye(4)]) / 1e-3
    x = np.array([0.3, 0.1, 2.0, 3.0])
    gamma = 1 - 1 / np.sqrt(2)
    one, implicit = np.eye(4), np.linalg.inv(np.eye(4) - gamma * h * A)
    functions = {
        "euler": np.linalg.inv(one - h * A),
        "alexander": implicit @ (one + (1 - gamma) * h * A @ implicit),
    }
    found = next_state(x, RobotInput(np.zeros(2)), p, h, METHODS[method])
    np.testing.assert_allclose(found, functions[method] @ x, rtol=1e-9)


#: Each robot on two grounds, each ground under two or three robots: those of one state are tested on all.
PAIRS = [(robot, list(TERRAINS)[(k + n) % len(TERRAINS)]) for k, robot in enumerate(ROBOTS) for n in (0, 2)]


@pytest.mark.parametrize(("robot", "ground"), PAIRS)
def test_the_energy_balance_closes(robot, ground):
    rng, driven = np.random.default_rng(7), ROBOTS[robot].driven
    limit_A = 1.0 if robot == "omni" else 4.0
    current = np.repeat(rng.uniform(-limit_A, limit_A, (10, driven)), 20, axis=0)
    x = np.zeros(len(ROBOTS[robot].state_names))
    _, (result, kinetic) = stepper(robot, ground).scan(x, (current, 0.05, 5.0, np.full(200, 0.005)))
    energy = result.energy
    spent = energy.losses + energy.climb + energy.drawbar + energy.kinetic + energy.numerical
    throughput = np.sum(abs(energy.electrical) + energy.losses + abs(energy.kinetic))
    assert abs(np.sum(energy.electrical - spent)) <= 1e-9 * throughput
    assert np.sum(abs(energy.electrical - spent)) <= 1e-9 * throughput
    assert np.sum(abs(energy.residual)) <= 1e-9 * throughput
    assert np.sum(energy.kinetic) == pytest.approx(kinetic[-1], rel=1e-9)
    for loss in (energy.copper, energy.drive, energy.slip, energy.rolling):
        assert loss.min() >= 0.0
    assert abs(np.sum(energy.numerical)) < 0.01 * throughput
    assert result.defect_m_s.max() < 1e-6


@pytest.mark.parametrize("robot", ["front-driven", "front-driven, lossy, high", "omni"])
@pytest.mark.parametrize(
    "ground, longest_s", [("hard", 0.01), ("asphalt", 0.003)]
)  # the falling branch limits the step
@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), share=st.floats(0.01, 1.0))
def test_without_input_energy_only_falls(robot, ground, longest_s, seed, share):
    kernel, dt = stepper(robot, ground, "euler"), share * longest_s
    rng, p = np.random.default_rng(seed), ROBOTS[robot]
    x = rng.normal(0, 1, len(p.state_names)) * np.r_[np.ones(p.freedoms), np.full(p.driven, 5.0)]
    _, (result, kinetic) = kernel.scan(x, (np.zeros((20, p.driven)), 0.0, 0.0, np.full(20, dt)))
    everything = np.concatenate([[kinetic_energy(x, p.inertia)], kinetic])
    assert np.all(np.diff(everything) <= 1e-12 * everything[0])
    assert result.energy.numerical.min() >= 0.0


def test_the_numerical_part_vanishes_with_the_order():
    u = RobotInput(np.array([4.0, 2.5]))
    start = reference(np.zeros(4), u, 0.02)

    def numerical(method, n):
        return abs(np.sum(run(start, u, 0.4, n, method)[1][0].energy.numerical))

    assert numerical("euler", 80) / numerical("euler", 160) == pytest.approx(2.0, rel=0.1)
    assert numerical("alexander", 80) / numerical("alexander", 160) > 3.5


@pytest.mark.parametrize("start", [[0.0, 0.0, 30.0, 30.0], [0.8, 0.0, 0.0, 0.0], [0.5, -1.0, -20.0, 20.0]])
def test_spinning_and_locked_wheels_find_their_grip(start):
    _, (result, _) = run(np.array(start), RobotInput(np.zeros(2)), 2.0, 200)
    assert result.defect_m_s.max() < 1e-9
    v, yaw_rate, left, right = result.state[-1]
    assert 0.12 * left == pytest.approx(v - 0.15 * yaw_rate, abs=1e-3)
    assert 0.12 * right == pytest.approx(v + 0.15 * yaw_rate, abs=1e-3)


def test_no_time_no_change():
    x = np.array([0.3, 0.1, 4.0, 1.0])
    result = step(x, RobotInput(np.array([3.0, 1.0])), P, 0.0)
    np.testing.assert_array_equal(result.state, x)
    assert result.energy.electrical == 0.0
    assert result.energy.numerical == 0.0


@pytest.mark.parametrize("robot", ROBOTS)
def test_with_floats_it_is_the_compiled_step(robot):
    x = np.linspace(0.1, 0.4, len(ROBOTS[robot].state_names))
    current = np.linspace(1.0, 2.0, ROBOTS[robot].driven)
    compiled, _ = stepper(robot)(x, (current, 0.05, 1.0, 0.01))
    plain = next_state(x, RobotInput(current, 0.05, 0.0, 1.0), scene(ROBOTS[robot], HARD), 0.01)
    np.testing.assert_allclose(compiled, plain, rtol=1e-9, atol=1e-12)


def test_a_newton_that_was_cut_short_is_reported():
    x, u = np.array([0.0, 0.0, 30.0, 30.0]), RobotInput(np.zeros(2))
    assert step(x, u, scene(RLMA, SLIPPERY), 0.05, newton_steps=0).defect_m_s > 1e-4
    assert step(x, u, scene(RLMA, SLIPPERY), 0.05).defect_m_s < 1e-12


@given(seed=st.integers(0, 2**31), n=st.integers(1, 7))
def test_elimination_solves(seed, n):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(n, n)) + 4 * n * np.eye(n), rng.normal(size=n)
    kept = A.copy()
    np.testing.assert_allclose(solve(A, b), np.linalg.solve(A, b), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(A, kept)
