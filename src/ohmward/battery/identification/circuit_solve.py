"""The circuit for given time constants: resistances, hysteresis and OCV correction by linear least squares at once.

The priors of `circuit_prior` regularise and give the posterior covariance; resistances are >= 0 (active set); samples
that do not fit count less (pseudo-Huber, by reweighting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.circuit_design import RESISTANCE_GRID, ParameterLayout, Rates, design
from ohmward.battery.identification.circuit_prior import (
    CELL_V,
    CircuitPrior,
    GaussianPrior,
    nuisance_prior,
    resistance_prior,
)
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC

VOLTAGE_STD_V = 0.003
CORRELATION_S = 60.0
_ROBUST_AT = 2.0
_REWEIGHTINGS = 3
_RIDGE = 1e-9
_SMALLEST_SHARE = 0.02
_OVERPOTENTIAL_SHARE = 0.03
_SOC_STD = 0.003
_DSOC = 0.005
_REST_SHARE = 0.03


class CircuitProblem(NamedTuple):
    """All that the fit is given.

    samples: the thinned records; ocv: the curve to correct; capacity_Ah; prior: what is known before.
    slow_shape: (21,) expected course of the slowest resistance along SoC, about 1.
    reference_degC: temperature at which the resistances hold.
    fit_activation: whether the records differ enough in temperature.
    volts: voltage of the battery over that of a lithium-ion cell.
    """

    samples: tuple[FitSamples, ...]
    ocv: OcvCurve
    capacity_Ah: float
    prior: CircuitPrior
    slow_shape: np.ndarray
    reference_degC: float
    fit_activation: bool

    @property
    def volts(self) -> float:
        """Voltage of the battery over that of a lithium-ion cell."""
        return float(np.nanmean(np.concatenate([s.voltage_V for s in self.samples]))) / CELL_V


@dataclass(frozen=True, eq=False)
class CircuitSolution:
    """The linear unknowns for given rates.

    x: (K,); precision, prior_precision: (K, K) with and without the data;
    residual_V: for each record (N,), nan without a voltage.
    weighted: (M,) residuals and prior over their standard deviations, the sum of squares being the cost.
    robust: for each record (N,) weights of outlying samples, 1 for none.
    """

    layout: ParameterLayout
    rates: Rates
    x: np.ndarray
    precision: np.ndarray
    prior_precision: np.ndarray
    residual_V: tuple[np.ndarray, ...]
    weighted: np.ndarray
    robust: tuple[np.ndarray, ...]

    @property
    def cost(self) -> float:
        """Sum of squares that the search minimises."""
        return float(self.weighted @ self.weighted)

    @cached_property
    def cov(self) -> np.ndarray:
        """(K, K) posterior covariance of x."""
        return np.linalg.inv(self.precision)

    @property
    def score(self) -> float:
        """What the starts compete by, smaller is better: minus twice the log evidence.

        Beside the cost it charges for flexibility, by how much the data had to narrow the unknowns.
        """
        narrowed = np.linalg.slogdet(self.precision)[1] - np.linalg.slogdet(self.prior_precision)[1]
        return float(self.cost + narrowed)


def solve(
    problem: CircuitProblem, rates: Rates, robust: Sequence[np.ndarray] | None = None, reweightings: int = _REWEIGHTINGS
) -> CircuitSolution:
    """The linear unknowns for given rates, resistances >= 0.

    robust: weights of the samples from an earlier solution; None finds them by reweighting (pseudo-Huber).
    """
    layout = ParameterLayout(len(rates.tau_s), len(problem.samples), any(problem.ocv.hysteresis_V))
    columns = [
        design(s, k, layout, rates, problem.ocv, problem.capacity_Ah, problem.reference_degC)
        for k, s in enumerate(problem.samples)
    ]
    targets = [_target(problem, s) for s in problem.samples]
    plain = [_weights(problem, s) for s in problem.samples]
    weights = [w * np.sqrt(r) for w, r in zip(plain, robust, strict=True)] if robust else plain
    prior = _prior(problem, layout, columns, targets, weights)
    for _ in range(1 if robust else reweightings):
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
    deviations = [w * r for w, r in zip(weights, residuals, strict=True)]
    weighted = np.concatenate(
        [*deviations, _prior_residual(prior, x), _rates_residual(problem.prior, rates, layout.hysteresis)]
    )
    return CircuitSolution(layout, rates, x, H, prior.precision, residual_V, weighted, kept)


def _target(problem: CircuitProblem, samples: FitSamples) -> np.ndarray:
    """(N,) measured voltage less the OCV curve; 0 where there is no voltage, which has no weight."""
    ocv_V = np.asarray(problem.ocv.mean_V(samples.soc, samples.temperature_degC))
    return np.where(np.isfinite(samples.voltage_V), samples.voltage_V - ocv_V, 0.0)


def _weights(problem: CircuitProblem, samples: FitSamples) -> np.ndarray:
    """(N,) one over the standard deviation of a sample; samples closer than 60 s share one error.

    The model is wrong by a share of the overpotential and, along SoC, where the OCV curve is steep; more so in and
    after a charge if the prior says that this is another reaction.
    """
    share = np.sqrt(np.minimum(samples.dt_s, CORRELATION_S) / CORRELATION_S)
    above_V = problem.ocv.mean_V(samples.soc + _DSOC, ROOM_DEGC)
    below_V = problem.ocv.mean_V(samples.soc - _DSOC, ROOM_DEGC)
    slope_V = (above_V - below_V) / (2 * _DSOC)
    terms_V = [
        np.full(samples.soc.size, VOLTAGE_STD_V * problem.volts),
        _OVERPOTENTIAL_SHARE * _target(problem, samples),
        _SOC_STD * np.asarray(slope_V),
    ]
    std_V = np.sqrt(sum(term**2 for term in terms_V))
    charging = np.where(last_direction(samples.mean_current_A) > 0, problem.prior.charging_factor, 1.0)
    return np.where(np.isfinite(samples.voltage_V), share, 0.0) / (charging * std_V)


def last_direction(current_A: np.ndarray) -> np.ndarray:
    """(N,) 1 in a charge and the rest after it, -1 in a discharge and the rest after it, 0 before any."""
    flows = np.abs(current_A) > _REST_SHARE * np.abs(current_A).max()
    last = np.maximum.accumulate(np.where(flows, np.arange(current_A.size), -1))
    return np.where(last >= 0, np.sign(current_A[np.maximum(last, 0)]), 0.0)


def _robust(residual_V: np.ndarray, std_V: float) -> np.ndarray:
    """(N,) weights of the pseudo-Huber loss: 1 for small residuals, like 1/|r| beyond two standard deviations."""
    return 1 / np.sqrt(1 + (residual_V / (_ROBUST_AT * std_V)) ** 2)


def _prior(
    problem: CircuitProblem,
    layout: ParameterLayout,
    columns: list[np.ndarray],
    targets: list[np.ndarray],
    weights: list[np.ndarray],
) -> GaussianPrior:
    """The prior about the levels that the resistances would have if each took its expected course along SoC."""
    shapes = np.ones((layout.blocks, RESISTANCE_GRID.size))
    if layout.pairs:
        shapes[-1] = problem.slow_shape
    at_rest = [s.starts_at_rest for s in problem.samples]
    nuisance = nuisance_prior(problem.prior, layout, problem.ocv, at_rest, problem.volts)
    H, g = _normal_equations(columns, targets, weights, nuisance)
    levels = _levels(layout, shapes, H, g)
    return nuisance.times(resistance_prior(problem.prior, layout, levels, shapes))


def _levels(layout: ParameterLayout, shapes: np.ndarray, H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(2 + n,) levels [ohm] of resistances with given courses (2 + n, 21) in the normal equations H x = g."""
    S = np.zeros((layout.size, layout.blocks + layout.size - layout.resistances.stop))
    for j in range(layout.blocks):
        S[layout.block(j), j] = shapes[j]
    S[layout.resistances.stop :, layout.blocks :] = np.eye(layout.size - layout.resistances.stop)
    ridge = np.zeros(S.shape[1])
    ridge[: layout.blocks] = _RIDGE * np.trace(S.T @ H @ S) / S.shape[1]
    levels = _bounded(S.T @ H @ S + np.diag(ridge), S.T @ g, layout.blocks)[: layout.blocks]
    levels[:2] = max(levels[0], levels[1])
    return np.maximum(levels, _SMALLEST_SHARE * max(levels[1:].sum(), 1e-6))


