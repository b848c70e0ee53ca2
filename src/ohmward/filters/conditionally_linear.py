"""The unscented update of an output that is linear except in the first k states: y = g(x_1 ... x_k) + H x + v.

The Cholesky factor is triangular, so the sigma points along all other states share the first k with the mean: g needs
2 k + 1 points, not 2 n + 1. With L the factor of the first k states, d and s (m, k) the differences g+ - g- and
the second differences g+ + g- - 2 g_0 of the pairs, and b the sum of s over 2 c, by which the mean of g exceeds g_0,

    H_eff = H + d (2 sqrt(c) L)^-1,   R_eff = R + s s' / (4 c) + (beta - alpha^2) b b',

and the update is that of the Kalman filter with these two (statistical linearisation, Gelb 1974, 6.2): belief,
innovation and gain of `unscented.correct` on the same output, to rounding. The term with b is the contribution of the
central point and all points with g_0 to the covariance.
"""

from __future__ import annotations

import math

import numpy as np

from ohmward.filters import kalman
from ohmward.filters.belief import Belief, Correction, Function, require_shape
from ohmward.filters.linear_algebra import cholesky, solve_upper
from ohmward.filters.unscented import DEFAULT, Scaling, pair_weights
from ohmward.trace import Scalar


def correct(
    belief: Belief,
    y: np.ndarray,
    g: Function,
    H: np.ndarray,
    R: np.ndarray,
    k: int = 1,
    used: Scalar = True,
    scaling: Scaling = DEFAULT,
) -> Correction:
    """Belief after y = g(x_1 ... x_k) + H x + v, v ~ N(0, R), with the innovation and the gain.

    Args:
        belief: before the measurement.
        y: (m,) measured output.
        g: (m,) of the first k states (k,).
        H: (m, n) of all states.
        R: (m, m) covariance of the measurement noise; zero is allowed.
        k: number of states that g depends on, the first ones.
        used: a condition; where it is false the belief stays as it is, with a gain of zero.
        scaling: of the sigma points of all n states.

    Raises:
        InputError: y, g(x), H or R do not fit each other, or the scaling has a negative central weight.
    """
    n = len(belief.mean)
    w = pair_weights(n, scaling)
    centre = belief.mean[:k]
    offsets, _ = cholesky(belief.cov[:k, :k], scale=math.sqrt(w.spread))
    middle = g(centre)
    require_shape("g(x)", middle, np.shape(y))
    plus = np.array([g(centre + d) for d in offsets.T])
    minus = np.array([g(centre - d) for d in offsets.T])

    second = plus + minus - 2 * middle
    b = w.side * second.sum(axis=0)
    slope = solve_upper(2 * offsets.T, plus - minus).T
    H_eff = np.hstack([H[:, :k] + slope, H[:, k:]])
    R_eff = R + (w.pair * (second.T @ second) + (scaling.beta - scaling.alpha**2) * np.outer(b, b))
    return kalman.correct(belief, y, H_eff, R_eff, middle + b + H @ belief.mean, used)
