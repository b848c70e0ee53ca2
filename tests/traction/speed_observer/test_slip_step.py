from typing import NamedTuple

import numpy as np
import pytest

from ohmward.trace import Kernel
from ohmward.traction import RobotInput, Terrain, scene
from ohmward.traction.friction.law import WardIagnemma
from ohmward.traction.speed_observer.slip_step import grip, slip_step, traction, traction_and_slope
from ohmward.traction.speed_observer.states import KNOWN_GROUND, StateLayout, States
from ohmward_lab.simulate.implicit_step import EULER
from traction.examples import plant

from .examples import FLOOR, LOW, SCENES


def step_of(place, dt_s=0.01, states=KNOWN_GROUND):
    layout = StateLayout(place.robot, states)

    def one(x, current_A):
        step = slip_step(layout.split(x), RobotInput(current_A), place, dt_s)
        return np.concatenate([step.motion, step.omega])

    n = place.robot.freedoms + place.robot.driven
    return Kernel(one, np.zeros(n), np.zeros(place.robot.driven)), n


@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_implicit_euler_step_while_the_wheels_grip(name):
    place = SCENES[name]
    one, n = step_of(place)
    ours, reference = np.zeros(n), np.zeros(n)
    current = np.linspace(0.6, 1.0, place.robot.driven)
    for _ in range(30):
        ours = one(ours, current)
        reference, _ = plant(place, method=EULER)(reference, current)
    assert ours == pytest.approx(reference, rel=0.06, abs=5e-3)  # rolling resistance sets in explicitly
    assert np.abs(reference).max() > 0.3


def test_into_full_spin_and_back_it_keeps_the_speed_of_the_body():
    place = SCENES["front-driven"]
    one, n = step_of(place)
    ours, reference = np.zeros(n), np.zeros(n)
    for current in np.repeat([3.0, 20.0, -20.0, 2.0], 20):
        ours = one(ours, np.full(2, current))
        reference, _ = plant(place, method=EULER)(reference, np.full(2, current))
        assert ours[0] == pytest.approx(reference[0], abs=0.006)
    assert ours[2:] == pytest.approx(reference[2:], abs=0.02)


def test_a_steady_wheel_has_the_slip_that_its_force_needs():
    place = SCENES["front-driven"]
    one, n = step_of(place)
    x = np.zeros(n)
    for _ in range(100):
        before, x = x, one(x, np.full(2, 3.0))
    robot, faster_rad_s2 = place.robot, (x[2] - before[2]) / 0.01
    force_N = (3.0 * robot.motor.wheel_constant_Nm_per_A - robot.inertia[2] * faster_rad_s2) / 0.12
    load_N = robot.loads[0, 0] * robot.mass_kg * 9.80665
    assert 0.12 * x[2] - x[0] == pytest.approx(-np.log(1.0 - force_N / (0.7 * load_N)) / 20.0, rel=0.02)


def test_no_step_is_too_long_and_none_goes_nowhere():
    place = SCENES["front-driven"]
    x = np.array([0.5, 0.1, 6.0, 3.0])
    still, _ = step_of(place, dt_s=0.0)
    assert still(x, np.full(2, 3.0)) == pytest.approx(x, abs=1e-12)
    long, _ = step_of(place, dt_s=0.2)
    for _ in range(20):
        x = long(x, np.zeros(2))
    assert np.abs(x).max() < 6.0
    assert 0.12 * x[2:] == pytest.approx(place.robot.rolling[:2] @ x[:2], abs=1e-3)


@pytest.mark.parametrize(("current_A", "omega"), [(2.0, 2.6), (20.0, 15.0)])
def test_the_response_to_torque_is_the_derivative(current_A, omega):
    place = SCENES["front-driven"]
    parts = StateLayout(place.robot, KNOWN_GROUND).split(np.array([0.3, 0.0, omega, omega]))
    constant = place.robot.motor.wheel_constant_Nm_per_A

    def after(extra_Nm):
        return slip_step(parts, RobotInput(np.array([current_A + extra_Nm / constant, current_A])), place, 0.01)

    high, low = after(0.05), after(-0.05)
    change = np.concatenate([high.motion - low.motion, high.omega - low.omega]) / 0.1
    assert after(0.0).torque_response[:, 0] == pytest.approx(change, rel=0.1, abs=0.01)


