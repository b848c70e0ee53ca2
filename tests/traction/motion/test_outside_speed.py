"""Noise of outside speeds, in closed form and from errors, and the speed of robots that have one."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.filters.consistency import mean_bounds
from ohmward.trace import Kernel
from ohmward.traction import RLMA
from ohmward.traction.motion.outside_speed import (
    LEAST_STD_M_S,
    MOST_CORRELATION,
    SpeedErrors,
    effective_std,
    receive,
)
from ohmward.traction.motion.sample import no_sample, sanitize
from ohmward.traction.odometry.pose_filter import pose_filter
from traction.odometry.examples import DT_S, INDOOR, TRACK_M, integrate, samples, scan

USUAL_M_S, STEP_S = 0.1, 0.05


def heard(before, rim_m_s, speed_m_s, std_m_s=math.nan):
    sample = no_sample(RLMA)._replace(dt_s=STEP_S, speed_m_s=speed_m_s, speed_std_m_s=std_m_s)
    return receive(before, rim_m_s, sanitize(sample, 0.5), True, USUAL_M_S)


_KERNEL = Kernel(lambda before, given: heard(before, *given), SpeedErrors(), (0.5, 0.0, 0.0))


def along(rims_m_s, speeds_m_s, std_m_s=math.nan):
    """Outside speeds (T, ...) along rims."""
    given = tuple(np.broadcast_to(values, len(rims_m_s)) for values in (rims_m_s, speeds_m_s, std_m_s))
    return _KERNEL.scan(SpeedErrors(), given)[1]


@pytest.mark.parametrize(
    ("said", "is_used"),
    [
        ({"speed_std_m_s": 9.0}, True),
        ({"speed_std_m_s": 300.0}, False),
        ({"speed_std_m_s": -1.0}, True),
        ({"speed_std_m_s": 0.0}, True),
        ({"speed_age_s": 15.0}, True),
        ({"speed_age_s": 90.0}, False),
    ],
)
def test_a_speed_that_its_source_calls_too_uncertain_or_too_old_is_not_used(said, is_used):
    clean = sanitize(no_sample(RLMA)._replace(dt_s=STEP_S, speed_m_s=0.5, **said), 0.5)
    assert (clean.speed_m_s == 0.5) == is_used
    assert clean.speed_refused != is_used


def gauss_markov(rng, steps, rho):
    z = rng.standard_normal(steps)
    for k in range(1, steps):
        z[k] = rho * z[k - 1] + math.sqrt(1 - rho * rho) * z[k]
    return z


def test_a_first_speed_has_the_usual_noise_and_the_spread_of_students_distribution():
    """Three differences and a first one of 0.08 m/s, of which each standard deviation has sqrt(pi) / 2 of its size."""
    _, y = heard(SpeedErrors(), 0.5, 0.58)
    root = 1.0 + (0.8 * math.sqrt(math.pi) / 2 - 1.0) / 4
    assert y.std_m_s == pytest.approx(USUAL_M_S * root * math.sqrt(3.0), rel=1e-12)
    assert (y.measured, y.speed_m_s, y.rims_m_s) == (True, 0.58, 0.5)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_the_variance_of_correlated_errors_is_that_of_their_mean(rho):
    """D_1 = V (1 - rho), D_2 = V (1 - rho^2): a mean of n is as good as one of V (1 + rho) / (1 - rho) each."""
    differences = np.sqrt([1 - rho, 1 - rho**2])
    assert effective_std(differences) == pytest.approx(math.sqrt((1 + rho) / (1 - rho)))
    errors = gauss_markov(np.random.default_rng(1), 4000, rho)
    means = errors.reshape(-1, 200).mean(axis=1)
    assert np.sqrt(200) * means.std() == pytest.approx(math.sqrt((1 + rho) / (1 - rho)), rel=0.35)


def test_no_differences_claim_more_than_the_largest_correlation():
    most = math.sqrt((1 + MOST_CORRELATION) / (1 - MOST_CORRELATION) ** 2)
    assert effective_std(np.array([1.0, 9.0])) == pytest.approx(most)
    assert effective_std(np.array([1.0, 0.1])) == 1.0


@pytest.mark.parametrize("noise_m_s", [0.03, 0.1, 0.4])
@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_noise_of_a_source_that_gives_none_is_learnt(noise_m_s, rho):
    errors = noise_m_s * gauss_markov(np.random.default_rng(3), 3000, rho)
    y = along(np.full(3000, 0.5), 0.5 + errors)
    expected = noise_m_s * math.sqrt((1 + rho) / (1 - rho))
    assert np.mean(y.std_m_s[500:]) == pytest.approx(expected, rel=0.25)


def test_a_given_noise_is_the_least_and_a_larger_one_is_learnt():
    rng = np.random.default_rng(0)
    errors = rng.standard_normal(1000)
    assert along(np.full(1000, 0.5), 0.5 + 0.01 * errors, 0.05).std_m_s.min() >= 0.05
    assert np.mean(along(np.full(1000, 0.5), 0.5 + 0.2 * errors, 0.05).std_m_s[300:]) == pytest.approx(0.2, rel=0.25)


def test_slip_that_lasts_and_a_single_jump_are_no_noise():
    steady = along(np.full(900, 0.5), np.full(900, 0.25)).std_m_s
    assert steady[-1] == pytest.approx(LEAST_STD_M_S, rel=0.05)
    jump = along(np.full(900, 0.5), np.where(np.arange(900) < 600, 0.5, 0.25)).std_m_s
    assert jump[600:].max() < 2.0 * LEAST_STD_M_S


def test_a_speed_that_is_late_is_held_against_the_rims_as_they_were():
    rims = np.clip(np.arange(60) * STEP_S, 0.0, 0.5)
    late = np.concatenate([np.zeros(10), rims[:-10]])
    y = along(rims, late)
    assert_allclose(y.rims_m_s, late, atol=1e-12)
    assert_allclose(y.late_m_s, rims - late, atol=1e-12)


def driven(seed, noise_m_s, every):
    """Samples of a robot that speeds up, stops and goes on, with an outside speed of unstated noise, and its truth."""
    rng, time_s = np.random.default_rng(seed), DT_S * np.arange(3000)
    v = np.interp(time_s, [3.0, 5.0, 30.0, 32.0, 35.0, 37.0], rng.uniform(0.3, 0.9) * np.array([0, 1, 1, 0, 0, 1]))
    w = 0.4 * np.sin(0.3 * time_s + seed) * (v > 0)
    patch = (np.cumsum(v) * DT_S // 5.0).astype(int)
    rim = v * (1 + 0.003 * rng.standard_normal(patch.max() + 1)[patch]) / (1 + 0.005 * rng.standard_normal())
    count = 2 * math.pi / 4096
    angle = np.cumsum(np.column_stack([rim - TRACK_M / 2 * w, rim + TRACK_M / 2 * w]) * DT_S, axis=0)
    angle = np.floor(angle / INDOOR.wheel.radius_m / count + rng.random(2)) * count
    outside = np.full(len(v), np.nan)
    outside[::every] = v[::every] + noise_m_s * rng.standard_normal(len(v[::every]))
    given = {
        "wheel_speed_rad_s": np.diff(angle, axis=0, prepend=angle[:1]) / DT_S,
        "yaw_rate_rad_s": w + 0.01 + 0.002 * rng.standard_normal(len(w)),
        "speed_m_s": outside,
    }
    return given, v, integrate(v, 0.0 * v, w)[-1]


@pytest.mark.parametrize("noise_m_s", [0.02, 0.3])
@pytest.mark.parametrize("every", [10, 50])
def test_the_pose_trusts_an_outside_speed_of_unstated_noise_as_far_as_its_errors_allow(noise_m_s, every):
    """Five times and once a second: the bands are true, and the speed is worse by a tenth of the noise at most."""
    settings, nees, covered, errors, rims = pose_filter(INDOOR), [], [], [], []
    for seed in range(12):
        given, v, pose = driven(seed, noise_m_s, every)
        _, e = scan(settings, samples(settings, **given))
        without = scan(settings, samples(settings, **(given | {"speed_m_s": np.full(len(v), np.nan)})))[1]
        error = np.array([e.x_m[-1], e.y_m[-1], e.yaw_rad[-1]]) - pose
        nees.append(error @ np.linalg.solve(e.pose_cov[-1], error))
        covered.append(np.mean(np.abs(e.speed_m_s - v) < 1.96 * np.sqrt(e.twist_cov[:, 0, 0])))
        errors.append(np.mean((e.speed_m_s - v)[250:] ** 2))
        rims.append(np.mean((without.speed_m_s - v)[250:] ** 2))
    lower, upper = mean_bounds(3, len(nees), 0.999)
    assert lower / 6 < np.mean(nees) < upper
    assert np.mean(covered) > 0.93
    assert math.sqrt(np.mean(errors)) < math.sqrt(np.mean(rims)) + noise_m_s / 10
