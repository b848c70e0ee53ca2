"""Noise of a gyro by its third differences, the walk of its offset, and a gyro that is worse than its data sheet."""

import numpy as np
import pytest
from scipy.stats import norm

from ohmward.filters.belief import Belief
from ohmward.traction import RLMA, Odometry
from ohmward.traction.odometry.gyro_noise import (
    OFFSET_WALKS,
    WALK_LASTS_S,
    WALK_PRIOR,
    OffsetWalk,
    gyro_noise_of_sheet,
    learn_gyro_noise,
    learn_offset_walk,
    walk_variance,
)
from ohmward.traction.odometry.model import NAMES, OFFSET, YAW, X, Y

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


SHEET, SPAN_S, BEFORE, KNOWN = 2e-4, 20.0, 1e-7, np.array([0.7, 0.1, 0.1, 0.1])


def after_a_span(offset_rad_s, variance):
    """Walk and belief after 20 s, 3 m forward and 1 m to the left, that end with this estimate of the offset."""
    mean, cov = np.zeros(len(NAMES)), np.zeros((len(NAMES), len(NAMES)))
    mean[[X, Y, OFFSET]] = 3.0, 1.0, offset_rad_s
    cov[OFFSET, OFFSET] = variance
    known = OffsetWalk(KNOWN, SPAN_S - DT_S, BEFORE)
    return learn_offset_walk(known, Belief(mean, cov), DT_S, SHEET)


@pytest.mark.parametrize("offset_rad_s", [0.0, 0.002, 0.02])
def test_an_offset_that_is_shown_weighs_the_walks_by_bayes(offset_rad_s):
    found, _ = after_a_span(offset_rad_s, 0.0)
    prior = WALK_PRIOR + (KNOWN - WALK_PRIOR) * np.exp(-SPAN_S / WALK_LASTS_S)
    stds = np.sqrt(BEFORE + (SHEET * OFFSET_WALKS) ** 2 * SPAN_S)
    likely = prior * norm.pdf(offset_rad_s, scale=stds)
    assert found.probability == pytest.approx(likely / likely.sum())
    assert (found.time_s, found.x_m, found.y_m) == (0.0, 3.0, 1.0)


def test_a_time_that_does_not_show_the_offset_tells_nothing_of_its_walk():
    q = OffsetWalk(KNOWN).variance(SHEET)
    found, belief = after_a_span(0.02, 0.6 * (BEFORE + q * SPAN_S))
    assert np.array_equal(found.probability, KNOWN)
    assert found.time_s == pytest.approx(SPAN_S)
    assert belief.cov[YAW, YAW] == 0.0


def test_a_walk_that_turns_out_to_be_larger_has_turned_the_way_about_its_middle():
    found, belief = after_a_span(0.02, 0.0)
    larger = found.variance(SHEET) - OffsetWalk(KNOWN).variance(SHEET)
    turned = np.array([-0.5, 1.5, 1.0])
    assert larger > 0.0
    assert belief.cov[:3, :3] == pytest.approx(larger * SPAN_S**3 / 12.0 * np.outer(turned, turned))


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
