"""Stage 6: the circuit whose voltage fits whole records best, by separable least squares (variable projection).

For given time constants the rest is linear (`circuit_design`), and is solved at once with its prior and with all
resistances >= 0; the search outside runs over the logarithms of time constants and rates only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.circuit_design import RESISTANCE_GRID, Layout, Rates, design
from ohmward.battery.identification.circuit_prior import CELL_V, Gaussian, Prior, make_prior
from ohmward.battery.identification.samples import Samples
from ohmward.battery.ocv import OcvCurve

VOLTAGE_STD_V = 0.003
CORRELATION_S = 60.0
HYSTERESIS_RATES = (5.0, 200.0)
_ACTIVATION_UNIT_K = 1000.0
_ROBUST_AT = 2.0
_ROUNDS = 2
_REWEIGHTINGS = 3
_EVALUATIONS = 12
_STEP = 0.02
_SMALLEST_SHARE = 0.02
_STARTS: dict[int, tuple[tuple[float, ...], ...]] = {
    0: ((),),
    1: ((15.0,), (60.0,), (300.0,), (1500.0,)),
    2: ((15.0, 300.0), (20.0, 1500.0), (60.0, 3000.0)),
    3: ((5.0, 60.0, 1500.0), (10.0, 200.0, 2500.0)),
}


class Problem(NamedTuple):
    """All that the fit is given.

    samples: the thinned records; ocv: the curve to correct; capacity_Ah; prior: what is known before.
    slow_shape: (21,) expected course of the slowest resistance along SoC, about 1.
    reference_degC: temperature at which the resistances hold.
    fit_activation: whether the records differ enough in temperature.
    volts: voltage of the battery over that of a lithium-ion cell.
    """

    samples: tuple[Samples, ...]
    ocv: OcvCurve
    capacity_Ah: float
    prior: Prior
    slow_shape: np.ndarray
    reference_degC: float
    fit_activation: bool

    @property
    def volts(self) -> float:
        """Voltage of the battery over that of a lithium-ion cell."""
        return float(np.nanmean(np.concatenate([s.voltage_V for s in self.samples]))) / CELL_V


class Solution(NamedTuple):
    """The linear unknowns for given rates.

    x: (K,), cov: (K, K) posterior covariance; residual_V: for each record (N,), nan without a voltage.
    weighted: (M,) residuals and prior over their standard deviations, the sum of squares being the cost.
    robust: for each record (N,) weights of outlying samples, 1 for none.
    """

    layout: Layout
    rates: Rates
    x: np.ndarray
    cov: np.ndarray
    residual_V: tuple[np.ndarray, ...]
    weighted: np.ndarray
    robust: tuple[np.ndarray, ...]

    @property
    def cost(self) -> float:
        """Sum of squares that the search minimises."""
        return float(self.weighted @ self.weighted)


class CircuitFit(NamedTuple):
    """The best solution, the covariance (n, n) of its search parameters, and all starts that were tried."""

    solution: Solution
    search: np.ndarray
    search_cov: np.ndarray
    starts: tuple[tuple[Rates, float], ...]


def fit_circuit(problem: Problem, pairs: int, progress: Callable[[float], None] | None = None) -> CircuitFit:
    """The circuit with `pairs` RC pairs that fits the records best.

    progress: called with the share done, from 0 to 1.
    """
    from scipy.optimize import least_squares

    report = progress or (lambda share: None)
    low, high = _bounds(problem, pairs)
    tried = []
    starts = [np.clip(_to_search(rates, problem), low + _STEP, high - _STEP) for rates in _starts(problem, pairs)]
    for k, start in enumerate(starts):
        tried.append(solve(problem, _to_rates(start, problem, pairs)))
        report(0.4 * (k + 1) / len(starts))
    best = min(tried, key=lambda s: s.cost)
    theta = starts[tried.index(best)]
    jacobian = np.zeros((1, 0))
    for k in range(_ROUNDS if theta.size else 0):
        weights = best.robust

        def residuals(t: np.ndarray, weights: tuple[np.ndarray, ...] = weights) -> np.ndarray:
            return solve(problem, _to_rates(t, problem, pairs), weights).weighted

        found = least_squares(residuals, theta, bounds=(low, high), diff_step=_STEP, x_scale=0.3, max_nfev=_EVALUATIONS)
        theta, jacobian = found.x, found.jac
        best = solve(problem, _to_rates(theta, problem, pairs))
        report(0.4 + 0.6 * (k + 1) / _ROUNDS)
    return CircuitFit(best, theta, _search_cov(jacobian), tuple((s.rates, s.cost) for s in tried))


def solve(problem: Problem, rates: Rates, robust: Sequence[np.ndarray] | None = None) -> Solution:
    """The linear unknowns for given rates, resistances >= 0.

    robust: weights of the samples from an earlier solution; None finds them by reweighting (pseudo-Huber).
    """
    layout = Layout(len(rates.tau_s), len(problem.samples), any(problem.ocv.hysteresis_V))
    columns = [
        design(s, k, layout, rates, problem.ocv, problem.capacity_Ah, problem.reference_degC)
        for k, s in enumerate(problem.samples)
    ]
    targets = [_target(problem, s) for s in problem.samples]
    plain = [_weights(problem, s) for s in problem.samples]
    weights = [w * np.sqrt(r) for w, r in zip(plain, robust, strict=True)] if robust else plain
    prior = _prior(problem, layout, columns, targets, weights)
    for _ in range(1 if robust else _REWEIGHTINGS):
        H, g = _normal_equations(columns, targets, weights, prior)
        x = _bounded(H, g, _bounded_count(layout))
        residuals = [y - A @ x for A, y in zip(columns, targets, strict=True)]
        if not robust:
            found = [_robust(r, VOLTAGE_STD_V * problem.volts) for r in residuals]
            weights = [w * np.sqrt(r) for w, r in zip(plain, found, strict=True)]
    kept = tuple(robust) if robust else tuple(found)
    residual_V = tuple(
        np.where(np.isfinite(s.voltage_V), r, np.nan) for s, r in zip(problem.samples, residuals, strict=True)
    )
    weighted = np.concatenate([*(w * r for w, r in zip(weights, residuals, strict=True)), _prior_residual(prior, x)])
    return Solution(layout, rates, x, np.linalg.inv(H), residual_V, weighted, kept)


def _target(problem: Problem, samples: Samples) -> np.ndarray:
    """(N,) measured voltage less the OCV curve; 0 where there is no voltage, which has no weight."""
    ocv_V = np.asarray(problem.ocv.mean_V(samples.soc, samples.temperature_degC))
    return np.where(np.isfinite(samples.voltage_V), samples.voltage_V - ocv_V, 0.0)


def _weights(problem: Problem, samples: Samples) -> np.ndarray:
    """(N,) one over the standard deviation of a sample; samples closer than 60 s share one error."""
    share = np.sqrt(np.minimum(samples.dt_s, CORRELATION_S) / CORRELATION_S)
    return np.where(np.isfinite(samples.voltage_V), share, 0.0) / (VOLTAGE_STD_V * problem.volts)


def _robust(residual_V: np.ndarray, std_V: float) -> np.ndarray:
    """(N,) weights of the pseudo-Huber loss: 1 for small residuals, like 1/|r| beyond two standard deviations."""
    return 1 / np.sqrt(1 + (residual_V / (_ROBUST_AT * std_V)) ** 2)


def _prior(
    problem: Problem, layout: Layout, columns: list[np.ndarray], targets: list[np.ndarray], weights: list[np.ndarray]
) -> Gaussian:
    """The prior around the levels that constant resistances would have."""
    shapes = np.ones((layout.blocks, RESISTANCE_GRID.size))
    if layout.pairs:
        shapes[-1] = problem.slow_shape
    levels = _levels(layout, shapes, columns, targets, weights)
    at_rest = [s.starts_at_rest for s in problem.samples]
    return make_prior(problem.prior, layout, levels, shapes, problem.ocv, at_rest, problem.volts)


def _levels(
    layout: Layout, shapes: np.ndarray, columns: list[np.ndarray], targets: list[np.ndarray], weights: list[np.ndarray]
) -> np.ndarray:
    """(2 + n,) resistances [ohm] that fit best if each had its expected course along SoC."""
    from scipy.optimize import nnls

    S = np.zeros((layout.size, layout.blocks))
    for j in range(layout.blocks):
        S[layout.block(j), j] = shapes[j]
    rows = np.vstack([(A @ S) * w[:, None] for A, w in zip(columns, weights, strict=True)])
    levels, _ = nnls(rows, np.concatenate([y * w for y, w in zip(targets, weights, strict=True)]))
    ohmic = max(levels[0], levels[1])
    levels[:2] = ohmic
    return np.maximum(levels, _SMALLEST_SHARE * max(levels[1:].sum(), 1e-6))


def _normal_equations(
    columns: list[np.ndarray], targets: list[np.ndarray], weights: list[np.ndarray], prior: Gaussian
) -> tuple[np.ndarray, np.ndarray]:
    H, g = prior.precision.copy(), prior.information.copy()
    for A, y, w in zip(columns, targets, weights, strict=True):
        weighted = A * w[:, None]
        H += weighted.T @ weighted
        g += weighted.T @ (y * w)
    return H, g


def _bounded_count(layout: Layout) -> int:
    """How many unknowns, from the first, must not be negative: the resistances and the scale of the hysteresis."""
    return layout.scale.stop


def _bounded(H: np.ndarray, g: np.ndarray, bounded: int) -> np.ndarray:
    """Minimum of x' H x / 2 - g' x with the first `bounded` unknowns >= 0; the others are eliminated first."""
    from scipy.optimize import nnls

    b, f = slice(0, bounded), slice(bounded, None)
    back = np.linalg.solve(H[f, f], np.column_stack([H[f, b], g[f]]))
    L = np.linalg.cholesky(H[b, b] - H[b, f] @ back[:, :-1])
    x, _ = nnls(L.T, np.linalg.solve(L, g[b] - H[b, f] @ back[:, -1]), maxiter=50 * bounded)
    return np.concatenate([x, back[:, -1] - back[:, :-1] @ x])


def _prior_residual(prior: Gaussian, x: np.ndarray) -> np.ndarray:
    """(K,) deviation of x from its prior over its standard deviations."""
    L = np.linalg.cholesky(prior.precision)
    return L.T @ x - np.linalg.solve(L, prior.information)


def _starts(problem: Problem, pairs: int) -> list[Rates]:
    gammas = (8.0, 40.0) if any(problem.ocv.hysteresis_V) else (20.0,)
    return [Rates(tau, gamma) for tau in _STARTS[pairs] for gamma in gammas]


def _to_search(rates: Rates, problem: Problem) -> np.ndarray:
    """log tau_1, log of the ratios of the further ones, log gamma, activation in 1000 K: the search parameters."""
    tau = np.log(np.array(rates.tau_s))
    tail = [np.log(rates.hysteresis_rate)] if any(problem.ocv.hysteresis_V) else []
    return np.array([*tau[:1], *np.diff(tau), *tail, *([2.0] if problem.fit_activation else [])])


def _to_rates(theta: np.ndarray, problem: Problem, pairs: int) -> Rates:
    tau = tuple(float(t) for t in np.exp(np.cumsum(theta[:pairs])))
    rest = list(theta[pairs:])
    gamma = float(np.exp(rest.pop(0))) if any(problem.ocv.hysteresis_V) else 20.0
    return Rates(tau, gamma, _ACTIVATION_UNIT_K * float(rest.pop(0)) if problem.fit_activation else 0.0)


def _bounds(problem: Problem, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the search: tau_1 not below half a sampling interval, each further one at least twice the last."""
    fastest_s = min(float(np.quantile(s.dt_s[1:], 0.05)) for s in problem.samples)
    longest_s = max(s.time_s[-1] - s.time_s[0] for s in problem.samples)
    low, high = [], []
    if pairs:
        low.append(np.log(max(0.5 * fastest_s, 0.05)))
        high.append(np.log(min(20000.0, max(longest_s, 4 * fastest_s))))
    low += [np.log(2.0)] * (pairs - 1)
    high += [np.log(1000.0)] * (pairs - 1)
    if any(problem.ocv.hysteresis_V):
        low.append(np.log(HYSTERESIS_RATES[0]))
        high.append(np.log(HYSTERESIS_RATES[1]))
    if problem.fit_activation:
        low.append(0.0)
        high.append(10.0)
    return np.array(low), np.array(high)


def _search_cov(jacobian: np.ndarray) -> np.ndarray:
    """(n, n) covariance of the search parameters; the pseudo-inverse where a parameter has no effect."""
    return np.linalg.pinv(jacobian.T @ jacobian)
