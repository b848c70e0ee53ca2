"""The unscented Kalman filter, in the two variants that go by this name; they differ, so the names say which.

- `predict` and `update` draw new sigma points from the predicted belief for the output, as van der Merwe's thesis,
  FilterPy and Stone Soup do. Predictions and updates may come in any order and number.
- `step_reusing_points` sends the propagated points on through the output function: [T] 3.31-3.48, with
  1 - alpha^2 + beta where the text has - beta. One factorisation less, but the output's spread lacks the process noise
  of this step, and the covariance is the plain difference P - K C'.

Sigma points come in pairs, mean +- sqrt(c) l_k with l_k the columns of the Cholesky factor and c = N + chi. Their
images Y+ and Y- enter through differences and sums,

    odd_k = Y+ - Y-,   even_k = Y+ + Y- - 2 y_hat,   even_0 = sqrt(4 c W0c) (Y_0 - y_hat),

because then the weighted sum of the covariance is a plain product, (odd odd' + even even') / (4 c), that cannot be
indefinite.

Where the image of every sigma point repeats one element of the point itself (a parameter that the model keeps; an
output that is a state), mean and covariance of that element are known exactly and taken from the belief, not summed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.belief import Belief, Correction, Function, Innovation
from ohmward.filters.kalman import gain
from ohmward.filters.linear_algebra import cholesky, mirror_lower
from ohmward.filters.shapes import require_shape


class Scaling(NamedTuple):
    """Shape of the sigma-point set; the defaults are those of [T].

    alpha: spread of the points, > 0.
    beta: knowledge of the distribution; 2 for a Gaussian.
    kappa: second spread, > -N.
    """

    alpha: float = 0.85
    beta: float = 2.0
    kappa: float = 0.0


class Weights(NamedTuple):
    """Weights of 2 N + 1 sigma points.

    spread: c = N + chi = alpha^2 (N + kappa), the squared distance of the points in standard deviations.
    mean_0, cov_0: of the central point, chi / c and chi / c + 1 - alpha^2 + beta.
    side: of every other point, 1 / (2 c).
    pair: of a product of differences or of sums of a pair, 1 / (4 c).
    """

    spread: float
    mean_0: float
    cov_0: float
    side: float
    pair: float


class SigmaPoints(NamedTuple):
    """Sigma points of a belief about n states.

    points: (2 n + 1, n), the mean, then mean + sqrt(c) l_k for k = 1 ... n, then mean - sqrt(c) l_k.
    offsets: (n, n), lower triangle; column k is sqrt(c) l_k.
    weights: of the points.
    """

    points: np.ndarray
    offsets: np.ndarray
    weights: Weights


class Image(NamedTuple):
    """What a function makes of a belief's sigma points.

    mean: (m,).
    odd: (m, n), differences of the pairs, divided by `unit`.
    even: (m, n + 1), sums of the pairs about twice the mean, and the central point.
    unit: (m,), 2 for an element that repeats a state, whose differences are twice its offsets, else 1.
    weights: of the sigma points.
    repeats: for each of m elements the index of the state that it repeats at every sigma point, or None.
    """

    mean: np.ndarray
    odd: np.ndarray
    even: np.ndarray
    unit: np.ndarray
    weights: Weights
    repeats: tuple[int | None, ...]


DEFAULT = Scaling()


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
    x = transform(f, draw(belief, scaling))
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
    differences of the outputs, (D - K G) (D - K G)' / c + K (even even' / (4 c) + R) K'.
    """
    sigma = draw(belief, scaling)
    output = _output(transform(h, sigma), y, R)
    S = mirror_lower(covariance(output, output, belief.cov) + R)
    K = gain(covariance(identity(sigma), output, belief.cov), S)
    nu = y - output.mean
    A, pair = sigma.offsets - K * (0.5 * output.unit) @ output.odd, sigma.weights.pair
    cov = 4 * pair * (A @ A.T) + K @ (pair * (output.even @ output.even.T) + R) @ K.T
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
    sigma = draw(belief, scaling)
    propagated = [f(point) for point in sigma.points]
    x = image(propagated, sigma)
    require_shape("f(x)", x.mean, (n,))
    output = _output(image([h(point) for point in propagated], sigma), y, R)
    prior = Belief(x.mean, mirror_lower(covariance(x, x, belief.cov) + Q))
    S = mirror_lower(covariance(output, output, belief.cov) + R)
    C = covariance(x, output, belief.cov)
    K = gain(C, S)
    nu = y - output.mean
    posterior = Belief(prior.mean + K @ nu, mirror_lower(prior.cov - K @ C.T))
    return prior, Correction(posterior, Innovation(nu, S), K)


