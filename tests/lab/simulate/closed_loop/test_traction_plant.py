"""Our plant: energy balance, ground, way and truth; the implicit step inside is tested in traction."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO, SkidSteer
from ohmward.traction.dynamics.forces import EnergyBalance
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate.closed_loop.traction_plant import TractionPlant, tilt
from ohmward_lab.simulate.ground import Grade, Patch

FLAT = replace(RLMA, height_m=0.0)
RLMA_HIGH = replace(RLMA, height_m=0.17)
SKID = replace(RLMA_HIGH, chassis=SkidSteer(0.314, 0.314, 0.30))
CREEP = Patch(friction=0.8, rolling=0.0)
ROBOTS = [RLMA_HIGH, *(pytest.param(robot, marks=pytest.mark.slow) for robot in (SKID, ROBOTINO))]


def drive(plant, torque_Nm, duration_s, dt_s=1e-3):
    """The last truth, and the energy balance of the whole drive."""
    total = EnergyBalance()
    for _ in range(round(duration_s / dt_s)):
        truth = plant.step(torque_Nm, dt_s)
        total = total.accumulate(plant.energy)
    return truth, total


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: f"{r.name} {type(r.chassis).__name__}")
def test_the_energy_balance_closes(robot):
    plant = TractionPlant(robot, [CREEP, Patch(friction=0.15, from_m=0.05, to_m=0.2)], Grade((0.0, 0.3), (0.0, 0.06)))
    torque = np.linspace(2.0, 3.0, robot.driven) if robot is not ROBOTINO else np.array([0.4, 0.0, -0.5])
    _, energy = drive(plant, torque, 0.6)
    assert abs(energy.residual) <= 1e-9 * energy.electrical
    assert min(energy.copper, energy.slip) > 0.0
    assert abs(energy.numerical) < 1e-3 * energy.electrical


def test_newton_without_slip_or_rolling():
    """Gripping hard: torque over radius accelerates the mass and the wheels."""
    plant = TractionPlant(FLAT, [Patch(friction=3.0, slip_stiffness_s_per_m=1e4, rolling=0.0)])
    truth, _ = drive(plant, 1.0, 1.0)
    spinning_kg = 4 * RLMA.wheel.inertia_kg_m2 / RLMA.wheel.radius_m**2
    assert truth.speed_m_s == pytest.approx(2.0 / 0.12 / (42.0 + spinning_kg), rel=1e-3)
    assert truth.position_m[0] == pytest.approx(0.5 * truth.speed_m_s, rel=2e-3)
    assert truth.wheel_angle_rad == pytest.approx(np.full(4, truth.position_m[0] / 0.12), rel=2e-3)


@pytest.mark.slow
def test_reverse_is_the_mirror_of_forward():
    torque = np.array([2.0, 2.6])
    forward, _ = drive(TractionPlant(RLMA_HIGH, [Patch(friction=0.2)]), torque, 0.5)
    reverse, _ = drive(TractionPlant(FLAT, [Patch(friction=0.2)]), -torque, 0.5)
    level, _ = drive(TractionPlant(FLAT, [Patch(friction=0.2)]), torque, 0.5)
    assert reverse.speed_m_s == pytest.approx(-level.speed_m_s, rel=1e-12)
    assert reverse.slip_ratio[:2] == pytest.approx(-level.slip_ratio[:2], rel=1e-12)
    assert forward.normal_N[0] < level.normal_N[0] < forward.normal_N[2]


def test_the_load_moves_by_height_over_wheelbase():
    truth, _ = drive(TractionPlant(RLMA_HIGH, [CREEP]), 2.0, 0.5)
    moved = 0.17 / 0.628 * truth.traction_N.sum() / 2
    static = 42.0 * GRAVITY / 4
    assert truth.normal_N == pytest.approx([static - moved] * 2 + [static + moved] * 2, rel=2e-5)


def test_the_ground_changes_under_each_wheel_as_it_comes_there():
    ice = Patch(friction=0.05, rolling=0.0, from_m=0.5, to_m=0.7)
    plant = TractionPlant(RLMA_HIGH, [CREEP, ice])
    plant.reset(speed_m_s=0.5)
    seen = [plant.step(2.0, 1e-3) for _ in range(3000)]
    for truth in seen:
        for k, x_m in enumerate([0.314, 0.314, -0.314, -0.314]):
            before_step = truth.position_m[0] + x_m - 1e-3 * truth.speed_m_s
            if min(abs(before_step - 0.5), abs(before_step - 0.7)) > 2e-3:
                assert truth.friction[k] == (0.05 if 0.5 < before_step < 0.7 else 0.8)
    assert min(t.traction_N[0] for t in seen) < 0.06 * 110.0 < max(t.traction_N[0] for t in seen)
    assert max(t.slip_ratio[0] for t in seen) > 0.5


def test_the_ground_changes_in_time():
    plant = TractionPlant(RLMA_HIGH, [CREEP, Patch(friction=0.05, from_s=0.1)])
    assert drive(plant, 0.5, 0.1)[0].friction[0] == 0.8
    assert plant.step(0.5, 1e-3).friction[0] == 0.05


def test_a_robot_that_rolls_down_gains_what_it_loses_in_height():
    plant = TractionPlant(FLAT, [CREEP], Grade((0.0,), (-0.1,)))
    truth, work = drive(plant, 0.0, 1.0)
    fallen_J = 42.0 * GRAVITY * math.sin(0.1) * truth.position_m[0]
    assert -work.climb == pytest.approx(fallen_J, rel=1e-3)
    assert work.kinetic == pytest.approx(fallen_J, rel=1e-2)


def test_a_circle_is_driven_as_a_circle():
    plant = TractionPlant(FLAT, [Patch(friction=3.0, slip_stiffness_s_per_m=1e3, rolling=0.0)])
    drive(plant, np.array([-3.0, 3.0]), 0.5)
    truth = plant.step(0.0, 1e-3)
    rate = truth.yaw_rate_rad_s
    assert rate > 1.0
    assert truth.heading_rad == pytest.approx(0.5 * rate * 0.5, rel=0.02)
    assert truth.position_m[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert truth.wheel_centre_speed_m_s == pytest.approx(0.15 * rate * np.array([-1.0, 1.0, -1.0, 1.0]), rel=1e-9)


def test_a_step_leads_along_the_mean_of_its_headings():
    plant = TractionPlant(FLAT, [CREEP], longest_step_s=0.05)
    plant.reset(0.5)
    before, _ = drive(plant, np.array([-3.0, 3.0]), 0.5, dt_s=0.05)
    after = plant.step(np.array([-3.0, 3.0]), 0.05)
    moved = after.position_m - before.position_m
    assert after.heading_rad - before.heading_rad > 0.01
    assert math.atan2(moved[1], moved[0]) == pytest.approx(0.5 * (before.heading_rad + after.heading_rad), abs=1e-9)


def test_the_ground_lies_under_the_wheels_of_a_robot_that_stands_across():
    plant = TractionPlant(FLAT, [CREEP, Patch(friction=0.1, to_m=0.0)])
    assert plant.reset(heading_rad=math.pi / 2).friction.tolist() == [0.1, 0.8, 0.1, 0.8]


def test_the_accelerometer_shows_acceleration_less_gravity():
    rolling_off = TractionPlant(FLAT, [CREEP], Grade((0.0,), (0.1,))).reset()
    wheels_kg = 2 * RLMA.wheel.inertia_kg_m2 / RLMA.wheel.radius_m**2
    shown = GRAVITY * math.sin(0.1) * wheels_kg / (42.0 + wheels_kg)
    assert rolling_off.specific_force_m_s2 == pytest.approx([shown, 0.0, GRAVITY * math.cos(0.1)])
    plant = TractionPlant(FLAT, [CREEP])
    before, _ = drive(plant, 2.0, 0.3)
    after = plant.step(2.0, 1e-3)
    assert after.specific_force_m_s2[0] == pytest.approx((after.speed_m_s - before.speed_m_s) / 1e-3, rel=1e-3)


def test_a_robot_across_the_slope_leans_to_its_side():
    grade, bank = tilt(0.1, math.pi / 2)
    assert grade == pytest.approx(0.0, abs=1e-12)
    assert bank == pytest.approx(-0.1)
    assert tilt(0.1, 0.0) == pytest.approx((0.1, 0.0))
    assert tilt(0.1, math.pi) == pytest.approx((-0.1, 0.0), abs=1e-12)


def test_a_long_step_is_many_short_ones():
    one, many = TractionPlant(RLMA_HIGH, [CREEP]), TractionPlant(RLMA_HIGH, [CREEP])
    long = one.step(2.0, 0.01)
    short, energy = drive(many, 2.0, 0.01)
    assert long.speed_m_s == pytest.approx(short.speed_m_s, rel=1e-12)
    assert one.energy == pytest.approx(energy, rel=1e-12)


def test_a_reset_starts_the_same_run_again():
    plant = TractionPlant(RLMA_HIGH, [CREEP])
    first, _ = drive(plant, 2.0, 0.1)
    plant.reset()
    again, _ = drive(plant, 2.0, 0.1)
    assert first.speed_m_s == again.speed_m_s
    assert np.array_equal(first.position_m, again.position_m)


@pytest.mark.parametrize(
    "torque, dt_s, message",
    [
        (np.zeros(3), 1e-3, "torque_N_m must be a number or one for each driven wheel \\(0, 1\\)"),
        (math.nan, 1e-3, "torque_N_m must be finite"),
        (1.0, 0.0, "dt_s must be > 0"),
    ],
)
def test_impossible_steps_are_refused(torque, dt_s, message):
    with pytest.raises(InputError, match=message):
        TractionPlant(RLMA).step(torque, dt_s)
