"""The unscented Kalman filter, in the form that is compiled.

Two variants go by this name and give different numbers:

- `predict` and `update` draw new sigma points from the predicted belief for the output, as van der Merwe's thesis,
  FilterPy and Stone Soup do. Predictions and updates may come in any order and number.
- `step_reusing_points` sends the propagated points on through the output function, as [T] 3.31-3.48 does. This saves
  one factorisation, but the output's spread lacks the process noise of this step, and the covariance is the plain
  difference P - K C'.

The textbook has points, weights, weighted sums. Here the same is computed in pairs of points, mean +- sqrt(c) l_k with
l_k the columns of the Cholesky factor and c = N + chi. Their images Y+ and Y- enter through differences and sums,

    d_k = Y+ - Y-,   s_k = Y+ + Y- - 2 y_hat,   s_0 = sqrt(4 c W0c) (Y_0 - y_hat),

because the weighted sum of the covariance is then a plain product, (d d' + s s') / (4 c), that cannot be indefinite.
Where the image of every sigma point repeats one element of the point itself (a constant parameter; an output that is a
state), its mean and covariance are known exactly and taken from the belief, not summed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.belief import Belief, Correction, Function, Innovation, require_shape
from ohmward.filters.kalman import gain
from ohmward.filters.linear_algebra import cholesky, mirror_lower


class Scaling(NamedTuple):
    """Shape of the set of sigma points; the defaults are those of [T]."""

    alpha: float = 0.85  #: spread of the points, > 0
    beta: float = 2.0  #: knowledge of the distribution; 2 for a Gaussian
    kappa: float = 0.0  #: second spread, > -N


DEFAULT = Scaling()


class PairWeights(NamedTuple):
    """Weights of 2 N + 1 sigma points."""

    spread: float  #: c = N + chi = alpha^2 (N + kappa), the squared distance of the points in standard deviations
    #: of the central point, chi / c and chi / c + 1 - alpha^2 + beta
    central_mean: float
    central_cov: float
    side: float  #: of every other point, 1 / (2 c)
    pair: float  #: of a product of differences or of sums of a pair, 1 / (4 c)


class SigmaPairs(NamedTuple):
    """Sigma points of a belief about n states."""

    points: np.ndarray  #: (2 n + 1, n), the mean, then mean + and mean - each offset
    offsets: np.ndarray  #: (n, n), lower triangle; column k is sqrt(c) l_k
    weights: PairWeights  #: of the points


class PropagatedPairs(NamedTuple):
    """Sigma points after a function."""

    mean: np.ndarray  #: (m,), y_hat
    differences: np.ndarray  #: (m, n), d_k of the pairs; for an element that repeats a state half of that, its offsets
    difference_unit: np.ndarray  #: (m,), factor of these, 2 for an element that repeats a state, else 1
    sums: np.ndarray  #: (m, n + 1), s_k of the pairs and s_0 of the central point
    #: for each of m elements the index of the state that it repeats at every sigma point, or None
    repeated_state: tuple[int | None, ...]
    weights: PairWeights  #: of the points


def predict(belief: Belief, f: Function, Q: np.ndarray, scaling: Scaling = DEFAULT) -> Belief:
    """Belief after one step of x+ = f(x) + w, w ~ N(0, Q).

    Args:
        belief: before the step.
        f: next state (n,) of a state (n,); it closes over input, parameters and dt.
        Q: (n, n) covariance of the process noise over this step.
        scaling: of the sigma points.

    Raises:
        InputError: f returns anything but (n,), Q is not (n, n), or the scaling has a negative central weight.
    """
    n = len(belief.mean)
    require_shape("Q", Q, (n, n))
    x = propagate(f, draw_pairs(belief, scaling))
    require_shape("f(x)", x.mean, (n,))
    return Belief(x.mean, mirror_lower(covariance(x, x, belief.cov) + Q))


def update(
    belief: Belief, y: np.ndarray, h: Function, R: np.ndarray, scaling: Scaling = DEFAULT
) -> tuple[Belief, Innovation]:
    """Belief after the measurement y = h(x) + v, v ~ N(0, R), with sigma points drawn from `belief`.

    Args:
        belief: before the measurement.
        y: (m,) measured output.
        h: output (m,) of a state (n,).
        R: (m, m) covariance of the measurement noise; zero is allowed.
        scaling: of the sigma points.

    Raises:
        InputError: y, h(x) or R do not fit each other, or the scaling has a negative central weight.
    """
    posterior, innovation, _ = correct(belief, y, h, R, scaling)
    return posterior, innovation


def correct(belief: Belief, y: np.ndarray, h: Function, R: np.ndarray, scaling: Scaling = DEFAULT) -> Correction:
    """`update`, with the gain too.

    The covariance is Joseph's form in the coordinates of the pairs: with D the offsets of the points and G half the
    differences of the outputs, (D - K G) (D - K G)' / c + K (s s' / (4 c) + R) K'.
    """
    sigma = draw_pairs(belief, scaling)
    output = propagate(h, sigma)
    _require_output(output, y, R)
    S = mirror_lower(covariance(output, output, belief.cov) + R)
    n = len(sigma.offsets)
    x = PropagatedPairs(  # the points themselves
        belief.mean, sigma.offsets, np.full(n, 2.0), np.zeros((n, n + 1)), tuple(range(n)), sigma.weights
    )
    K = gain(covariance(x, output, belief.cov), S)
    nu = y - output.mean
    A = sigma.offsets - K * (0.5 * output.difference_unit) @ output.differences
    pair = sigma.weights.pair
    cov = 4 * pair * (A @ A.T) + K @ (pair * (output.sums @ output.sums.T) + R) @ K.T
    return Correction(Belief(belief.mean + K @ nu, mirror_lower(cov)), Innovation(nu, S), K)


def step_reusing_points(
    belief: Belief, f: Function, h: Function, y: np.ndarray, Q: np.ndarray, R: np.ndarray, scaling: Scaling = DEFAULT
) -> tuple[Belief, Innovation]:
    """Predict through f and correct with y = h(x) + v, the propagated sigma points used for both; [T]'s variant.

    Arguments and errors are those of `predict` and `update`.
    """
    _, (posterior, innovation, _) = correct_reusing_points(belief, f, h, y, Q, R, scaling)
    return posterior, innovation


def correct_reusing_points(
    belief: Belief, f: Function, h: Function, y: np.ndarray, Q: np.ndarray, R: np.ndarray, scaling: Scaling = DEFAULT
) -> tuple[Belief, Correction]:
    """`step_reusing_points`, with the belief before the measurement and the gain too."""
    n = len(belief.mean)
    require_shape("Q", Q, (n, n))
    sigma = draw_pairs(belief, scaling)
    X = [f(point) for point in sigma.points]
    x = in_pairs(X, sigma)
    require_shape("f(x)", x.mean, (n,))
    output = in_pairs([h(point) for point in X], sigma)
    _require_output(output, y, R)
    prior = Belief(x.mean, mirror_lower(covariance(x, x, belief.cov) + Q))
    S = mirror_lower(covariance(output, output, belief.cov) + R)
    C = covariance(x, output, belief.cov)
    K = gain(C, S)
    nu = y - output.mean
    posterior = Belief(prior.mean + K @ nu, mirror_lower(prior.cov - K @ C.T))
    return prior, Correction(posterior, Innovation(nu, S), K)


def output_covariance(belief: Belief, h: Function) -> np.ndarray:
    """Covariance P_yy (m, m) of h(x) under the belief, without measurement noise."""
    output = propagate(h, draw_pairs(belief))
    return mirror_lower(covariance(output, output, belief.cov))


def pair_weights(n: int, scaling: Scaling = DEFAULT) -> PairWeights:
    """Weights for a state of n elements, with chi = alpha^2 (n + kappa) - n.

    Raises:
        InputError: the points coincide (c <= 0), or the covariance weight of the central one is negative, which would
            let the summed covariance become indefinite.
    """
    alpha, beta, kappa = scaling
    spread = alpha**2 * (n + kappa)
    if spread <= 0:
        raise InputError(
            f"alpha^2 (n + kappa) must be > 0 but is {spread} for {scaling}, n = {n}; raise kappa or alpha"
        )
    central_mean = 1 - n / spread
    central_cov = central_mean + 1 - alpha**2 + beta
    if central_cov < 0:
        raise InputError(
            f"the central covariance weight must be >= 0 but is {central_cov:.3g} for {scaling}, n = {n}; "
            "with beta = 2 and kappa = 0 choose alpha between 0.52 and 1.93"
        )
    return PairWeights(spread, central_mean, central_cov, side=0.5 / spread, pair=0.25 / spread)


def covariance(a: PropagatedPairs, b: PropagatedPairs, P: np.ndarray) -> np.ndarray:
    """Covariance (m_a, m_b) of two images of the same sigma points, drawn from a belief with covariance P (n, n).

    Elements that both repeat a state have exactly the covariance of those states.
    """
    unit = np.outer(a.difference_unit, b.difference_unit)
    cov = a.weights.pair * unit * (a.differences @ b.differences.T + a.sums @ b.sums.T)
    for i, p in enumerate(a.repeated_state):
        for j, q in enumerate(b.repeated_state):
            if p is not None and q is not None:
                cov[i, j] = P[p, q]
    return cov


def draw_pairs(belief: Belief, scaling: Scaling = DEFAULT) -> SigmaPairs:
    """The sigma points of a belief."""
    n = len(belief.mean)
    require_shape("belief.cov", belief.cov, (n, n))
    w = pair_weights(n, scaling)
    offsets, _ = cholesky(belief.cov, scale=math.sqrt(w.spread))
    return SigmaPairs(np.vstack([belief.mean, belief.mean + offsets.T, belief.mean - offsets.T]), offsets, w)


def propagate(function: Function, sigma: SigmaPairs) -> PropagatedPairs:
    """The sigma points after a function from (n,) to (m,)."""
    return in_pairs([function(point) for point in sigma.points], sigma)


def in_pairs(images: Sequence[np.ndarray], sigma: SigmaPairs) -> PropagatedPairs:
    """Mean, differences and sums of the images of the sigma points, 2 n + 1 times (m,)."""
    points, offsets, w = sigma
    n = len(offsets)
    Y = np.array(images)
    plus, minus = Y[1 : n + 1], Y[n + 1 :]
    mean = w.central_mean * Y[0] + w.side * (plus + minus).sum(axis=0)
    sums = np.column_stack([(plus + minus - 2 * mean).T, math.sqrt(w.central_cov / w.pair) * (Y[0] - mean)])
    repeated = tuple(_repeated_state(column, points) for column in Y.T)
    return PropagatedPairs(
        mean=_exact_where(repeated, points[0], mean),
        differences=_exact_where(repeated, offsets, (plus - minus).T),
        difference_unit=np.array([1.0 if state is None else 2.0 for state in repeated]),
        sums=_exact_where(repeated, np.zeros((n, n + 1)), sums),
        repeated_state=repeated,
        weights=w,
    )


def _repeated_state(column: np.ndarray, points: np.ndarray) -> int | None:
    """The state whose values at the sigma points are the very elements of `column`, if there is one."""
    matches = (state for state, values in enumerate(points.T) if all(map(_same, column, values)))
    return next(matches, None)


def _exact_where(repeated: tuple[int | None, ...], exact: np.ndarray, summed: np.ndarray) -> np.ndarray:
    """`summed` with the rows that repeat a state replaced by that state's row of `exact`."""
    return np.array([row if state is None else exact[state] for row, state in zip(summed, repeated, strict=True)])


def _same(a: object, b: object) -> bool:
    """True for the same traced scalar or equal numbers; comparing traced scalars by value would branch on data."""
    return a is b or (isinstance(a, float) and isinstance(b, float) and a == b)


def _require_output(output: PropagatedPairs, y: np.ndarray, R: np.ndarray) -> None:
    """Raise `InputError` unless y and R fit the output."""
    m = len(output.mean)
    require_shape("y", y, (m,))
    require_shape("R", R, (m, m))
