from contextlib import nullcontext

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction import RLMA, ROBOTINO
from ohmward.traction.calibration import motion_from_pose, motion_from_speed
from ohmward.traction.calibration.stretches import local_slope, without_lateral


def test_a_circle_driven_sideways_has_its_speeds():
    t = np.arange(0.0, 10.0, 0.025) + np.random.default_rng(1).uniform(0.0, 0.005, 400)
    w, radius = 0.4, 2.0
    heading = np.angle(np.exp(1j * (w * t + 0.3)))  # jumps by 2 pi
    x, y = radius * np.cos(w * t), radius * np.sin(w * t)
    motion = motion_from_pose(t, x, y, heading)
    angle = np.pi / 2 - 0.3  # of the velocity, seen from the body
    speed = w * radius
    inner = slice(20, -20)
    np.testing.assert_allclose(motion[inner, 0], speed * np.cos(angle), atol=0.005)
    np.testing.assert_allclose(motion[inner, 1], speed * np.sin(angle), atol=0.005)
    np.testing.assert_allclose(motion[inner, 2], w, rtol=1e-6)


def test_the_local_slope_is_that_of_a_straight_line_through_the_neighbours():
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.01, 0.1, 200))
    y = rng.normal(size=200)
    y[50] = np.nan
    found = local_slope(t, y)
    for k in (0, 30, 50, 120, 199):
        near = (np.abs(t - t[k]) < 0.3) & np.isfinite(y)
        assert found[k] == pytest.approx(np.polyfit(t[near], y[near], 1)[0], rel=1e-8)


def test_alone_in_its_window_a_value_has_no_slope():
    assert np.isnan(local_slope(np.array([0.0, 5.0, 10.0]), np.ones(3))).all()


def test_one_speed_is_enough_only_where_the_robot_cannot_move_sideways():
    t = np.arange(4.0)
    motion = motion_from_speed(RLMA, t, np.array([1.0, np.nan, 2.0, np.nan]))
    np.testing.assert_array_equal(motion, [[1.0, 0.0], [1.5, 0.0], [2.0, 0.0], [np.nan, 0.0]])
    with pytest.raises(InputError, match="moves sideways too"):
        motion_from_speed(ROBOTINO, t, np.ones(4))


def test_a_pose_without_numbers_is_refused():
    with pytest.raises(InputError, match="at least 3 samples with numbers, got 0"):
        motion_from_pose(np.arange(3.0), np.full(3, np.nan), np.zeros(3), np.zeros(3))


def pose(time_s, turned_rad=0.0, mirrored=1.0, jump_m=0.0):
    """Motion of a point 0.2 m ahead of the axle of a robot that drives curves to both sides, by a pose with a fault."""
    heading = np.sin(0.5 * time_s)
    x_m, y_m = (np.cumsum(0.4 * along(heading)) * 0.05 for along in (np.cos, np.sin))
    x_m, y_m = x_m + 0.2 * np.cos(heading) + jump_m * (time_s > 30.0), y_m + 0.2 * np.sin(heading)
    return motion_from_pose(time_s, x_m, mirrored * y_m, heading + turned_rad)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"turned_rad": -0.5}, r"moves 29 deg to the left of its heading.*--pose-turn"),
        ({"mirrored": -1.0}, r"of its speed across its way.*--pose-scale 1,-1"),
        ({"jump_m": 3.0}, None),
    ],
)
def test_a_pose_that_moves_sideways_is_refused_but_not_for_one_jump(fault, message):
    motion = pose(np.arange(0.0, 60.0, 0.05), **fault)
    with pytest.raises(InputError, match=message) if message else nullcontext():
        assert without_lateral(RLMA, motion).shape == (1200, 2)
    assert without_lateral(ROBOTINO, motion).shape == (1200, 3)
