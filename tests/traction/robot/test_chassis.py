import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO, Differential, Mecanum, Omni, SkidSteer
from ohmward.traction.robot.chassis import load_matrix, rolling_matrix
from ohmward.traction.robot.robot import motion_from_wheels
from traction.examples import ROBOTS

CHASSIS = {name: robot.chassis for name, robot in ROBOTS.items()}
every_chassis = pytest.mark.parametrize("chassis", CHASSIS.values(), ids=CHASSIS)
motions = st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3))


def velocity(place, motion):
    """Velocity of a point of the body, from v + yaw_rate x r."""
    v_x, v_y, yaw_rate = motion
    return np.array([v_x - yaw_rate * place.y_m, v_y + yaw_rate * place.x_m])


@every_chassis
@given(motion=motions)
def test_wheels_move_as_points_of_a_rigid_body(chassis, motion):
    motion = motion if len(chassis.freedoms) == 3 else (motion[0], 0.0, motion[2])
    free = np.array(motion)[[0, 2] if len(chassis.freedoms) == 2 else [0, 1, 2]]
    along, across = rolling_matrix(chassis) @ free, rolling_matrix(chassis, math.pi / 2) @ free
    for place, u, w in zip(chassis.places, along, across, strict=True):
        c, s = math.cos(place.heading_rad), math.sin(place.heading_rad)
        np.testing.assert_allclose(np.array([[c, s], [-s, c]]) @ velocity(place, motion), [u, w], atol=1e-12)


def test_left_minus_right_plus():
    v, yaw_rate = 0.4, 0.5
    left, right = 0.4 - 0.15 * 0.5, 0.4 + 0.15 * 0.5
    speeds = RLMA.rolling @ np.array([v, yaw_rate])
    np.testing.assert_allclose(speeds, [left, right, left, right], rtol=1e-14)


def test_three_omni_wheels_have_the_known_matrix():
    d = np.radians([60.0, 180.0, 300.0])
    expected = np.column_stack([-np.sin(d), np.cos(d), np.full(3, 0.125)]) / 0.04
    np.testing.assert_allclose(rolling_matrix(ROBOTINO.chassis) / 0.04, expected, atol=1e-12)


def test_mecanum_wheels_have_the_known_matrix():
    """Of the X of rollers: r omega = v_x -+ v_y -+ (a + b) yaw_rate; its radius is that of an omni-wheel by sqrt(2)."""
    arms = 0.125 + 0.15
    expected = np.array([[1, -1, -arms], [1, 1, arms], [1, 1, -arms], [1, -1, arms]])
    chassis = Mecanum(front_m=0.125, rear_m=0.125, track_m=0.30)
    np.testing.assert_allclose(math.sqrt(2.0) * rolling_matrix(chassis), expected, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
@given(motion=motions)
def test_odometry_inverts_the_wheel_speeds(name, motion):
    robot = ROBOTS[name]
    free = np.array(motion[: robot.freedoms])
    if robot.chassis.scrubs:
        free[1] = 0.0  # wheels that all point forward do not see sideways motion
    speeds = robot.rolling[: robot.driven] @ free / robot.wheel.radius_m
    np.testing.assert_allclose(motion_from_wheels(robot, speeds), free, rtol=1e-9, atol=1e-9)


@every_chassis
def test_loads_balance_weight_and_moments(chassis):
    places = chassis.places
    weight, m_x, m_y = 100.0, -3.0, 2.0
    loads = load_matrix(places) @ [weight, m_x, m_y]
    assert loads.sum() == pytest.approx(weight)
    assert loads @ [p.x_m for p in places] == pytest.approx(m_x)
    assert loads @ [p.y_m for p in places] == pytest.approx(m_y)


def test_axles_share_the_weight_by_their_distances():
    loads = load_matrix(SkidSteer(0.4, 0.2, 0.3).places) @ [60.0, 0.0, 0.0]
    np.testing.assert_allclose(loads, [10.0, 10.0, 20.0, 20.0])  # m g L_r / (2 L) in front


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Differential(0.3, 0.0, 0.3), "chassis.rear_m must be > 0, got 0"),
        (lambda: Differential(0.3, 0.3, -0.3), "chassis.track_m must be > 0"),
        (lambda: Differential(0.3, 0.3, 0.3, "rear"), 'chassis.driven must be "front" or "all", got \'rear\''),
        (lambda: SkidSteer(np.nan, 0.3, 0.3), "chassis.front_m must be finite"),
        (lambda: Omni(-0.1), "chassis.arm_m must be > 0"),
        (lambda: Omni(0.1, (0.0, 180.0)), "chassis.bearings_deg must hold three or more"),
        (lambda: Omni(0.1, (0.0, 0.0, 0.0)), "chassis.bearings_deg must hold three or more"),
    ],
)
def test_impossible_geometry_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
