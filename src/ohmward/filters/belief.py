"""Beliefs, innovations and corrections of the filters."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.linear_algebra import cholesky, lower_triangle, solve_lower, solve_spd, symmetric_from
from ohmward.trace import isfinite, where

Function = Callable[[np.ndarray], np.ndarray]
"""A model's function of a state x (n,): f(x), the next state (n,), or h(x), the output (m,)."""


class Belief(NamedTuple):
    """Gaussian belief about a state of n elements."""

    mean: np.ndarray  #: (n,), in the units of the model's state
    cov: np.ndarray  #: (n, n), symmetric to the bit when a filter made it


class PackedBelief(NamedTuple):
    """A belief as it is stored: symmetric by construction, no element twice."""

    mean: np.ndarray  #: (n,) mean of the states, in the order of the model
    lower: np.ndarray  #: (n (n + 1) / 2,) lower triangle of the covariance, row by row


class Innovation(NamedTuple):
    """Innovation nu = y - y_hat and its covariance S."""

    value: np.ndarray  #: (m,), measured minus predicted output
    cov: np.ndarray  #: (m, m), before the measurement was used


class Correction(NamedTuple):
    """An update with all that it computed."""

    belief: Belief  #: after the measurement
    innovation: Innovation  #: nu and S
    gain: np.ndarray  #: (n, m), K; the mean moved by K nu


def pack(belief: Belief) -> PackedBelief:
    """The belief with the lower triangle of its covariance only; `unpack` undoes it."""
    n = len(belief.mean)
    require_shape("belief.cov", belief.cov, (n, n))
    return PackedBelief(belief.mean, lower_triangle(belief.cov))


def unpack(packed: PackedBelief) -> Belief:
    """The belief with its full covariance; cov[i, j] and cov[j, i] are the very same element."""
    n = len(packed.mean)
    require_shape("packed.lower", packed.lower, (n * (n + 1) // 2,))
    return Belief(packed.mean, symmetric_from(packed.lower))


def nis(innovation: Innovation) -> float:
    """Normalised innovation squared nu' S^-1 nu; chi-square with m degrees of freedom when the filter is consistent."""
    return innovation.value @ solve_spd(innovation.cov, innovation.value)


def log_likelihood(innovation: Innovation) -> float:
    """Log density of the measurement before it was used, -(m log 2 pi + log det S + nu' S^-1 nu) / 2."""
    L, _ = cholesky(innovation.cov)
    z = solve_lower(L, innovation.value)
    log_det = 2 * sum(np.log(L[i, i]) for i in range(len(L)))
    return -0.5 * (len(L) * math.log(2 * math.pi) + log_det + z @ z)


def is_healthy(belief: Belief) -> float:
    """1.0 when the mean is finite and the covariance positive semidefinite up to rounding, else 0.0.

    A filter that is not healthy has lost its state: restart it from a new belief. Inside a traced step the factor
    needed here is the one of the next sigma points, so the check costs next to nothing.
    """
    _, ok = cholesky(belief.cov)
    for element in belief.mean:
        ok = where(isfinite(element), ok, 0.0)
    return ok


def require_shape(name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise `InputError` unless `array` is an array of `shape`; `name` as the caller wrote it."""
    found = np.shape(array)
    if found != shape:
        raise InputError(f"{name} must have shape {shape} but has {found}; {_advice(found, shape)}")


def _advice(found: tuple[int, ...], shape: tuple[int, ...]) -> str:
    if found == () and shape == (1, 1):
        return "wrap the number: np.array([[value]])"
    if found == () and shape == (1,):
        return "wrap the number: np.array([value])"
    if len(shape) == 2 and found == shape[:1]:
        return "a covariance is a matrix: np.diag(variances)"
    return "the state has as many elements as belief.mean, the output as many as y"
