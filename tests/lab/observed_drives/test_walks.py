"""A slope that begins within half a metre, on ground that differs from the believed one: forces are a little wrong."""

import pytest

from ohmward_lab.simulate import closed_loop

from .test_curve_shape import coverage_95


@pytest.mark.slow
def test_forces_that_are_a_little_wrong_all_the_time_break_no_sigma():
    run = closed_loop.run(closed_loop.find_scenario("example"))
    assert coverage_95(run) > 0.95
    assert coverage_95(run, speed_walk=0.01, grade_walk=0.003) < 0.93
