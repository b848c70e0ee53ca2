"""Covariances stay symmetric and positive semidefinite over long logs with tiny process noise and a precise sensor."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from ohmward.filters import Belief, extended, is_healthy, unscented
from ohmward.trace import Kernel

DT_S = 0.1
START = Belief(np.zeros(3), np.eye(3))


def constant_acceleration(x):
    return np.array([x[0] + DT_S * x[1] + DT_S**2 / 2 * x[2], x[1] + DT_S * x[2], x[2]])


def position(x):
    return x[:1] * 1.0


def extended_step(belief, y, Q, R):
    return extended.update(extended.predict(belief, constant_acceleration, Q), y, position, R)


def unscented_step(belief, y, Q, R):
    return unscented.update(unscented.predict(belief, constant_acceleration, Q), y, position, R)


def reusing_step(belief, y, Q, R):
    return unscented.step_reusing_points(belief, constant_acceleration, position, y, Q, R)


STEPS = [extended_step, unscented_step, reusing_step]


def run(filter_step, length, q, r):
    """The last belief, and at every step whether it was healthy and how asymmetric."""
    Q, R = q * np.eye(3), np.array([[r]])

    def step(belief, y):
        belief, _ = filter_step(belief, y, Q, R)
        return belief, (is_healthy(belief), belief.cov - belief.cov.T)

    y = np.sqrt(r) * np.random.default_rng(1).normal(size=(length, 1))
    return Kernel(step, START, y[0]).scan(START, y)


def regression_covariance(length, r):
    """Covariance of position, speed and acceleration at the end, from a parabola through `length` samples."""
    age_s = DT_S * np.arange(length)
    jacobian = np.column_stack([np.ones(length), -age_s, age_s**2 / 2])
    scale = np.abs(jacobian).max(axis=0)
    return r * np.linalg.inv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("length", [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("q", [0.0, 1e-18])
def test_covariance_stays_symmetric_and_positive(step, length, q):
    belief, (healthy, asymmetry) = run(step, length, q, r=1e-12)
    assert healthy.min() == 1
    assert np.abs(asymmetry).max() == 0
    deviation = np.sqrt(np.diag(belief.cov))
    assert np.linalg.eigvalsh(belief.cov / np.outer(deviation, deviation)).min() > 0


@pytest.mark.parametrize("step", STEPS)
def test_without_process_noise_the_filter_is_still_the_regression_after_many_steps(step):
    length = 20_000
    belief, _ = run(step, length, 0.0, r=1e-12)
    expected = regression_covariance(length, 1e-12)
    deviation = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        belief.cov / np.outer(deviation, deviation), expected / np.outer(deviation, deviation), atol=1e-6
    )


def test_redrawing_survives_a_sensor_that_ends_filterpy():
    r = 1e-20
    peer = UnscentedKalmanFilter(
        3, 1, DT_S, position, lambda x, dt: constant_acceleration(x), MerweScaledSigmaPoints(3, 0.85, 2.0, 0.0)
    )
    peer.P, peer.Q, peer.R = START.cov, np.zeros((3, 3)), np.array([[r]])
    with pytest.raises(np.linalg.LinAlgError):
        for _ in range(10):
            peer.predict()
            peer.update(np.zeros(1))
    _, (healthy, _) = run(unscented_step, 1000, 0.0, r)
    assert healthy.min() == 1


@pytest.mark.parametrize("step", [extended_step, reusing_step])
def test_beyond_the_digits_of_a_double_the_others_say_so(step):
    _, (healthy, _) = run(step, 10, 0.0, r=1e-22)
    assert healthy.min() == 0
