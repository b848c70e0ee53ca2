import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmward.traction import RobotInput, forces, scene
from ohmward.traction.dynamics.forces import EnergyBalance, kinetic_energy, momentum_rates, power
from traction.examples import HARD, ROBOTS, TERRAINS


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("ground", TERRAINS)
@settings(max_examples=40)
@given(seed=st.integers(0, 2**31), grade=st.floats(-0.3, 0.3), bank=st.floats(-0.3, 0.3), drawbar=st.floats(-50, 50))
def test_in_every_state_losses_are_losses_and_the_balance_closes(name, ground, seed, grade, bank, drawbar):
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    x = rng.normal(0, rng.uniform(0, 5), len(robot.state_names))
    u = RobotInput(rng.normal(0, 5, robot.driven), grade, bank if robot.freedoms == 3 else 0.0, drawbar)
    p = scene(robot, TERRAINS[ground])
    f = forces(x, u, p)
    w = power(x, u, p, f)
    assert min(w.copper, w.drive, w.slip, w.rolling) >= 0.0
    kinetic = momentum_rates(x, u, p, f) @ x
    spent = w.losses + w.climb + w.drawbar + kinetic
    rounding = 1e-12 * (abs(kinetic) + w.losses + abs(w.climb))
    assert w.electrical == pytest.approx(spent, rel=1e-12, abs=rounding)
    assert w.kinetic == kinetic
    assert w.battery == w.electrical + robot.idle_W
    assert w.residual == pytest.approx(0.0, abs=rounding + 1e-12 * abs(w.battery))


def test_climbing_lifts_the_weight():
    robot = ROBOTS["front-driven"]
    x, u = np.array([0.5, 0.0, 0.5 / 0.12, 0.5 / 0.12]), RobotInput(np.zeros(2), grade_rad=0.1)
    p = scene(robot, HARD)
    w = power(x, u, p, forces(x, u, p))
    assert w.climb == pytest.approx(42.0 * 9.80665 * 0.5 * np.sin(0.1))


@pytest.mark.parametrize("slip_ratio", [0.12, -0.18])
def test_the_wheels_power_is_pull_and_slip(slip_ratio):
    # driving P = tau v / (r (1 - lambda)), braking P = tau v (1 + lambda) / r, in a steady state
    robot, v, r = ROBOTS["front-driven"], 0.5, 0.12
    omega = v / (r * (1 - slip_ratio)) if slip_ratio > 0 else v * (1 + slip_ratio) / r
    x = np.array([v, 0.0, omega, omega])
    p = scene(robot, HARD)
    f = forces(x, RobotInput(np.zeros(2)), p)
    torque = r * f.traction_N[0]
    u = RobotInput(np.full(2, torque / 0.517))
    w = power(x, u, p, forces(x, u, p))
    at_wheel = torque * v / (r * (1 - slip_ratio)) if slip_ratio > 0 else torque * v * (1 + slip_ratio) / r
    assert w.electrical - w.copper == pytest.approx(2 * at_wheel)
    assert 2 * at_wheel == pytest.approx(2 * f.traction_N[0] * v + w.slip)


def test_kinetic_energy_by_hand():
    robot = ROBOTS["all driven"]
    x = np.array([0.5, 0.2, 1.0, 2.0, 3.0, 4.0])
    by_hand = 0.5 * 42.0 * 0.25 + 0.5 * robot.yaw_inertia_kg_m2 * 0.04 + 0.5 * 0.0108 * (1 + 4 + 9 + 16)
    assert kinetic_energy(x, robot.inertia) == pytest.approx(by_hand)


def test_steps_accumulate_term_by_term():
    step = EnergyBalance(battery=5.0, electrical=4.0, idle=1.0, copper=3.0, kinetic=0.5)
    total = EnergyBalance().accumulate(step).accumulate(step)
    assert total == EnergyBalance(battery=10.0, electrical=8.0, idle=2.0, copper=6.0, kinetic=1.0)
    assert (total.losses, total.residual) == (6.0, 1.0)
