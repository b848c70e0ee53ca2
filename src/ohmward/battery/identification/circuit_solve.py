"""Linear least squares for given time constants: resistances, hysteresis and OCV correction at once.

The priors of `circuit_prior` regularise and give the posterior covariance; resistances are >= 0 (active set); samples
that do not fit count less (pseudo-Huber, by reweighting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import CELL_V
from ohmward.battery.identification.circuit_design import RESISTANCE_GRID, ParameterLayout, Rates, design
from ohmward.battery.identification.circuit_prior import (
    CircuitPrior,
    GaussianPrior,
    nuisance_prior,
    resistance_prior,
)
from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import transfer_share
from ohmward.filters.consistency import BAND_95
from ohmward.optional import require
from ohmward.trace import Kernel, linearize

#: Error of the model and the sensor in a sample of a lithium-ion cell [V].
VOLTAGE_STD_V = 0.003
#: Samples closer than this share one error of the model [s].
CORRELATION_S = 60.0
#: Residuals beyond so many standard deviations count less.
_ROBUST_RESIDUAL = 2.0
#: The robust weights have settled after so many rounds.
_REWEIGHTINGS = 3
#: Keeps the levels of resistances that no data show from being singular.
_RIDGE = 1e-9
#: Least level of a resistance, as a share of the sum of all: a prior of no width would hold it at 0.
_SMALLEST_SHARE = 0.02
#: Relative error of the model's overpotential.
_OVERPOTENTIAL_SHARE = 0.03
#: Error of the SoC axis, and the half step for the slope of the curve there.
_SOC_STD = 0.003
_DSOC = 0.005
#: A time constant beyond what the records can show is held there within about this share.
_BEYOND_LOG_STD = 0.02
#: Currents below this share of the largest keep the direction of the one before.
_SAME_DIRECTION_SHARE = 0.03


#: The drop beyond which the ohmic part grows as a logarithm, of a lithium-ion cell: two electrodes whose resistance is
#: charge transfer alone have 4 R T / F = 0.1 V, NCA cells from 10 to -10 degC 0.7 to 1 V.
_TRANSFER_V, _TRANSFER_LOG_STD, _TRANSFERS_V = 0.4, 0.8, (0.05, 5.0)
#: Bounds of gamma, and gamma of a circuit without hysteresis; nothing depends on it.
_HYSTERESIS_RATES, _UNUSED_RATE = (5.0, 200.0), 20.0
#: The search counts activations in this unit, so that all its parameters are of order 1 [K], and within these bounds.
_ACTIVATION_UNIT_K, _ACTIVATIONS_K = 1000.0, (-5000.0, 15000.0)
#: Names of the activations in `Rates`.
_ACTIVATIONS = ("activation_K", "pair_activation_K", "tau_activation_K")


class SoughtRate(NamedTuple):
    """One of the `Rates` that the search varies, beside the time constants."""

    name: str  #: of its field
    #: bounds of its value
    low: float
    high: float
    #: its prior; the standard deviation is that of the search parameter
    mean: float
    std: float
    unit: float = 1.0
    as_log: bool = True  #: True where the search parameter is the logarithm of the value in its unit

    def parameter(self, value: float) -> float:
        """Search parameter of a value."""
        return float(np.log(value / self.unit)) if self.as_log else value / self.unit

    def value(self, parameter: float) -> float:
        """Value of a search parameter."""
        return self.unit * float(np.exp(parameter) if self.as_log else parameter)

    def deviation(self, value: float) -> float:
        """Deviation of a value from its prior over its standard deviation."""
        return (self.parameter(value) - self.parameter(self.mean)) / self.std


class CircuitProblem(NamedTuple):
    """Data and prior of a fit."""

    #: the thinned records; ocv: the curve to correct; capacity_Ah; prior: of circuit and curve
    samples: tuple[FitSamples, ...]

    ocv: OcvCurve
    capacity_Ah: float
    prior: CircuitPrior
    slow_shape: np.ndarray  #: (21,) expected course of the slowest resistance along SoC, about 1
    reference_degC: float  #: temperature at which the resistances hold
    fit_activation: bool  #: True where currents flowed at temperatures that differ enough
    #: slowest time constant that the records can show; one that is usual for the chemistry is taken too
    longest_tau_s: float = np.inf
    #: that of the ohmic drop where it is not sought; None for one in proportion to the current
    transfer_V: float | None = None
    branches: tuple[FitSamples, ...] = ()  #: low-rate branches, fitted like the records

    @property
    def seeks_transfer(self) -> bool:
        """True where the records show how charge transfer bends the ohmic drop, and the chemistry does not tell."""
        return self.fit_activation and self.prior.seeks_transfer

    @property
    def sought(self) -> tuple[SoughtRate, ...]:
        """The rates that the records show, in the order of the search."""
        prior, found = self.prior, []
        if any(self.ocv.hysteresis_V):
            std = prior.hysteresis_rate_log_std
            found.append(SoughtRate("hysteresis_rate", *_HYSTERESIS_RATES, prior.hysteresis_rate, std))
        if self.fit_activation:
            unit = _ACTIVATION_UNIT_K
            found += [
                SoughtRate(name, *_ACTIVATIONS_K, usual.mean, usual.std / unit, unit, as_log=False)
                for name, usual in zip(_ACTIVATIONS, prior.untested.activations_K, strict=True)
            ]
        if self.seeks_transfer:
            low, mean, high = (self.volts * V for V in (_TRANSFERS_V[0], _TRANSFER_V, _TRANSFERS_V[1]))
            found.append(SoughtRate("transfer_V", low, high, mean, _TRANSFER_LOG_STD, self.volts))
        return tuple(found)

    def usual_rates(self, tau_s: tuple[float, ...]) -> Rates:
        """Rates with these time constants and all others as usual for the chemistry.

        A hysteresis that low-rate branches show follows the net charge. Tests at two temperatures fit what grows in the
        cold as activations of the resistances.
        """
        usual, branches = self.prior.untested, bool(self.branches)
        ohmic_K, pairs_K, tau_K = (A.mean for A in usual.activations_K)
        return Rates(
            tau_s=tau_s,
            hysteresis_rate=_UNUSED_RATE,
            activation_K=ohmic_K,
            pair_activation_K=pairs_K,
            tau_activation_K=tau_K,
            transfer_V=_TRANSFER_V * self.volts if self.seeks_transfer else self.transfer_V,
            empty_activation_K=usual.empty_activation_K.mean,
            net_charge_hysteresis=branches,
            hysteresis_activation_K=usual.hysteresis_activation_K if branches and not self.fit_activation else 0.0,
        )

    @property
    def records(self) -> tuple[FitSamples, ...]:
        """All that the circuit is fitted to: the records, then the low-rate branches."""
        return (*self.samples, *self.branches)

    @property
    def volts(self) -> float:
        """Voltage of the battery over that of a lithium-ion cell."""
        return float(np.nanmean(np.concatenate([s.voltage_V for s in self.samples]))) / CELL_V


@cache
def _transferred() -> Kernel:
    """An ohmic drop over the V_t of charge transfer, and its derivative, by the drop without it over V_t."""

    def step(nothing: Any, x: Any) -> tuple[Any, tuple[Any, Any]]:
        value, slope = linearize(lambda z: z * transfer_share(z[0]), np.array([x]))
        return nothing, (value[0], slope[0, 0])

    return Kernel(step, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class CircuitSolution:
    """Solution for the linear unknowns at given rates."""

    layout: ParameterLayout
    rates: Rates
    x: np.ndarray  #: (K,)
    #: (K, K) with and without the data
    precision: np.ndarray
    prior_precision: np.ndarray
    residual_V: tuple[np.ndarray, ...]  #: for each record (N,), nan without a voltage
    weighted: np.ndarray  #: (M,) residuals and prior over their standard deviations, the sum of squares being the cost
    robust: tuple[np.ndarray, ...]  #: for each record (N,) weights of outlying samples, 1 for none
    misfit: float  #: sum of squares of the residuals over their standard deviations, outlying samples counting in full

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
        """Minus twice the log evidence, smaller is better: the cost, and by how much the data narrowed the unknowns."""
        narrowed = np.linalg.slogdet(self.precision)[1] - np.linalg.slogdet(self.prior_precision)[1]
        return float(self.cost + narrowed)


class LinearSystem(NamedTuple):
    """Voltage less OCV curve of every record as y = A x, where the ohmic columns of A count `slopes` times."""

    columns: list[np.ndarray]  #: A (N, K) of each record
    targets: list[np.ndarray]  #: y (N,)
    weights: list[np.ndarray]  #: (N,) one over the standard deviation of each sample
    ohmic: slice  #: the columns of R_0
    slopes: list[np.ndarray]  #: (N,) of the ohmic drop along one in proportion to the current

    def about(self, x: np.ndarray, transfer_V: float) -> LinearSystem:
        """The system whose ohmic drop is that of charge transfer, linear about the resistances in x.

        V_t f(u) with u = r0 i / V_t is d r0 i + V_t (f(u) - d u), where d is the derivative of f at u.
        """
        slopes, targets = [], []
        for A, y in zip(self.columns, self.targets, strict=True):
            u = A[:, self.ohmic] @ x[self.ohmic] / transfer_V
            drop, slope = _transferred().scan(0.0, u)[1]
            slopes.append(slope)
            targets.append(y - transfer_V * (drop - slope * u))
        return self._replace(slopes=slopes, targets=targets)

    def weighed_by(self, robust: Sequence[np.ndarray]) -> LinearSystem:
        """The system with the variance of each sample divided by its robust weight."""
        return self._replace(weights=[w * np.sqrt(r) for w, r in zip(self.weights, robust, strict=True)])

    def information(self) -> GaussianPrior:
        """What the records say of x: the normal equations H x = g as precision H (K, K) and information g (K,)."""
        size = self.columns[0].shape[1]
        H, g = np.zeros((size, size)), np.zeros(size)
        for A, y, w, slope in zip(self.columns, self.targets, self.weights, self.slopes, strict=True):
            weighted = A * w[:, None]
            weighted[:, self.ohmic] *= slope[:, None]
            H += weighted.T @ weighted
            g += weighted.T @ (y * w)
        return GaussianPrior(H, g)

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Y - A x of each record, (N,) [V]."""
        rows = zip(self.columns, self.targets, self.slopes, strict=True)
        return [y - A @ x - (slope - 1.0) * (A[:, self.ohmic] @ x[self.ohmic]) for A, y, slope in rows]


