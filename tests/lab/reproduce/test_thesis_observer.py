"""Adaptive filters of docs/reproduce-thesis.md, on one drive."""

import numpy as np
import pytest

from ohmward_lab.reproduce import thesis_observer as bench

RIGHT, R_TOO_SMALL = bench.STARTS[:2]


@pytest.fixture(scope="module")
def drive():
    return bench.record(bench.DRIVES["forward"], np.random.default_rng(100))


@pytest.fixture(scope="module")
def right(drive):
    return bench.errors([drive], bench.UKF, RIGHT)


def test_the_plant_follows_the_wanted_speed_with_the_slip_of_its_ground(drive):
    wanted = bench.DRIVES["forward"].speed(drive.time_s)
    assert np.abs(drive.truth[:, 0] - wanted).max() < 0.03
    assert 0.01 < np.abs(bench.slip_speed(drive.truth)).max() < 0.05


def test_a_ukf_with_the_right_noise_is_within_millimetres_per_second(right):
    assert right.speed_mm_s < 2.0 and right.nees < 1.5


def test_a_wrong_R_makes_it_wrong_with_confidence_and_matching_R_repairs_it(drive, right):
    wrong = bench.errors([drive], bench.UKF, R_TOO_SMALL)
    matched = bench.errors([drive], bench.AUKF, R_TOO_SMALL)
    assert wrong.wheel_rad_s > 3 * right.wheel_rad_s and wrong.nees > 4.0
    assert matched.wheel_rad_s < 1.25 * right.wheel_rad_s
    assert matched.speed_mm_s < 1.35 * right.speed_mm_s and matched.nees < 1.5


def test_matching_both_is_worse_than_the_right_noise_even_when_it_starts_right(drive, right):
    both = bench.errors([drive], bench.AUKF_T, RIGHT)
    assert both.speed_mm_s > 1.5 * right.speed_mm_s and both.yaw_mrad_s > 3 * right.yaw_mrad_s
