"""Noise of a gyro by its third differences, and an odometry whose gyro is worse than its data sheet."""

import numpy as np
import pytest

from ohmward.traction import RLMA, Odometry
from ohmward.traction.odometry.measured_motion import gyro_noise_of_sheet, learn_gyro_noise, walk_variance

WALK, DT_S = 3e-4, 0.02


def heard(rates, dt_s=DT_S, stands=False):
    known = gyro_noise_of_sheet(WALK)
    for rate in rates:
        known = learn_gyro_noise(known, rate, True, stands, dt_s, WALK)
    return known


def test_a_quadratic_motion_is_no_noise():
    t = DT_S * np.arange(500)
    known = heard(0.3 + 2.0 * t - 0.7 * t**2)
    assert known.variance < 0.1 * WALK**2
    assert walk_variance(known, WALK) == WALK**2


@pytest.mark.parametrize("std", [0.01, 0.1, 1.0])
def test_white_noise_is_found(std):
    rng = np.random.default_rng(3)
    found = [walk_variance(heard(std * rng.standard_normal(1500)), WALK) for _ in range(10)]
    assert np.mean(np.array(found, float)) == pytest.approx(std**2 * DT_S, rel=0.1)


def test_one_spike_counts_as_five_sigmas():
    rates = np.zeros(600)
    rates[300] = 8.0
    assert walk_variance(heard(rates), WALK) < 3 * WALK**2


def test_a_slow_gyro_shows_motion_not_noise_but_where_the_robot_stands():
    rates = np.random.default_rng(1).standard_normal(500)
    assert heard(rates, 0.2).variance == WALK**2
    assert heard(rates, 0.2, stands=True).variance == pytest.approx(0.2, rel=0.3)


def test_missing_samples_change_nothing():
    known = heard(np.random.default_rng(1).standard_normal(50))
    after = learn_gyro_noise(known, np.nan, False, False, DT_S, WALK)
    assert after._replace(since_s=known.since_s).variance == known.variance
    assert np.array_equal(after.last_rad_s, known.last_rad_s)


def test_a_bad_gyro_leaves_the_yaw_to_the_wheels():
    """Straight on at 1 m/s for 40 s with 0.3 rad/s of noise: 0.27 rad by the gyro alone, its data sheet says 0.002."""
    errors, nees = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        odometry, wheel = Odometry(RLMA), 1.0 / RLMA.wheel.radius_m
        for i in range(2000):
            e = odometry.update(DT_S * i, [wheel, wheel], 0.3 * rng.standard_normal())
        errors.append(e.yaw_rad)
        nees.append(e.yaw_rad**2 / e.pose_cov[2, 2])
    assert np.sqrt(np.mean(np.square(errors))) < 0.5 * 0.3 * np.sqrt(DT_S * 40)
    assert np.mean(nees) < 2.0
