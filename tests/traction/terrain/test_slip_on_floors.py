from dataclasses import replace

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.traction.observed_drive import as_estimates
from ohmward.traction.score import DriveTruth, score_drive
from ohmward.traction.terrain.floor import inertial_forces
from ohmward.traction.terrain.slip_on_floors import RATE_S, low_pass
from traction.terrain.drives import OMNI, SMOOTH, SOFT, omni_drive, on_floors

LATE = slice(100, None)


@pytest.mark.parametrize("method", ["ekf", "aekf", "ukf", "aukf"])
@pytest.mark.parametrize("direction_deg", [0.0, 20.0, 90.0, 215.0])
def test_slip_is_found_from_currents_alone(method, direction_deg):
    drive = omni_drive([SOFT] * 3, direction_deg, rng=np.random.default_rng(9))
    track = on_floors((SMOOTH, SOFT), method).run(drive.log)
    true = 1 - np.hypot(*drive.motion[LATE, :2].mean(axis=0)) / 0.15
    assert 0.1 < true < 0.45
    assert track.travel_slip[LATE].mean() == pytest.approx(true, abs=0.02)


def test_the_band_on_a_floor_never_met_holds_and_is_wide():
    drive = omni_drive([SOFT] * 3, 20.0, rng=np.random.default_rng(10))
    known = on_floors((SOFT,), told=True).run(drive.log)
    unseen = on_floors((SMOOTH,)).run(drive.log)
    true = 1 - np.hypot(*drive.motion[LATE, :2].mean(axis=0)) / 0.15
    for track in (known, unseen):
        assert abs(track.travel_slip[LATE].mean() - true) < 1.96 * track.travel_slip_std[LATE].mean()
    assert unseen.travel_slip_std[LATE].mean() > 2.5 * known.travel_slip_std[LATE].mean()


def test_speed_over_ground_is_what_the_slip_leaves_of_the_rims():
    track = on_floors((SOFT,)).run(omni_drive([SOFT] * 3, 20.0).log)
    rim = np.hypot(track.rim[LATE, 0], track.rim[LATE, 1])
    np.testing.assert_allclose(track.speed_m_s[LATE], rim * (1 - track.travel_slip[LATE]), rtol=1e-12)
    np.testing.assert_allclose(np.hypot(*track.motion[LATE, :2].T), track.speed_m_s[LATE], rtol=1e-12)


def test_as_estimates_of_an_observer_it_is_scored_like_one():
    drive = omni_drive([SOFT] * 3, 20.0, rng=np.random.default_rng(11))
    track = on_floors((SMOOTH, SOFT)).run(drive.log)
    truth = DriveTruth(drive.motion[:, 0], drive.motion[:, 2], drive.motion[:, 1])
    score = score_drive(OMNI, as_estimates(track, OMNI), truth)
    assert score.speed_rmse_m_s < 0.01
    assert score.coverage_95 > 0.9


def test_numbers_that_are_missing_are_missed_no_longer_than_they_are():
    log = omni_drive([SOFT] * 3, 20.0).log
    current = log.motor_current_A.copy()
    current[[0, 50, 51]] = np.nan
    holed = replace(log, motor_current_A=current)
    estimator = on_floors((SOFT,))
    np.testing.assert_allclose(estimator.run(holed).travel_slip[LATE], estimator.run(log).travel_slip[LATE], atol=1e-5)


def test_a_wheel_without_any_current_is_refused():
    log = omni_drive([SOFT] * 3, 20.0).log
    current = log.motor_current_A.copy()
    current[:, 1] = np.nan
    with pytest.raises(InputError, match="needs the motor current of every driven wheel"):
        on_floors((SOFT,)).run(replace(log, motor_current_A=current))


def test_the_slip_on_doubtful_floors_leans_to_the_likeliest_and_its_spread_is_about_that():
    floors, rng = on_floors((SMOOTH, SOFT)), np.random.default_rng(8)
    p = rng.dirichlet([1.0, 1.0, 1.0, 1.0, 4.0], 3)
    share, std = np.array([0.4, -0.3, 0.35]), np.array([0.02, 0.03, 0.01])
    beliefs = [curves.belief(share, std) for curves in floors.curves]
    mean, cov = floors.mixture(beliefs, p)
    squares = p**2 / (p**2).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(mean, sum(squares[:, k] * b.mean for k, b in enumerate(beliefs)), rtol=1e-12)
    drawn = np.array([rng.choice(5, 200_000, p=row) for row in p]).T
    slip = np.zeros(drawn.shape)
    for k, belief in enumerate(beliefs):
        on_this = rng.multivariate_normal(belief.mean, belief.cov, len(drawn))
        slip = np.where(drawn == k, on_this, slip)
    np.testing.assert_allclose(np.diag(cov), ((slip - mean) ** 2).mean(axis=0), atol=1e-3)
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(cov[off], np.cov(slip.T)[off], atol=1e-3)


@pytest.mark.parametrize("dt_s", [0.005, 0.03, 0.1])
def test_the_acceleration_of_the_rims_is_their_slope_a_moment_ago(dt_s):
    t, slow, rates = np.arange(0.0, 4.0, dt_s), np.zeros((2, 1)), []
    for speed in t**2:
        slow, rate = low_pass(slow, np.array([speed]), dt_s)
        rates.append(rate[0])
    late_s = t[-1] - rates[-1] / 2
    assert np.diff(rates)[-1] == pytest.approx(2 * dt_s)
    assert 2 * RATE_S - dt_s < late_s < 2 * RATE_S + dt_s
    slow, rate = low_pass(slow, np.array([speed]), 0.0)
    assert rate[0] == pytest.approx((slow[0] - slow[1])[0] / RATE_S)


def test_a_body_that_speeds_up_needs_its_mass_times_the_acceleration_besides():
    """A start of 0.5 m/s^2 is no other floor."""
    steady = omni_drive([SMOOTH] * 3, 20.0)
    speed = np.clip(0.5 * (steady.log.time_s - 4.0), 0.0, 0.3)[:, None] / 0.15 + 0.5
    push_N = np.where((speed > 0.5) & (speed < 2.5), 0.5, 0.0) * [np.cos(np.radians(20)), np.sin(np.radians(20)), 0.0]
    current = steady.log.motor_current_A + inertial_forces(OMNI, push_N) * 0.036 / (0.8 * 16 * 0.0514)
    log = replace(steady.log, wheel_speed_rad_s=speed * steady.log.wheel_speed_rad_s, motor_current_A=current)
    track = on_floors((SMOOTH, SOFT)).run(log)
    assert track.crossings == []
    assert track.floor_probability[60:, :, 1].max() < 0.01


def test_standing_wheels_have_no_slip_ratio():
    log = omni_drive([SOFT] * 3, 20.0).log
    still = replace(log, wheel_speed_rad_s=np.zeros((len(log), 3)), motor_current_A=np.zeros((len(log), 3)))
    track = on_floors((SOFT,)).run(still)
    assert np.isnan(track.travel_slip).all()
    np.testing.assert_allclose(track.speed_m_s, 0.0, atol=1e-9)
