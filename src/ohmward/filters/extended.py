"""The extended Kalman filter: the Kalman filter on the model's exact Jacobians."""

from __future__ import annotations

import numpy as np

from ohmward.errors import InputError
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, Correction, Function, Innovation, require_shape
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import Scalar, linearize


def predict(belief: Belief, f: Function, Q: np.ndarray) -> Belief:
    """Belief after one step of x+ = f(x) + w, w ~ N(0, Q): mean f(x), covariance F P F' + Q.

    Args:
        belief: before the step.
        f: next state (n,) of a state (n,); it closes over input, parameters and dt.
        Q: (n, n) covariance of the process noise over this step.

    Raises:
        InputError: f returns anything but (n,), or Q is not (n, n).
    """
    n = len(belief.mean)
    require_shape("Q", Q, (n, n))
    mean, F = linearize(f, belief.mean)
    require_shape("f(x)", mean, (n,))
    return Belief(mean, mirror_lower(F @ belief.cov @ F.T + Q))


def update(belief: Belief, y: np.ndarray, h: Function, R: np.ndarray, iterations: int = 1) -> tuple[Belief, Innovation]:
    """Belief after the measurement y = h(x) + v, v ~ N(0, R).

    Args:
        belief: before the measurement.
        y: (m,) measured output.
        h: output (m,) of a state (n,).
        R: (m, m) covariance of the measurement noise; zero is allowed.
        iterations: 1 is the extended Kalman filter; more is the iterated one, which linearises again where the last
            iteration ended (Gauss-Newton on the posterior, Bell and Cathey 1993).

    Returns:
        The posterior, and the innovation at the prior mean, whatever `iterations`.

    Raises:
        InputError: y, h(x) or R do not fit each other, or `iterations` < 1.
    """
    if iterations < 1:
        raise InputError(f"iterations must be at least 1 but is {iterations}; 1 is the plain extended Kalman filter")
    posterior, innovation, _ = correct(belief, y, h, R)
    for _ in range(iterations - 1):
        y_hat, H = linearize(h, posterior.mean)
        posterior, _ = kalman.update(belief, y, H, R, y_hat + H @ (belief.mean - posterior.mean))
    return posterior, innovation


def correct(belief: Belief, y: np.ndarray, h: Function, R: np.ndarray, used: Scalar = True) -> Correction:
    """`update` without iterations, with the gain too; nothing changes where the condition `used` is false."""
    y_hat, H = linearize(h, belief.mean)
    require_shape("h(x)", y_hat, np.shape(y))
    return kalman.correct(belief, y, H, R, y_hat, used)