def _normal_equations(
    columns: list[np.ndarray], targets: list[np.ndarray], weights: list[np.ndarray], prior: GaussianPrior
) -> tuple[np.ndarray, np.ndarray]:
    H, g = prior.precision.copy(), prior.information.copy()
    for A, y, w in zip(columns, targets, weights, strict=True):
        weighted = A * w[:, None]
        H += weighted.T @ weighted
        g += weighted.T @ (y * w)
    return H, g


def _bounded_count(layout: ParameterLayout) -> int:
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


def _prior_residual(prior: GaussianPrior, x: np.ndarray) -> np.ndarray:
    """(K,) deviation of x from its prior over its standard deviations."""
    L = np.linalg.cholesky(prior.precision)
    return L.T @ x - np.linalg.solve(L, prior.information)


def _rates_residual(prior: CircuitPrior, rates: Rates, hysteresis: bool) -> np.ndarray:
    """Deviations of the slowest of several time constants and of the hysteresis rate from their priors.

    Diffusion makes the slowest pair of a battery slow, and hysteresis turns within a few per cent of SoC. What a log
    shows of diffusion is easily fitted by a faster pair together with a slow hysteresis, which then fails on longer
    loads and at the SoC where there were no data.
    """
    slow = rates.tau_s[-1:] if len(rates.tau_s) > 1 else ()
    deviations = [np.log(tau / prior.slow_tau_s) / prior.slow_tau_log_std for tau in slow]
    if hysteresis:
        deviations.append(np.log(rates.hysteresis_rate / prior.hysteresis_rate) / prior.hysteresis_rate_log_std)
    return np.array(deviations)
