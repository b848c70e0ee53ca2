"""The equations of motion against others written by hand, by symmetry and in CasADi."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.trace import Kernel, linearize
from ohmward.traction import (
    RLMA,
    ROBOTINO,
    RobotInput,
    RollingResistance,
    SkidSteer,
    forces,
    hard_terrain,
    rates,
    scene,
)
from ohmward.traction.dynamics.forces import weight_along_ground
from ohmward.traction.friction.law import CoulombCreep, contact
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import GRAVITY
from traction.examples import HARD, LOSSY, LOW, ROBOTS, SLIPPERY, TERRAINS

LOAD = 42.0 * GRAVITY / 4
SKID = ROBOTS["skid-steer"]
states = st.tuples(*[st.floats(-1.5, 1.5)] * 2, *[st.floats(-15, 15)] * 2).map(np.array)
currents = st.tuples(st.floats(-10, 10), st.floats(-10, 10)).map(np.array)


def test_rest_is_rest():
    for robot in ROBOTS.values():
        x = np.zeros(len(robot.state_names))
        np.testing.assert_array_equal(rates(x, RobotInput(np.zeros(robot.driven)), scene(robot, HARD)), 0.0)


@given(v=st.floats(-1, 1), omega=st.floats(-10, 10), current=st.floats(-10, 10))
def test_straight_ahead_it_is_one_wheel_twice(v, omega, current):
    traction = LOAD * np.sign(0.12 * omega - v) * 0.7 * (1 - np.exp(-20 * abs(0.12 * omega - v)))
    rolling = -LOAD * np.sign(v) * (0.0075 * (1 - np.exp(-50 * abs(v))) + 0.02 * abs(v))
    acceleration = (2 * traction + 4 * rolling) / (42.0 + 2 * 0.0108 / 0.12**2)
    wheel = (0.517 * current - 0.12 * traction) / 0.0108
    found = rates(np.array([v, 0.0, omega, omega]), RobotInput(np.full(2, current)), scene(LOW, HARD))
    np.testing.assert_allclose(found, [acceleration, 0.0, wheel, wheel], rtol=1e-9, atol=1e-6)


def casadi_rates(x, current, mass, yaw_inertia):
    """Section 6 of the equations for the robot of [T], without looking at the code."""
    v, yaw_rate, left, right = (x[k] for k in range(4))
    v_left, v_right = v - 0.15 * yaw_rate, v + 0.15 * yaw_rate

    def traction(slip):
        return LOAD * casadi.sign(slip) * 0.7 * (1 - casadi.exp(-20 * casadi.fabs(slip)))

    def rolling(speed):
        size = casadi.fabs(speed)
        return -LOAD * casadi.sign(speed) * (0.0075 * (1 - casadi.exp(-50 * size)) + 0.02 * size)

    f_left, f_right = traction(0.12 * left - v_left), traction(0.12 * right - v_right)
    push_left, push_right = f_left + 2 * rolling(v_left), f_right + 2 * rolling(v_right)
    return casadi.vertcat(
        (push_left + push_right) / mass,
        0.15 * (push_right - push_left) / yaw_inertia,
        (0.517 * current[0] - 0.12 * f_left) / 0.0108,
        (0.517 * current[1] - 0.12 * f_right) / 0.0108,
    )


@given(x=states, current=currents)
def test_value_and_jacobian_are_those_of_casadi(x, current):
    slip = 0.12 * x[2:] - (x[0] + 0.15 * np.array([-1, 1]) * x[1])
    if abs(slip).min() < 1e-6 or abs(x[0] - 0.15 * x[1]) < 1e-6 or abs(x[0] + 0.15 * x[1]) < 1e-6:
        return  # CasADi's sign has no slope there; test_laws looks at it
    symbol = casadi.SX.sym("x", 4)
    expression = casadi_rates(symbol, current, *RLMA.inertia[:2])
    oracle = casadi.Function("f", [symbol], [expression, casadi.jacobian(expression, symbol)])
    value, J = linearize(lambda x: rates(x, RobotInput(current), scene(LOW, HARD)), x)
    expected_value, expected_J = (np.array(out) for out in oracle(x))
    np.testing.assert_allclose(value, expected_value.ravel(), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(J, expected_J, rtol=1e-9, atol=1e-8)


@given(x=states, current=currents)
def test_left_and_right_are_mirror_images(x, current):
    p = scene(RLMA, HARD)
    mirrored = rates(np.array([x[0], -x[1], x[3], x[2]]), RobotInput(current[::-1]), p)
    np.testing.assert_allclose(mirrored, (rates(x, RobotInput(current), p) * [1, -1, 1, 1])[[0, 1, 3, 2]], atol=1e-10)


@pytest.mark.parametrize("name", ROBOTS)
def test_reverse_is_the_mirror_image(name):
    robot = replace(ROBOTS[name], height_m=0.0)  # load that moves does not mirror: front wheels become rear wheels
    rng = np.random.default_rng(1)
    x, current = rng.normal(0, 2, len(robot.state_names)), rng.normal(0, 3, robot.driven)
    p = scene(robot, TERRAINS["asphalt"])
    forth = rates(x, RobotInput(current), p)
    # yaw rate and speed both change sign: the centrifugal force does not
    back = rates(-x, RobotInput(-current), p)
    turning = np.zeros(len(x))
    if robot.freedoms == 3:
        turning[:2] = x[2] * x[1], -x[2] * x[0]
    np.testing.assert_allclose(back - turning, -(forth - turning), atol=1e-9)


def test_friction_under_one_side_only_turns_the_robot():
    p = scene(RLMA, SLIPPERY, HARD, SLIPPERY, HARD)
    turning = rates(np.array([0.2, 0.0, 4.0, 4.0]), RobotInput(np.full(2, 5.0)), p)
    assert turning[1] > 1.0
    shared = RobotInput(np.full(2, 5.0), adhesion_share=np.array([2 / 7, 1.0, 2 / 7, 1.0]))
    np.testing.assert_allclose(rates(np.array([0.2, 0.0, 4.0, 4.0]), shared, scene(RLMA, HARD)), turning, rtol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_on_a_slope_it_starts_to_roll_down(name):
    robot = ROBOTS[name]
    x = np.zeros(len(robot.state_names))
    p = scene(robot, HARD)
    down = rates(x, RobotInput(np.zeros(robot.driven), grade_rad=0.1), p)
    mass = robot.inertia[0]
    assert down[0] == pytest.approx(-robot.mass_kg * GRAVITY * np.sin(0.1) / mass)
    if robot.freedoms == 3:
        aside = rates(x, RobotInput(np.zeros(robot.driven), bank_rad=0.1), p)
        assert aside[:2] == pytest.approx([0.0, -GRAVITY * np.sin(0.1)])


def test_the_drawbar_pulls_backward():
    x, p = np.zeros(4), scene(RLMA, HARD)
    assert rates(x, RobotInput(np.zeros(2), drawbar_N=10.0), p)[0] == pytest.approx(-10.0 / RLMA.inertia[0])


def test_loads_follow_force_and_height():
    robot = ROBOTS["front-driven, lossy, high"]
    f = forces(np.array([0.3, 0.0, 4.0, 4.0]), RobotInput(np.full(2, 5.0)), scene(robot, HARD))
    total = np.sum(f.traction_N + f.rolling_N)
    moved = robot.height_m * total / (2 * 0.628)
    np.testing.assert_allclose(f.load_N, LOAD + np.array([-1, -1, 1, 1]) * moved, rtol=1e-3)
    assert total > 50.0
    assert f.load_N.sum() == pytest.approx(42.0 * GRAVITY)


def test_on_a_slope_the_ground_carries_less():
    f = forces(np.zeros(4), RobotInput(np.zeros(2), grade_rad=0.2, bank_rad=0.1), scene(RLMA, HARD))
    assert f.load_N.sum() == pytest.approx(42.0 * GRAVITY * np.cos(0.2) * np.cos(0.1))


def test_the_parts_of_the_weight_are_the_weight():
    u, robot = RobotInput(np.zeros(4), grade_rad=0.3, bank_rad=0.2), SKID
    along, across = weight_along_ground(u, robot)
    carried = forces(np.zeros(7), u, scene(robot, HARD)).load_N.sum()
    assert along**2 + across**2 + carried**2 == pytest.approx((42.0 * GRAVITY) ** 2)


def test_friction_to_the_right_loads_the_left_wheels():
    f = forces(np.array([0.0, 1.0, 0.0, *np.zeros(4)]), RobotInput(np.zeros(4)), scene(SKID, HARD))
    # moments about the x axis: sum y N = -h sum F_y, and F_y < 0 on a robot that slides to the left
    assert f.scrub_N.sum() < -100.0
    moment = f.load_N @ [p.y_m for p in SKID.places]
    assert moment == pytest.approx(-SKID.height_m * f.scrub_N.sum(), rel=1e-2)


def test_a_wheel_that_lifts_carries_nothing():
    robot = replace(RLMA, height_m=1.5)
    f = forces(
        np.array([0.0, 0.0, 50.0, 50.0]), RobotInput(np.zeros(2), grade_rad=0.0, adhesion_share=5.0), scene(robot, HARD)
    )
    assert f.load_N.min() >= 0.0


def test_skid_steering_straight_is_all_wheels_driven():
    flat = replace(SKID, chassis=SkidSteer(0.314, 0.314, 0.30), height_m=0.0)
    omega = np.array([3.0, 3.2, 3.1, 2.9])
    skid = rates(np.array([0.4, 0.0, 0.0, *omega]), RobotInput(np.full(4, 2.0)), scene(flat, HARD))
    rolling = rates(np.array([0.4, 0.0, *omega]), RobotInput(np.full(4, 2.0)), scene(ROBOTS["all driven"], HARD))
    np.testing.assert_allclose(skid[[0, 2, 3, 4, 5, 6]], rolling, rtol=1e-6)


def test_a_sideways_push_meets_sliding_friction():
    f = forces(
        np.array([0.0, 2.0, 0.0, *np.zeros(4)]), RobotInput(np.zeros(4)), scene(replace(SKID, height_m=0.0), HARD)
    )
    np.testing.assert_allclose(f.scrub_N, -0.7 * f.load_N, rtol=1e-9)
    np.testing.assert_allclose(f.traction_N, 0.0, atol=1e-9)


@given(slip=st.floats(-1, 1), sideways=st.floats(-1, 1))
def test_the_force_lies_along_the_slip_vector_with_the_laws_size(slip, sideways):
    x = np.array([0.5, sideways, 0.0, *np.full(4, (0.5 + slip) / 0.12)])
    f = forces(x, RobotInput(np.zeros(4)), scene(replace(SKID, height_m=0.0), HARD))
    size = np.hypot(slip, sideways)
    expected = HARD.traction.force_N(contact(size, 0.0, f.load_N[0]))
    assert np.hypot(f.traction_N[0], f.scrub_N[0]) == pytest.approx(expected, rel=1e-4, abs=1e-3)
    assert f.traction_N[0] * sideways + f.scrub_N[0] * slip == pytest.approx(0.0, abs=1e-6)


def test_turning_on_the_spot_wins_over_scrubbing_only_with_enough_torque():
    p = scene(SKID, HARD)
    scrubbing = rates(
        np.array([0.0, 0.0, 0.5, *np.array([-1, 1, -1, 1]) * 0.15 * 0.5 / 0.12]), RobotInput(np.zeros(4)), p
    )
    assert scrubbing[2] < -5.0


@pytest.mark.parametrize(
    "motion, wheels", [((0.0, 0.0, 1.0), (1, 1, 1)), ((1.0, 0.0, 0.0), (-1, 0, 1)), ((0.0, 1.0, 0.0), (0.5, -1, 0.5))]
)
def test_the_omni_robot_goes_where_its_wheels_push(motion, wheels):
    creep = HARD._replace(traction=CoulombCreep(5.0, 14.0))
    x = np.concatenate([np.zeros(3), np.array(wheels) * 0.5])
    found = rates(x, RobotInput(np.zeros(3)), scene(ROBOTINO, creep))[:3]
    assert found @ motion > 0.5
    np.testing.assert_allclose(found[np.array(motion) == 0], 0.0, atol=1e-12)


def test_the_drive_turns_its_own_wheel():
    robot = replace(RLMA, motor=LOSSY)
    x, current = np.array([0.3, 0.0, 2.5, 2.5]), np.array([2.0, 2.0])
    torque = wheel_torque(LOSSY, 2.0, 2.5)
    found = rates(x, RobotInput(current), scene(robot, replace_rolling(HARD)))
    inertia = 0.0108 + 20.0**2 * 1e-5
    np.testing.assert_allclose(found[2:], torque / inertia, rtol=1e-9)


def replace_rolling(terrain):
    return terrain._replace(rolling=RollingResistance(0.0, 1.0, 0.0))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("ground", TERRAINS)
def test_traced_it_is_the_same(name, ground):
    robot, rng = ROBOTS[name], np.random.default_rng(3)
    x, u = rng.normal(0, 1, len(robot.state_names)), RobotInput(rng.normal(0, 3, robot.driven), 0.1, -0.05, 5.0, 0.9)
    p = scene(robot, TERRAINS[ground])
    np.testing.assert_allclose(Kernel(rates, x, u, constants=(p,))(x, u), rates(x, u, p), rtol=1e-10, atol=1e-10)


def test_scenes_need_one_terrain_or_one_for_each_wheel():
    with pytest.raises(InputError, match="terrains must be one, or one for each of the 4 wheels; got 2"):
        scene(RLMA, HARD, SLIPPERY)
    with pytest.raises(InputError, match="got 0"):
        scene(RLMA)
    assert scene(ROBOTINO, hard_terrain("ice")).terrains[2].name == "ice"
