"""Kalman filters for any model, and the live shell and the runs of every estimator; independent of the application.

The filters are pure functions on NumPy arrays. Each also runs on object arrays of traced scalars, so that a whole step
can be traced and compiled. `kalman`, `extended` and `unscented` each have `predict` and `update`; `adaptive` learns the
noise.
"""

from ohmward.filters import adaptive, conditionally_linear, consistency, extended, gate, kalman, sanitize, unscented
from ohmward.filters.belief import Belief, Innovation, PackedBelief, is_healthy, log_likelihood, nis, pack, unpack

__all__ = [
    "Belief",
    "Innovation",
    "PackedBelief",
    "adaptive",
    "conditionally_linear",
    "consistency",
    "extended",
    "gate",
    "is_healthy",
    "kalman",
    "log_likelihood",
    "nis",
    "pack",
    "sanitize",
    "unpack",
    "unscented",
]
