"""Small models that several tests of the filters share."""

from __future__ import annotations

import numpy as np

from ohmward.filters import Belief

DT_S = 0.1


def pendulum(x):
    """Angle [rad], rate [rad/s] and stiffness [1/s^2] of a pendulum after 0.1 s; the stiffness is a parameter."""
    angle, rate, stiffness = x
    return np.array([angle + DT_S * rate, rate - DT_S * stiffness * np.sin(angle), stiffness])


def height(x):
    """Height of the bob, (1,): even in the angle, so its curvature matters."""
    return np.array([1 - np.cos(x[0]) + 0.2 * x[1]])


def two_outputs(x):
    """Height and a product of states, (2,)."""
    return np.array([1 - np.cos(x[0]) + 0.2 * x[1], x[0] * x[2]])


PENDULUM = Belief(np.array([0.6, 0.1, 1.3]), np.array([[0.10, 0.02, 0.01], [0.02, 0.20, 0.03], [0.01, 0.03, 0.05]]))
PENDULUM_Q = np.diag([1e-4, 1e-3, 1e-6])
PENDULUM_R = np.array([[0.01]])


def random_covariance(rng, n):
    """A well-conditioned covariance (n, n)."""
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


def random_linear(rng, n, m):
    """F, offset, Q, H, R and a belief for a random linear model."""
    F = np.eye(n) + 0.3 * rng.normal(size=(n, n))
    H = rng.normal(size=(m, n))
    belief = Belief(rng.normal(size=n), random_covariance(rng, n))
    return F, rng.normal(size=n), random_covariance(rng, n), H, random_covariance(rng, m), belief


def largest_difference(a, b):
    """Largest absolute difference between two NamedTuples of arrays."""
    return max(np.max(np.abs(np.subtract(p, q, dtype=float))) for p, q in zip(a, b, strict=True))