def solve(
    problem: CircuitProblem, rates: Rates, near: CircuitSolution | None = None, reweightings: int = _REWEIGHTINGS
) -> CircuitSolution:
    """The linear unknowns for given rates, resistances >= 0.

    near: a solution for other rates, whose robust weights are kept and about whose resistances the ohmic drop is
        linear; None finds both in rounds (pseudo-Huber, Gauss-Newton).
    """
    hysteresis = any(problem.ocv.hysteresis_V)
    layout = ParameterLayout(len(rates.tau_s), len(problem.records), hysteresis, problem.fit_activation)
    plain = system = _linear_system(problem, layout, rates)
    if near is not None:
        system = _tangent(plain, rates, near.x).weighed_by(near.robust)
    of_records = system.information()
    prior = _prior(problem, layout, of_records)
    for k in range(reweightings if near is None else 1):
        H, g = prior.times(system.information() if k else of_records)
        x = _nonnegative(H, g, layout.scale.stop)
        tangent = _tangent(plain, rates, x)
        residuals = tangent.residuals(x)
        found = near.robust if near else [_pseudo_huber(r, VOLTAGE_STD_V * problem.volts) for r in residuals]
        system = tangent.weighed_by(found)
    measured = [np.isfinite(s.voltage_V) for s in problem.samples]  # the branches come after them
    residual_V = tuple(np.where(there, r, np.nan) for there, r in zip(measured, residuals, strict=False))
    deviations = [w * r for w, r in zip(system.weights, residuals, strict=True)]
    misfit = sum(float(np.square(w * r).sum()) for w, r in zip(plain.weights, residuals, strict=True))
    of_prior = [_prior_residual(prior, x), _rates_residual(problem, rates)]
    weighted = np.concatenate([*deviations, *of_prior])
    return CircuitSolution(layout, rates, x, H, prior.precision, residual_V, weighted, tuple(found), misfit)