def test_friction_scales_the_height_and_stiffness_the_slope():
    place = SCENES["front-driven"]
    layout = StateLayout(place.robot, States(grade=False, rolling=False, radius=False))
    load = np.full(4, 100.0)
    weak = layout.split(np.array([0.0, 0.0, 0.0, 0.0, np.log(0.5), np.log(2.0)]))
    assert traction(np.full(2, 5.0), weak, load, place) == pytest.approx(35.0)
    assert traction_and_slope(np.zeros(2), weak, load, place)[1] == pytest.approx(2.0 * 100.0 * 0.7 * 20.0)


def test_grip_is_one_at_rest_and_none_in_spin():
    place = SCENES["front-driven"]
    parts = StateLayout(place.robot, KNOWN_GROUND).split(np.zeros(4))
    found = grip(np.array([0.05, 1.0]), parts, np.full(4, 100.0), place)
    assert found == pytest.approx([np.exp(-1.0), 0.0], abs=1e-6)


@pytest.mark.parametrize(("current_A", "travel"), [(2.0, 0.3), (15.0, 0.3), (-15.0, 0.3), (40.0, 0.0)])
def test_from_the_end_of_their_mean_sigma_points_reach_the_balance(current_A, travel, monkeypatch):
    place = SCENES["front-driven"]
    layout, rng = StateLayout(place.robot, KNOWN_GROUND), np.random.default_rng(0)
    x, u = np.array([travel, 0.0, travel / 0.12, travel / 0.12]), RobotInput(np.full(2, current_A))
    start = slip_step(layout.split(x), u, place, 0.01).slip_m_s
    points = x + np.array([0.01, 0.05, 0.1, 0.1]) * rng.standard_normal((20, 4))
    found = np.array([slip_step(layout.split(p), u, place, 0.01, start).slip_m_s for p in points])
    monkeypatch.setattr("ohmward.traction.speed_observer.slip_step.SLIP_STEPS", 50)
    exact = np.array([slip_step(layout.split(p), u, place, 0.01).slip_m_s for p in points])
    assert np.ptp(exact) > 1e-3
    assert found == pytest.approx(exact, abs=1e-4)


class WithForce(NamedTuple):
    """The floor's law with a force besides."""

    besides_N: float

    def force_N(self, contact):
        return FLOOR.traction.force_N(contact) + self.besides_N


def step_on(place, x, current_A):
    return slip_step(StateLayout(place.robot, KNOWN_GROUND).split(x), RobotInput(current_A), place, 0.01)


@pytest.mark.parametrize("current_A", [2.0, 8.0, 20.0])
def test_what_a_force_besides_the_law_does_to_body_and_wheels(current_A):
    x, current, besides_N = np.array([0.3, 0.0, 2.6, 2.6]), np.full(2, current_A), 0.01
    step = step_on(SCENES["front-driven"], x, current)
    other = step_on(scene(LOW, Terrain("disturbed", WithForce(besides_N), FLOOR.rolling, "tests")), x, current)
    change = np.concatenate([other.motion - step.motion, other.omega - step.omega]) / besides_N
    assert step.force_response @ np.ones(2) == pytest.approx(change, rel=0.12, abs=1e-6)  # Newton has not ended


def test_the_nonlinear_traction_is_that_of_the_slip_beyond_a_straight_law():
    x = np.array([0.3, 0.0, 3.2, 3.2])
    step = step_on(SCENES["front-driven"], x, np.full(2, 8.0))
    law, s = FLOOR.traction, step.slip_m_s[0]
    assert isinstance(law, WardIagnemma)
    load_N = LOW.mass_kg * 9.80665 / 4
    beyond_m_s = s - -np.expm1(-law.c2_s_per_m * s) / law.c2_s_per_m
    slope = load_N * law.c1 * law.c2_s_per_m * np.exp(-law.c2_s_per_m * s)
    assert s > 0.02
    assert step.nonlinear_N == pytest.approx(np.full(2, slope * beyond_m_s), rel=1e-6)
