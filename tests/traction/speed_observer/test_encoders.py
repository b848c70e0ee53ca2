"""Encoders of the driven wheels: a gain that is kept in part, and wheels that do what the model excludes."""

import numpy as np
import pytest

from ohmward.filters.belief import Belief
from ohmward.filters.kalman import correct_state
from ohmward.traction.speed_observer.encoders import true_share, with_part_of_gain
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

from .examples import RLMA_ON_FLOOR, at_rest, log, observed

CRUISE_RAD_S, CRUISE_A = 4.0, 0.3585


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_gain_kept_in_part_has_the_covariance_of_joseph(share):
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4))
    prior, R, H = Belief(rng.standard_normal(4), root @ root.T), 0.5, np.array([[0.0, 1.0, 0.0, 0.0]])
    K = prior.cov @ H.T / (prior.cov[1, 1] + R)
    K[3] *= share
    kept = with_part_of_gain(prior, correct_state(prior, 1, 2.0, R), 3, share)
    A = np.eye(4) - K @ H
    assert kept.mean == pytest.approx(prior.mean + K[:, 0] * (2.0 - prior.mean[1]))
    assert kept.cov == pytest.approx(A @ prior.cov @ A.T + R * K @ K.T)


def test_a_state_is_learnt_from_what_is_more_than_noise():
    std, slope = 0.5, 3.0
    cov = std**2 * np.array([[slope**2 + 1.0, slope], [slope, 1.0]])
    shares = [true_share(Belief(np.zeros(2), cov), 0, 1, noise) for noise in (0.0, 1.0, 3.0, 4.0)]
    assert shares == pytest.approx([1.0, 1 - 1 / 9, 0.0, 0.0])
    assert true_share(Belief(np.zeros(2), np.eye(2)), 0, 1, 1.0) == 0.0


def test_a_wheel_that_goes_on_to_surprise_teaches_its_friction_and_does_not_drag_the_body():
    samples = log(np.full(220, CRUISE_RAD_S), np.full(220, CRUISE_A))
    samples.wheel_speed_rad_s[200:, 0] = 0.0
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise(gyro_std_rad_s=0.01))
    first = at_rest(observer)._replace(wheel_speed_rad_s=np.full(4, CRUISE_RAD_S), current_A=np.full(2, CRUISE_A))
    _, e = observed(observer, samples, first)
    flags = e.flags.astype(int)
    assert (flags[200:205] & SlipFlag.ENCODER_SPIKE).all()  # no wheel stops within 10 ms
    assert flags[205] & SlipFlag.GROUND_CHANGED
    assert e.friction_ratio[211, 0] < 0.1
    assert e.speed_m_s[200:216] == pytest.approx(e.speed_m_s[199], abs=0.015)
