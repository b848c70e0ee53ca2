"""The Kalman filter for linear models (Kalman 1960), with the covariance update in Joseph's form."""

from __future__ import annotations

import numpy as np

from ohmward.filters.belief import Belief, Correction, Innovation, require_shape
from ohmward.filters.linear_algebra import TINY, mirror_lower, solve_spd
from ohmward.trace import Scalar, maximum, where


def predict(belief: Belief, F: np.ndarray, Q: np.ndarray, offset: np.ndarray | float = 0.0) -> Belief:
    """Belief after one step of x+ = F x + offset + w, w ~ N(0, Q).

    Args:
        belief: before the step.
        F: (n, n) transition matrix.
        Q: (n, n) covariance of the process noise over this step.
        offset: (n,), contribution of the input, B u.

    Raises:
        InputError: F or Q is not (n, n).
    """
    n = len(belief.mean)
    require_shape("F", F, (n, n))
    require_shape("Q", Q, (n, n))
    return Belief(F @ belief.mean + offset, mirror_lower(F @ belief.cov @ F.T + Q))


def update(
    belief: Belief, y: np.ndarray, H: np.ndarray, R: np.ndarray, y_hat: np.ndarray | None = None
) -> tuple[Belief, Innovation]:
    """Belief after the measurement y = H x + v, v ~ N(0, R).

    Args:
        belief: before the measurement.
        y: (m,) measured output.
        H: (m, n) output matrix.
        R: (m, m) covariance of the measurement noise; zero is allowed.
        y_hat: (m,) predicted output where it is not H @ mean, as with a linearised output.

    Raises:
        InputError: y, H or R do not fit each other or the belief.
    """
    posterior, innovation, _ = correct(belief, y, H, R, y_hat)
    return posterior, innovation


def correct(
    belief: Belief, y: np.ndarray, H: np.ndarray, R: np.ndarray, y_hat: np.ndarray | None = None, used: Scalar = True
) -> Correction:
    """`update`, with the gain too; where the condition `used` is false the belief is unchanged and the gain zero.

    Choosing the reciprocal of S takes one choice, choosing between prior and posterior n (n + 3) / 2.
    """
    n, m = len(belief.mean), len(np.atleast_1d(y))
    require_shape("y", y, (m,))
    require_shape("H", H, (m, n))
    require_shape("R", R, (m, m))
    C = belief.cov @ H.T
    S = mirror_lower(H @ C + R)
    K = gain(C, S, used)
    nu = y - (H @ belief.mean if y_hat is None else y_hat)
    posterior = Belief(belief.mean + K @ nu, joseph(belief.cov, K, H, R))
    return Correction(posterior, Innovation(nu, S), K)


def correct_state(belief: Belief, i: int, y: Scalar, variance: Scalar, used: Scalar = True) -> Belief:
    """Belief after the measurement y = x_i + v, v ~ N(0, variance), of a state itself; unchanged where not `used`.

    `correct` with H a row of the identity, in a quarter of the operations: the covariance is P - P_i P_i' / S, with
    P_ij variance / S in the row and column of the state, so that the variance of that state never falls below zero.

    Args:
        belief: before the measurement.
        i: index of the state.
        y: measured value, finite.
        variance: of the measurement noise.
        used: a condition; where it is false nothing changes.
    """
    P, C = belief.cov, belief.cov[:, i]
    reciprocal = 1.0 / maximum(C[i] + variance, TINY)
    K = C * where(used, reciprocal, 0.0)
    cov = P - np.outer(K, C)
    cov[i, :] = cov[:, i] = C * where(used, variance * reciprocal, 1.0)
    return Belief(belief.mean + K * (y - belief.mean[i]), mirror_lower(cov))


def gain(C: np.ndarray, S: np.ndarray, used: Scalar = True) -> np.ndarray:
    """K = C S^-1 (n, m) from the covariance C (n, m) of state and output and S (m, m) of the innovation; 0 if not used.

    C must be finite where the measurement is not used.
    """
    if used is True:
        return solve_spd(S, C.T).T
    if len(S) == 1:
        return C * where(used, 1.0 / maximum(S[0, 0], TINY), 0.0)
    return where(used, solve_spd(S, C.T).T, 0.0)


def joseph(P: np.ndarray, K: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """(I - K H) P (I - K H)' + K R K' (n, n), for any gain K; H: (m, n).

    With M = P - K H P it is M - (M H' - K R) K', n^2 m products instead of n^3. As in the product of three, the
    rounding error of M is multiplied by I - K H again: for an R far below H P H' the difference M has lost its digits,
    but this result has not.
    """
    M = P - K @ (H @ P)
    return mirror_lower(M - (M @ H.T - K @ R) @ K.T)