def _linear_system(problem: CircuitProblem, layout: ParameterLayout, rates: Rates) -> LinearSystem:
    """The system of all records, weights from the standard deviations alone."""
    columns = [
        design(s, k, layout, rates, problem.ocv, problem.capacity_Ah, problem.reference_degC)
        for k, s in enumerate(problem.records)
    ]
    targets = [_target(problem, s) for s in problem.records]
    weights = [_weights(problem, s) for s in problem.records]
    ohmic = slice(layout.block(0).start, layout.block(1).stop)
    return LinearSystem(columns, targets, weights, ohmic, [np.ones_like(y) for y in targets])


def _tangent(plain: LinearSystem, rates: Rates, x: np.ndarray) -> LinearSystem:
    """The system about the resistances in x; as it is where the ohmic drop is in proportion to the current."""
    return plain if rates.transfer_V is None else plain.about(x, rates.transfer_V)


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
    return np.where(np.isfinite(samples.voltage_V), share, 0.0) / (error_factor(problem.prior, samples) * std_V)


def error_factor(prior: CircuitPrior, samples: FitSamples) -> np.ndarray:
    """(N,) error of the model over a lithium-ion cell's: larger in a charge and the rest after it, most with gas."""
    charging = np.where(samples.soc > prior.gassing_soc, prior.gassing_factor, prior.charging_factor)
    return np.where(last_direction(samples.mean_current_A) > 0, charging, prior.discharging_factor)