def output_covariance(belief: Belief, h: Function, scaling: Scaling = DEFAULT) -> np.ndarray:
    """Covariance P_yy (m, m) of h(x) under the belief, without measurement noise."""
    output = transform(h, draw(belief, scaling))
    return mirror_lower(covariance(output, output, belief.cov))


def weights(n: int, scaling: Scaling = DEFAULT) -> Weights:
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
    mean_0 = 1 - n / spread
    cov_0 = mean_0 + 1 - alpha**2 + beta
    if cov_0 < 0:
        raise InputError(
            f"the central covariance weight must be >= 0 but is {cov_0:.3g} for {scaling}, n = {n}; "
            "with beta = 2 and kappa = 0 choose alpha between 0.52 and 1.93"
        )
    return Weights(spread, mean_0, cov_0, 0.5 / spread, 0.25 / spread)


def covariance(a: Image, b: Image, P: np.ndarray) -> np.ndarray:
    """Covariance (m_a, m_b) of two images of the same sigma points, drawn from a belief with covariance P (n, n).

    Elements that both repeat a state have exactly the covariance of those states.
    """
    summed = a.weights.pair * np.outer(a.unit, b.unit) * (a.odd @ b.odd.T + a.even @ b.even.T)
    return np.array(
        [
            [summed[i, j] if p is None or q is None else P[p, q] for j, q in enumerate(b.repeats)]
            for i, p in enumerate(a.repeats)
        ]
    )


def draw(belief: Belief, scaling: Scaling = DEFAULT) -> SigmaPoints:
    """The sigma points of a belief."""
    n = len(belief.mean)
    require_shape("belief.cov", belief.cov, (n, n))
    w = weights(n, scaling)
    offsets, _ = cholesky(belief.cov, scale=math.sqrt(w.spread))
    return SigmaPoints(np.vstack([belief.mean, belief.mean + offsets.T, belief.mean - offsets.T]), offsets, w)


def transform(function: Function, sigma: SigmaPoints) -> Image:
    """The image of the sigma points under a function from (n,) to (m,)."""
    return image([function(point) for point in sigma.points], sigma)


def image(images: Sequence[np.ndarray], sigma: SigmaPoints) -> Image:
    """Mean, differences and sums of what a function has made of each sigma point, 2 n + 1 times (m,)."""
    Y, (points, offsets, w) = np.array(images), sigma
    n = len(offsets)
    sums, differences = Y[1 : n + 1] + Y[n + 1 :], Y[1 : n + 1] - Y[n + 1 :]
    mean = w.mean_0 * Y[0] + w.side * sums.sum(axis=0)
    even = np.column_stack([(sums - 2 * mean).T, math.sqrt(w.cov_0 / w.pair) * (Y[0] - mean)])
    repeats = tuple(_repeated_state(column, points) for column in Y.T)
    return Image(
        _replaced(mean, points[0], repeats),
        _replaced(differences.T, offsets, repeats),
        _replaced(even, np.zeros((n, n + 1)), repeats),
        np.array([1.0 if state is None else 2.0 for state in repeats]),
        w,
        repeats,
    )


def identity(sigma: SigmaPoints) -> Image:
    """The image under x -> x."""
    n = len(sigma.offsets)
    return Image(sigma.points[0], sigma.offsets, np.zeros((n, n + 1)), np.full(n, 2.0), sigma.weights, tuple(range(n)))


def _repeated_state(column: np.ndarray, points: np.ndarray) -> int | None:
    """The state whose values at the sigma points are the very elements of `column`, if there is one."""
    matches = (state for state, values in enumerate(points.T) if all(map(_same, column, values)))
    return next(matches, None)


def _replaced(summed: np.ndarray, exact: np.ndarray, repeats: tuple[int | None, ...]) -> np.ndarray:
    """`summed` with the rows that repeat a state replaced by that state's row of `exact`."""
    return np.array([row if state is None else exact[state] for row, state in zip(summed, repeats, strict=True)])


def _same(a: object, b: object) -> bool:
    """The same traced scalar, or equal numbers; comparing traced scalars by value would be a branch on data."""
    return a is b or (isinstance(a, float) and isinstance(b, float) and a == b)


def _output(output: Image, y: np.ndarray, R: np.ndarray) -> Image:
    """`output`, once it is sure that y and R fit it."""
    m = len(output.mean)
    require_shape("y", y, (m,))
    require_shape("R", R, (m, m))
    return output
