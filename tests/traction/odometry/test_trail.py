"""The way between two instants."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.traction.odometry.corrections import empty_trail, extend, way
from traction.odometry.examples import DT_S, integrate


def test_the_way_is_the_pose_in_the_frame_of_its_start():
    rng = np.random.default_rng(2)
    twists = rng.standard_normal((30, 3))
    trail = empty_trail(20)
    for twist in twists:
        trail = extend(trail, twist, DT_S)
    pose = integrate(*twists[-15:-5].T)[-1]
    found = way(trail, 10 * DT_S, 5 * DT_S)
    assert_allclose(found.increment, pose, atol=1e-12)
    assert found.known_s == pytest.approx(10 * DT_S)


def test_a_part_of_a_step_counts_in_part_and_what_is_forgotten_is_not_known():
    trail = empty_trail(4)
    for _ in range(10):
        trail = extend(trail, np.array([1.0, 0.0, 0.0]), DT_S)
    assert_allclose(way(trail, 1.5 * DT_S, 0.25 * DT_S).increment, [1.5 * DT_S, 0.0, 0.0], atol=1e-15)
    assert way(trail, 6 * DT_S, DT_S).known_s == pytest.approx(3 * DT_S)