def last_direction(current_A: np.ndarray) -> np.ndarray:
    """(N,) 1 in a charge and the rest after it, -1 in a discharge and the rest after it, 0 before any."""
    flows = np.abs(current_A) > _SAME_DIRECTION_SHARE * np.abs(current_A).max()
    last = np.maximum.accumulate(np.where(flows, np.arange(current_A.size), -1))
    return np.where(last >= 0, np.sign(current_A[np.maximum(last, 0)]), 0.0)


def _pseudo_huber(residual_V: np.ndarray, std_V: float) -> np.ndarray:
    """(N,) weights of the pseudo-Huber loss: 1 for small residuals, like 1/|r| beyond two standard deviations."""
    return 1 / np.sqrt(1 + (residual_V / (_ROBUST_RESIDUAL * std_V)) ** 2)


def _prior(problem: CircuitProblem, layout: ParameterLayout, records: GaussianPrior) -> GaussianPrior:
    """The prior about the levels that the resistances would have if each took its expected course along SoC.

    records: what these say of x.
    """
    shapes = np.ones((layout.blocks, RESISTANCE_GRID.size))
    if layout.pairs:
        shapes[-1] = problem.slow_shape
    at_rest = [s.starts_at_rest for s in problem.records]
    nuisance = nuisance_prior(problem.prior, layout, problem.ocv, at_rest, problem.volts)
    levels = _levels(layout, shapes, *nuisance.times(records))
    return nuisance.times(resistance_prior(problem.prior, layout, levels, shapes))


def _levels(layout: ParameterLayout, shapes: np.ndarray, H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(2 + n,) levels [ohm] of resistances with given courses (2 + n, 21) in the normal equations H x = g."""
    S = np.zeros((layout.size, layout.blocks + layout.size - layout.resistances.stop))
    for j in range(layout.blocks):
        S[layout.block(j), j] = shapes[j]
    S[layout.resistances.stop :, layout.blocks :] = np.eye(layout.size - layout.resistances.stop)
    ridge = np.zeros(S.shape[1])
    ridge[: layout.blocks] = _RIDGE * np.trace(S.T @ H @ S) / S.shape[1]
    levels = _nonnegative(S.T @ H @ S + np.diag(ridge), S.T @ g, layout.blocks)[: layout.blocks]
    levels[:2] = max(levels[0], levels[1])
    return np.maximum(levels, _SMALLEST_SHARE * max(levels[1:].sum(), 1e-6))


def _nonnegative(H: np.ndarray, g: np.ndarray, bounded: int) -> np.ndarray:
    """Minimum of x' H x / 2 - g' x with the first `bounded` unknowns >= 0; the others are eliminated first."""
    nnls = require("scipy.optimize", "identification").nnls

    b, f = slice(0, bounded), slice(bounded, None)
    back = np.linalg.solve(H[f, f], np.column_stack([H[f, b], g[f]]))
    L = np.linalg.cholesky(H[b, b] - H[b, f] @ back[:, :-1])
    x, _ = nnls(L.T, np.linalg.solve(L, g[b] - H[b, f] @ back[:, -1]), maxiter=50 * bounded)
    return np.concatenate([x, back[:, -1] - back[:, :-1] @ x])


def _prior_residual(prior: GaussianPrior, x: np.ndarray) -> np.ndarray:
    """(K,) deviation of x from its prior over its standard deviations."""
    L = np.linalg.cholesky(prior.precision)
    return L.T @ x - np.linalg.solve(L, prior.information)


def _rates_residual(problem: CircuitProblem, rates: Rates) -> np.ndarray:
    """Deviations of the slowest of several time constants and of the other rates from their priors.

    Diffusion makes the slowest pair of a battery slow, and hysteresis turns within a few per cent of SoC. A faster pair
    with a slow hysteresis often fits a log as well, and then fails on longer loads and where there were no data.
    """
    prior = problem.prior
    slow = rates.tau_s[-1:] if len(rates.tau_s) > 1 else ()
    deviations = [np.log(tau / prior.slow_tau_s) / prior.slow_tau_log_std for tau in slow]
    if rates.tau_s:
        usual_s = prior.slow_tau_s * np.exp(BAND_95 * prior.slow_tau_log_std)
        beyond = rates.tau_s[-1] / max(problem.longest_tau_s, usual_s)
        deviations.append(np.log(max(beyond, 1.0)) / _BEYOND_LOG_STD)
    deviations += [rate.deviation(getattr(rates, rate.name)) for rate in problem.sought]
    return np.array(deviations)
