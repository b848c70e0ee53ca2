from dataclasses import replace

import numpy as np
import pytest

from ohmward.energy.consumption import energy_demand, start, with_terrain
from ohmward.energy.consumption_prior import heat_W_per_N2, prior_from_mass, prior_from_robot, slip_W_per_N2
from ohmward.energy.leg import Leg, stretch_of
from ohmward.errors import InputError
from ohmward.traction import RLMA, RobotInput, forces, hard_terrain, scene
from ohmward.traction.dynamics.forces import power
from ohmward.traction.terrain.floor import STIFFNESS, STIFFNESS_STD
from traction.examples import LOSSY

ROBOT = replace(RLMA, idle_W=12.0)


def test_windings_heat_as_the_model_of_the_robot_says():
    # at constant speed up a slope both front wheels pull alike
    p, motion = scene(ROBOT, hard_terrain("dry asphalt")), np.array([0.5, 0.0])
    current_A = np.full(2, 3.0)
    pull_N = 2 * 3.0 * 0.517 / 0.12
    x = np.concatenate([motion, ROBOT.rolling[:2] @ motion / 0.12])
    copper_W = power(x, RobotInput(current_A), p, forces(x, RobotInput(current_A), p)).copper
    assert heat_W_per_N2(ROBOT) * pull_N**2 == pytest.approx(copper_W)


def test_a_metre_on_asphalt_is_of_the_right_order():
    prior = prior_from_robot(ROBOT)
    c = with_terrain(start(prior), "asphalt")
    found = energy_demand(c, [stretch_of(Leg(1.0, "asphalt", 0.5))])
    resistance_N = 0.02 * 42 * 9.80665
    drag_J = 0.02 * 42 * 9.80665 * 0.5 / 0.9
    heat_W = (heat_W_per_N2(ROBOT) + slip_W_per_N2(42 * 9.80665)[0]) * (resistance_N + 0.9 * drag_J) ** 2
    assert found.mean_J == pytest.approx(12.0 / 0.5 + resistance_N / 0.9 + drag_J + heat_W / 0.5)
    assert 0.1 * found.mean_J < found.std_J < found.mean_J


def test_motors_that_nobody_described_heat_as_any():
    prior = prior_from_mass(42.0)
    known = prior_from_robot(ROBOT)
    assert abs(prior.heat_W_per_N2 - known.heat_W_per_N2) < 2 * prior.heat_std_W_per_N2
    assert prior.heat_std_W_per_N2 > known.heat_std_W_per_N2


def test_slip_is_that_of_any_floor():
    mean, std = slip_W_per_N2(400.0)
    C = np.exp(np.log(STIFFNESS) + STIFFNESS_STD * np.random.default_rng(1).standard_normal(200_000))
    assert mean == pytest.approx(np.mean(1 / (C * 400.0)), rel=0.01)
    assert std == pytest.approx(np.std(1 / (C * 400.0)), rel=0.02)


def test_losses_of_the_gear_raise_the_price_of_a_climb():
    assert prior_from_robot(replace(ROBOT, motor=LOSSY)).climb == pytest.approx(1 / (0.8 * 0.9))


def test_an_idle_power_that_nobody_said_is_any():
    assert prior_from_mass(40.0).idle_std_W == prior_from_mass(40.0).idle_W == 10.0
    assert prior_from_mass(40.0, 20.0).idle_std_W == pytest.approx(6.0)


def test_a_mass_that_is_none():
    with pytest.raises(InputError, match="mass_kg must be > 0"):
        prior_from_mass(0.0)
