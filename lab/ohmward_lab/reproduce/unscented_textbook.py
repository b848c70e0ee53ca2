"""The unscented Kalman filter as printed in [T] 3.31-3.48, with its misprints corrected: points, weights, sums."""

from __future__ import annotations

import math

import numpy as np

from ohmward.filters.belief import Belief, Function, Innovation
from ohmward.filters.kalman import gain
from ohmward.filters.linear_algebra import cholesky
from ohmward.filters.unscented import DEFAULT, Scaling


def sigma_points(belief: Belief, scaling: Scaling = DEFAULT) -> np.ndarray:
    """The mean, then mean + and mean - sqrt(N + chi) times each column of the Cholesky factor, (2 n + 1, n)."""
    spread = scaling.alpha**2 * (len(belief.mean) + scaling.kappa)  # N + chi
    L, _ = cholesky(belief.cov, scale=math.sqrt(spread))
    return np.vstack([belief.mean, belief.mean + L.T, belief.mean - L.T])


def sigma_weights(n: int, scaling: Scaling = DEFAULT) -> tuple[np.ndarray, np.ndarray]:
    """Weights (2 n + 1,) of the sigma points for mean and covariance, with chi = alpha^2 (N + kappa) - N."""
    alpha, beta, kappa = scaling
    chi = alpha**2 * (n + kappa) - n
    w_mean = np.full(2 * n + 1, 1 / (2 * (n + chi)))
    w_mean[0] = chi / (n + chi)
    w_cov = w_mean.copy()
    w_cov[0] += 1 - alpha**2 + beta  # [T] has - beta
    return w_mean, w_cov


def textbook_step(
    belief: Belief,
    f: Function,
    h: Function,
    y: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    scaling: Scaling = DEFAULT,
    redraw: bool = False,
) -> tuple[Belief, Innovation]:
    """Predict through f and correct with y = h(x) + v: [T] 3.31-3.48 with its misprints corrected; the reference.

    It gives the numbers of `ohmward.filters.unscented.step_reusing_points`, and with `redraw` those of `predict` and
    then `update`, to rounding, and takes their arguments.
    """
    w_mean, w_cov = sigma_weights(len(belief.mean), scaling)
    X = np.array([f(x) for x in sigma_points(belief, scaling)])  # (2 n + 1, n)
    x_hat = w_mean @ X
    dX = X - x_hat
    P = dX.T @ (w_cov[:, None] * dX) + Q
    if redraw:
        X = sigma_points(Belief(x_hat, P), scaling)
        dX = X - x_hat
    Y = np.array([h(x) for x in X])  # (2 n + 1, m); [T] 3.42 takes the points before the propagation
    y_hat = w_mean @ Y
    dY = Y - y_hat
    S = dY.T @ (w_cov[:, None] * dY) + R
    K = gain(dX.T @ (w_cov[:, None] * dY), S)
    nu = y - y_hat
    return Belief(x_hat + K @ nu, P - K @ S @ K.T), Innovation(nu, S)
