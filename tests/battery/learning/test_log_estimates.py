"""What a log says by itself: against the likelihood that was put in."""

import numpy as np
import pytest

from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.log_update import combined, log_estimate


def posterior(P: np.ndarray, L: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, pull of the prior and information of a measurement z of all parameters with information L."""
    C = np.linalg.inv(np.linalg.inv(P) + L)
    m = C @ L @ z
    return m, np.linalg.inv(P) @ m, np.linalg.inv(C) - np.linalg.inv(P)


def test_a_parameter_that_is_measured_alone_gives_back_its_measurement():
    P, L, z = np.diag([0.04, 0.01]), np.diag([100.0, 50.0]), np.array([0.3, -0.2])
    m, pull, information = posterior(P, L, z)
    own = log_estimate(10.0 * np.exp(m[0]), np.array([1.0, 0.0]), pull, information)
    assert np.log(own.mean / 10.0) == pytest.approx(0.3)
    assert own.std / own.mean == pytest.approx(0.1)


def test_along_a_direction_it_is_the_minimum_of_the_likelihood_alone():
    rng = np.random.default_rng(1)
    A, B = rng.standard_normal((2, 4, 4))
    P, L, z = A @ A.T / 4, 20 * B @ B.T, rng.standard_normal(4)
    m, pull, information = posterior(P, L, z)
    d = np.array([1.0, 1.0, 0.0, 0.0])
    own = log_estimate(float(np.exp(d @ m / 2)), d, pull, information)
    steps = np.linspace(-20.0, 20.0, 400_001)
    off = (m - z)[:, None] + d[:, None] * steps
    best = steps[np.argmin(np.einsum("ks,kl,ls->s", off[:, ::100], L, off[:, ::100])) * 100]
    assert np.log(own.mean) - d @ m / 2 == pytest.approx(best, abs=0.02)


def test_a_log_that_tells_nothing_says_nothing():
    assert log_estimate(1.0, np.ones(2), np.ones(2), np.zeros((2, 2))).std == np.inf
    assert log_estimate(1.0, np.ones(2), np.ones(2), 1e-9 * np.eye(2)).std == np.inf


def test_parts_of_a_log_are_weighed_by_their_information():
    both = combined([Normal(1.0, 0.1), Normal(np.nan, np.inf), Normal(1.0, 0.1)])
    assert both.mean == pytest.approx(1.0)
    assert both.std == pytest.approx(0.1 / np.sqrt(2))
    assert combined([Normal(np.nan, np.inf)]).std == np.inf
