"""Circuit for given time constants, by linear least squares: resistances, hysteresis and OCV correction at once.

With the SoC known, the time constants, the hysteresis rate gamma and the activation K fixed,

    V = OCV(soc) + c(soc) + (T - T_0) e(soc) + ms D(soc) h + r0(soc, sign i) i + sum_j v_j,   v_j driven by r_j(soc) i,

is linear in r0_discharge, r0_charge, r_1 ... r_n on a grid of SoC, in the scale ms of the hysteresis, in a correction
c of the OCV curve and one e of its change with temperature on knots, and in the states v_j and h at the start of each
record. The prior of the chemistry regularises and gives the posterior covariance; resistances are >= 0 (active set).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.chemistries import CELL_V, ChemistryPrior, CurvePrior
from ohmward.battery.identification.fit_samples import COARSEST_S, FitSamples, hysteresis_along, pair_steps, scan
from ohmward.battery.identification.soc_axis import axis_bridge
from ohmward.battery.models.noise import on_soc_grid
from ohmward.battery.models.ocv import OcvCurve, correlation, hat
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import RESISTANCE_GRID, CircuitInput, Thevenin, ohmic_drop, transfer_share
from ohmward.battery.posterior import (
    ENTROPY_KNOTS,
    ENTROPY_LENGTH,
    ENTROPY_SHARE,
    OCV_KNOTS,
    Gaussian,
    Unknowns,
    gauss_newton,
    hessian,
    pseudo_huber,
    robust_weights,
    voltage_variance,
)
from ohmward.filters.consistency import BAND_95
from ohmward.optional import require
from ohmward.trace import Kernel, linearize

#: Smaller currents, as a share of 1 C, show no resistance.
COVERED_RATE = 0.02
#: Number of sets of columns that are kept: one of the rates about which a derivative is taken, and others beside it.
_MOST_SETS, _MOST_PAIRS = 4, 3
#: Time for which a current must have flowed near a state of charge [s].
_COVERED_S = 10.0


class Rates(NamedTuple):
    """Parameters that the voltage is not linear in, by their names in `Thevenin`."""

    tau_s: tuple[float, ...]  #: (n,) time constants
    hysteresis_rate: float  #: gamma
    #: of r0, of r_1 ... r_n and of the time constants.
    activation_K: float = 0.0
    pair_activation_K: float = 0.0
    tau_activation_K: float = 0.0
    #: the drop beyond which r0 i grows as its logarithm; None for one in proportion to the current
    transfer_V: float | None = None
    empty_activation_K: float = 0.0  #: additional one of r_1 ... r_n at empty, the chemistry's.
    net_charge_hysteresis: bool = False  #: True where the hysteresis follows the net charge
    hysteresis_activation_K: float = 0.0  #: of the hysteresis voltage, the chemistry's


def circuit_unknowns(pairs: int, records: int, hysteresis: bool, entropy: bool = False) -> Unknowns:
    """Layout of the vector x (K,) of the linear unknowns.

    r0_discharge, r0_charge, r_1 ... r_n on RESISTANCE_GRID, each in its `block`; the scale ms of the hysteresis; the
    OCV correction on OCV_KNOTS [V], that of its change with temperature on ENTROPY_KNOTS [V/K]; and for each record
    v_1 ... v_n (and h with hysteresis) at its start.

    pairs: number n of RC pairs; records: number of records; hysteresis: True where the OCV curve has any; entropy: True
    where the temperature of the curve is corrected as well.
    """
    return Unknowns(
        {
            "resistances": (2 + pairs) * RESISTANCE_GRID.size,
            "hysteresis": int(hysteresis),
            "ocv": OCV_KNOTS.size,
            "entropy": entropy * ENTROPY_KNOTS.size,
            **{f"start {k}": pairs + hysteresis for k in range(records)},
        }
    )


def block(j: int) -> slice:
    """Places of one resistance along SoC: 0 r0_discharge, 1 r0_charge, 1 + j r_j."""
    return slice(j * RESISTANCE_GRID.size, (j + 1) * RESISTANCE_GRID.size)


class RecordColumns:
    """Columns of the voltage of one record: voltage = ocv(soc) + columns @ x.

    A numerical derivative varies one rate at a time, so that the columns of the latest rates are kept.
    """

    def __init__(self, samples: FitSamples, ocv: OcvCurve, capacity_Ah: float, reference_degC: float) -> None:
        self.samples = samples
        one_ohm = (1.0, 1.0)
        self._unit = Thevenin(capacity_Ah, ocv, one_ohm, one_ohm, (), (), reference_degC=reference_degC)
        self._ohmic = lru_cache(_MOST_SETS)(self._make_ohmic)
        self._pair = lru_cache(_MOST_PAIRS * _MOST_SETS)(self._make_pair)
        self._hysteresis = lru_cache(_MOST_SETS)(self._make_hysteresis)

    def at(self, rates: Rates, unknowns: Unknowns, record: int) -> np.ndarray:
        """(N, K) columns at these rates; record: its number among those of the unknowns."""
        # written and solved column by column
        A, group = np.zeros((self.samples.soc.size, unknowns.size), order="F"), unknowns.group
        start = group(f"start {record}").start
        one = rates._replace(tau_s=(), transfer_V=None, hysteresis_rate=0.0)
        of_resistances = one._replace(pair_activation_K=0.0, tau_activation_K=0.0)
        A[:, : block(1).stop] = self._ohmic(of_resistances)
        for j, tau_s in enumerate(rates.tau_s):
            columns = self._pair(one._replace(activation_K=0.0, tau_s=(tau_s,)))
            A[:, block(2 + j)] = columns[:, :-1]
            A[:, start + j] = columns[:, -1]
        A[:, group("ocv")] = self._curve
        if unknowns.sizes["entropy"]:
            A[:, group("entropy")] = self._entropy
        if unknowns.sizes["hysteresis"]:
            of_hysteresis = of_resistances._replace(activation_K=0.0, hysteresis_rate=rates.hysteresis_rate)
            columns = self._hysteresis(of_hysteresis)
            A[:, group("hysteresis")] = columns[:, :1]
            A[:, start + len(rates.tau_s)] = columns[:, 1]
        return A

    def _circuit(self, rates: Rates) -> Thevenin:
        """The circuit is linear in its resistances: those of 1 ohm give the columns."""
        one_ohm = self._unit.r0_discharge_ohm
        return replace(self._unit, r_ohm=(one_ohm,) * len(rates.tau_s), **rates._asdict())

    def _make_ohmic(self, rates: Rates) -> np.ndarray:
        s = self.samples
        drop_V = ohmic_drop(s.soc, CircuitInput(s.current_A, s.temperature_degC), self._circuit(rates))
        along_soc = hat(s.soc, RESISTANCE_GRID) * drop_V[:, None]
        charging = s.current_A[:, None] > 0
        return np.hstack([np.where(charging, 0.0, along_soc), np.where(charging, along_soc, 0.0)])

    def _make_pair(self, rates: Rates) -> np.ndarray:
        """The voltage by the resistance along SoC, and by the voltage at the start."""
        (step,) = pair_steps(self.samples, self._circuit(rates))
        driven = scan(step.decay, hat(self.samples.soc_before, RESISTANCE_GRID) * step.drive_V[:, None])
        return np.column_stack([driven, np.cumprod(step.decay)])

    def _make_hysteresis(self, rates: Rates) -> np.ndarray:
        """The voltage by the scale, and by the state at the start.

        A state that saturates is not linear in its start; the mean slope between the branches takes its place.
        """
        circuit = self._circuit(rates)
        gap_V = circuit.hysteresis_V_at(self.samples.soc, self.samples.temperature_degC)
        low, middle, high = hysteresis_along(self.samples, circuit, (-1.0, 0.0, 1.0)).T
        return np.column_stack([gap_V * middle, gap_V * 0.5 * (high - low)])

    @cached_property
    def _curve(self) -> np.ndarray:
        return hat(self.samples.soc, OCV_KNOTS)

    @cached_property
    def _entropy(self) -> np.ndarray:
        warmer_K = self.samples.temperature_degC - self._unit.ocv.reference_degC
        return warmer_K[:, None] * hat(self.samples.soc, ENTROPY_KNOTS)


def pair_names(pairs: int) -> Sequence[str]:
    """Names of the resistances along SoC, in the order of the blocks."""
    return ("r0_discharge_ohm", "r0_charge_ohm", *(f"r{j}_ohm" for j in range(1, pairs + 1)))


def covered(samples: Sequence[FitSamples], capacity_Ah: float) -> np.ndarray:
    """(21,) bool: True where a current flowed within 2.5 % of that SoC for at least 10 s in all."""
    half = 0.5 * (RESISTANCE_GRID[1] - RESISTANCE_GRID[0])
    time_s = np.zeros(RESISTANCE_GRID.size)
    for s in samples:
        flows = np.abs(s.mean_current_A) > COVERED_RATE * capacity_Ah
        near = np.abs(s.soc - RESISTANCE_GRID[:, None]) <= half
        time_s += near @ np.where(flows, s.dt_s, 0.0)
    return time_s >= _COVERED_S


#: Error of the curve over half the gap of its branches: the true curve lies between them, not always in the middle.
_GAP_SHARE = 0.5


def nuisance_prior(
    prior: ChemistryPrior, unknowns: Unknowns, ocv: OcvCurve, at_rest: list[bool], volts: float
) -> Gaussian:
    """The prior of all but the resistances: hysteresis, OCV correction, states at the start of each record.

    at_rest: for each record, True where it starts with a rest.
    volts: voltage of the battery over that of a lithium-ion cell.
    """
    precision, information = np.zeros((unknowns.size, unknowns.size)), np.zeros(unknowns.size)
    group, hysteresis = unknowns.group, unknowns.sizes["hysteresis"]
    mean, std = prior.hysteresis.share
    precision[group("hysteresis"), group("hysteresis")] += 1 / std**2
    information[group("hysteresis")] += mean / std**2
    precision[group("ocv"), group("ocv")] += ocv_precision(prior.curve, ocv, volts)
    if unknowns.sizes["entropy"]:
        entropy_cov = entropy_std(prior, ocv, volts) ** 2 * correlation(ENTROPY_KNOTS, ENTROPY_LENGTH)
        precision[group("entropy"), group("entropy")] += np.linalg.inv(entropy_cov)
    for record, rests in enumerate(at_rest):
        where, pairs = group(f"start {record}"), unknowns.sizes[f"start {record}"] - hysteresis
        start_V = np.full(pairs, volts * (prior.rest_V if rests else prior.start_V))
        std_of_start = np.concatenate([start_V, np.full(hysteresis, prior.hysteresis.share.mean)])
        precision[where, where] += np.diag(1 / std_of_start**2)
    return Gaussian(precision, information)


def resistance_prior(prior: ChemistryPrior, unknowns: Unknowns, levels: np.ndarray, shapes: np.ndarray) -> Gaussian:
    """The prior of the resistances: random walks along SoC about a level, r0 alike in both directions.

    levels: (2 + n,) level of each resistance [ohm]; shapes: (2 + n, 21) its expected shape along SoC, about 1.
    """
    precision, information = np.zeros((unknowns.size, unknowns.size)), np.zeros(unknowns.size)
    differences = np.diff(np.eye(RESISTANCE_GRID.size), axis=0)
    for j, level in enumerate(levels):
        at, std = block(j), prior.walk_share * level * np.sqrt(np.diff(RESISTANCE_GRID) / 0.1)
        walk = differences / std[:, None] / shapes[j]
        precision[at, at] += walk.T @ walk
        if j != 1:
            row = 1 / (level * RESISTANCE_GRID.size * shapes[j])
            precision[at, at] += np.outer(row, row)
            information[at] += row
    tie = np.eye(RESISTANCE_GRID.size) / (prior.direction_share * levels[0]) ** 2
    for one, other in ((block(0), block(1)), (block(1), block(0))):
        precision[one, one] += tie
        precision[one, other] -= tie
    return Gaussian(precision, information)


def ocv_precision(prior: CurvePrior, ocv: OcvCurve, volts: float) -> np.ndarray:
    """(K, K) precision of the OCV correction on OCV_KNOTS: exponential correlation, wider where steep."""
    slope = np.abs(np.gradient(np.asarray(ocv.mean_V(OCV_KNOTS, ocv.reference_degC)), OCV_KNOTS))
    gap = np.asarray(ocv.hysteresis_at(OCV_KNOTS))
    axis = np.hypot(prior.soc_std, prior.middle_soc_std * axis_bridge(OCV_KNOTS))
    own_V = np.hypot(volts * on_soc_grid(prior.std_V, OCV_KNOTS), prior.line_std_V)
    std = np.sqrt(own_V**2 + (axis * slope) ** 2 + (_GAP_SHARE * gap) ** 2)
    return np.linalg.inv(std[:, None] * correlation(OCV_KNOTS, prior.soc_length) * std)


def entropy_std(prior: ChemistryPrior, ocv: OcvCurve, volts: float) -> float:
    """Prior standard deviation of the change of the OCV curve with temperature [V/K].

    Less where low-rate tests at two temperatures have measured it.
    """
    usual = volts * prior.ocv_std_V_per_K
    return ENTROPY_SHARE * usual if any(ocv.temperature_V_per_K) else usual


#: Error of the model and the sensor in a sample of a lithium-ion cell [V].
VOLTAGE_STD_V = 0.003
#: Steps after which the robust weights have settled.
_STEPS = 2
#: Keeps the equations for the levels of resistances without data from being singular.
_RIDGE = 1e-9
#: Smallest level of a resistance, as a share of the sum of all: a prior of no width would hold it at 0.
_SMALLEST_SHARE = 0.02
#: Relative error of the model's overpotential.
_OVERPOTENTIAL_SHARE = 0.03
#: Half step of SoC for the slope of the curve.
_DSOC = 0.005
#: A time constant slower than the records can show is held at that limit to within about this share.
_BEYOND_LOG_STD = 0.02
#: Currents below this share of the largest keep the direction of the one before.
_SAME_DIRECTION_SHARE = 0.03

#: Drop of a lithium-ion cell beyond which its ohmic part grows as a logarithm: two electrodes whose resistance is
#: charge transfer alone have 4 R T / F = 0.1 V, NCA cells from 10 to -10 degC 0.7 to 1 V.
_TRANSFER_V, _TRANSFER_LOG_STD, _TRANSFERS_V = 0.4, 0.8, (0.05, 5.0)
#: Bounds of gamma, and gamma of a circuit without hysteresis, on which nothing depends.
_HYSTERESIS_RATES, _UNUSED_RATE = (5.0, 200.0), 20.0
#: Unit of activations in the search, so that all its parameters are of order 1, and bounds of the activations [K].
_ACTIVATION_UNIT_K, _ACTIVATIONS_K = 1000.0, (-5000.0, 15000.0)
#: Columns of R_0 in both directions.
_OHMIC = slice(0, block(1).stop)
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


@dataclass(frozen=True, eq=False)
class CircuitProblem:
    """Data and prior of a fit."""

    samples: tuple[FitSamples, ...]  #: the thinned records
    ocv: OcvCurve  #: the curve to correct
    capacity_Ah: float
    prior: ChemistryPrior  #: of circuit and curve
    slow_shape: np.ndarray  #: (21,) expected shape of the slowest resistance along SoC, about 1
    reference_degC: float  #: temperature at which the resistances hold
    fit_activation: bool  #: True where currents flowed at temperatures that differ enough
    #: slowest time constant that the records can show; one that is usual for the chemistry is allowed too
    longest_tau_s: float = np.inf
    #: drop beyond which the ohmic part grows as a logarithm, where that is not sought; None if it is linear
    transfer_V: float | None = None
    branches: tuple[FitSamples, ...] = ()  #: low-rate branches, fitted like the records

    @property
    def seeks_transfer(self) -> bool:
        """True where the records show the charge transfer in the ohmic drop, and the chemistry leaves it open."""
        return self.fit_activation and self.prior.seeks_transfer

    @property
    def sought(self) -> tuple[SoughtRate, ...]:
        """The rates that the records show, in the order of the search."""
        prior, found = self.prior, []
        if any(self.ocv.hysteresis_V):
            usual = prior.hysteresis
            found.append(SoughtRate("hysteresis_rate", *_HYSTERESIS_RATES, usual.rate, usual.rate_log_std))
        if self.fit_activation:
            unit = _ACTIVATION_UNIT_K
            found += [
                SoughtRate(name, *_ACTIVATIONS_K, own.mean, own.std / unit, unit, as_log=False)
                for name, own in zip(_ACTIVATIONS, prior.activations_K, strict=True)
            ]
        if self.seeks_transfer:
            low, mean, high = (self.volts * V for V in (_TRANSFERS_V[0], _TRANSFER_V, _TRANSFERS_V[1]))
            found.append(SoughtRate("transfer_V", low, high, mean, _TRANSFER_LOG_STD, self.volts))
        return tuple(found)

    def usual_rates(self, tau_s: tuple[float, ...]) -> Rates:
        """Rates with these time constants and all others as usual for the chemistry.

        A hysteresis that low-rate branches show follows the net charge. With tests at two temperatures, growth in the
        cold is fitted as activations of the resistances.
        """
        usual, branches = self.prior, bool(self.branches)
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

    @cached_property
    def columns(self) -> tuple[RecordColumns, ...]:
        """The columns of each record."""
        return tuple(RecordColumns(s, self.ocv, self.capacity_Ah, self.reference_degC) for s in self.records)

    @cached_property
    def volts(self) -> float:
        """Voltage of the battery over that of a lithium-ion cell."""
        return float(np.nanmean(np.concatenate([s.voltage_V for s in self.samples]))) / CELL_V

    def joined(self, column: str) -> np.ndarray:
        """(M,) column of all records."""
        return np.concatenate([getattr(s, column) for s in self.records])

    @cached_property
    def measured(self) -> np.ndarray:
        """(M,) bool: samples with a voltage."""
        return np.isfinite(self.joined("voltage_V"))

    @cached_property
    def targets_V(self) -> np.ndarray:
        """(M,) measured voltage less the OCV curve; 0 where there is no voltage, which has no weight."""
        ocv_V = np.asarray(self.ocv.mean_V(self.joined("soc"), self.joined("temperature_degC")))
        return np.where(self.measured, self.joined("voltage_V") - ocv_V, 0.0)

    @cached_property
    def std_V(self) -> np.ndarray:
        """(M,) standard deviation of a sample, larger in and after a charge where its reaction is another one."""
        soc = self.joined("soc")
        slope_V = (self.ocv.mean_V(soc + _DSOC, ROOM_DEGC) - self.ocv.mean_V(soc - _DSOC, ROOM_DEGC)) / (2 * _DSOC)
        white_V = VOLTAGE_STD_V * self.volts
        variance_V2 = voltage_variance(white_V, _OVERPOTENTIAL_SHARE, self.targets_V**2, slope_V)
        factor = np.concatenate([error_factor(self.prior, s) for s in self.records])
        return np.asarray(factor * np.sqrt(variance_V2))

    @cached_property
    def weights(self) -> np.ndarray:
        """(M,) number of samples that each counts as: those within 60 s share one error, one without a voltage none."""
        return np.where(self.measured, self.joined("weight_s") / COARSEST_S, 0.0)


@cache
def _transferred() -> Kernel:
    """Ohmic drop with charge transfer over V_t, and its derivative, by the drop without it over V_t."""

    def step(nothing: Any, x: Any) -> tuple[Any, tuple[Any, Any]]:
        value, slope = linearize(lambda z: z * transfer_share(z[0]), np.array([x]))
        return nothing, (value[0], slope[0, 0])

    return Kernel(step, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class CircuitSolution:
    """Solution for the linear unknowns at given rates."""

    unknowns: Unknowns
    rates: Rates
    x: np.ndarray  #: (K,)
    rows: LinearRows  #: of all records, about x
    prior: Gaussian  #: of x
    residual_V: tuple[np.ndarray, ...]  #: for each record (N,), nan without a voltage
    of_prior: np.ndarray  #: deviations of unknowns and rates from their priors over their standard deviations

    @property
    def problem(self) -> CircuitProblem:
        """The problem of which it is the solution."""
        return self.rows.system.problem

    @property
    def weighted(self) -> np.ndarray:
        """(M,) residuals and prior over their standard deviations; the search minimises the sum of their squares."""
        return np.concatenate([self.rows.residual, self.of_prior])

    @cached_property
    def precision(self) -> np.ndarray:
        """(K, K) posterior precision of x."""
        return hessian(self.rows.columns, self.prior)

    @cached_property
    def cov(self) -> np.ndarray:
        """(K, K) posterior covariance of x."""
        return np.linalg.inv(self.precision)

    @property
    def score(self) -> float:
        """Minus twice the log evidence, smaller is better: the cost, and by how much the data narrowed the unknowns."""
        narrowed = np.linalg.slogdet(self.precision)[1] - np.linalg.slogdet(self.prior.precision)[1]
        return float(self.weighted @ self.weighted + narrowed)


class LinearRows(NamedTuple):
    """Rows of all records, linear about a point."""

    residual: np.ndarray  #: (M,) over the standard deviations
    system: LinearSystem  #: whose columns these are
    scale: np.ndarray  #: (M,) inverse standard deviations
    slope: np.ndarray  #: (M,) derivative of the ohmic drop by the drop without charge transfer
    cost: float
    residual_V: np.ndarray  #: (M,)
    robust: np.ndarray  #: (M,) weights of outlying samples, 1 for none
    misfit: float  #: sum of squares of the residuals over their standard deviations, outlying samples counting in full

    @property
    def columns(self) -> np.ndarray:
        """(M, K) derivatives over the standard deviations: large, and made only where they are used."""
        columns = self.system.columns * self.scale[:, None]
        columns[:, _OHMIC] *= self.slope[:, None]
        return columns

    def information(self, x: np.ndarray) -> Gaussian:
        """Information of the records on the unknowns, from the rows about x: their normal equations."""
        columns = self.columns
        return Gaussian(columns.T @ columns, columns.T @ (self.residual + columns @ x))


class LinearSystem(NamedTuple):
    """Voltage minus OCV curve of all records as y = A x, but for the nonlinear ohmic drop of charge transfer."""

    problem: CircuitProblem  #: y and its standard deviations
    columns: np.ndarray  #: A (M, K)
    transfer_V: float | None  #: V_t of the ohmic drop; None if it is linear

    def about(self, x: np.ndarray, robust: np.ndarray | None = None) -> LinearRows:
        """The rows about x; robust: (M,) their weights, None finds them.

        V_t f(u) with u = r0 i / V_t is d r0 i + V_t (f(u) - d u), where d is the derivative of f at u.
        """
        problem, expected_V = self.problem, self.columns @ x
        slope = np.ones(expected_V.size)
        if self.transfer_V is not None:
            straight_V = self.columns[:, _OHMIC] @ x[_OHMIC]
            drop, slope = _transferred().scan(0.0, straight_V / self.transfer_V)[1]
            expected_V += self.transfer_V * drop - straight_V
        residual_V = problem.targets_V - expected_V
        square = (residual_V / problem.std_V) ** 2
        robust = robust_weights(square) if robust is None else robust
        scale = np.sqrt(problem.weights * robust) / problem.std_V
        cost, misfit = float(problem.weights @ pseudo_huber(robust)), float(problem.weights @ square)
        return LinearRows(scale * residual_V, self, scale, slope, cost, residual_V, robust, misfit)


def solve(
    problem: CircuitProblem, rates: Rates, near: CircuitSolution | None = None, most_steps: int = _STEPS
) -> CircuitSolution:
    """The linear unknowns for given rates, resistances >= 0.

    near: a solution for other rates, whose robust weights are kept and about whose resistances the ohmic drop is
        linear; None finds both.
    """
    hysteresis = any(problem.ocv.hysteresis_V)
    unknowns = circuit_unknowns(len(rates.tau_s), len(problem.records), hysteresis, problem.fit_activation)
    columns = [record.at(rates, unknowns, k) for k, record in enumerate(problem.columns)]
    system = LinearSystem(problem, np.vstack(columns), rates.transfer_V)
    bounded = unknowns.group("hysteresis").stop

    def minimum(H: np.ndarray, gradient: np.ndarray, x: np.ndarray) -> np.ndarray:
        return _nonnegative(H, H @ x + gradient, bounded)

    if near is None:
        nothing = np.zeros(unknowns.size)
        first = system.about(nothing, np.ones(problem.weights.size)).information(nothing)
        prior = _prior(problem, unknowns, first)
        start = _nonnegative(*prior.times(first), bounded)
        x, rows = gauss_newton(system.about, prior, start, most_steps, minimum)
    else:
        of_records = system.about(near.x, near.rows.robust).information(near.x)
        prior = _prior(problem, unknowns, of_records)
        x = _nonnegative(*prior.times(of_records), bounded)
        rows = system.about(x, near.rows.robust)
    ends = np.cumsum([s.soc.size for s in problem.records])
    of_records_V = np.split(np.where(problem.measured, rows.residual_V, np.nan), ends[:-1])
    residual_V = tuple(of_records_V[: len(problem.samples)])
    L = np.linalg.cholesky(prior.precision)
    of_prior = np.concatenate([L.T @ x - np.linalg.solve(L, prior.information), _rates_residual(problem, rates)])
    return CircuitSolution(unknowns, rates, x, rows, prior, residual_V, of_prior)


def error_factor(prior: ChemistryPrior, samples: FitSamples) -> np.ndarray:
    """(N,) error of the model over a lithium-ion cell's: larger in a charge and the rest after it, most with gas."""
    charging = np.where(samples.soc > prior.gassing_soc, prior.gassing_factor, prior.charging_factor)
    return np.where(last_direction(samples.mean_current_A) > 0, charging, prior.discharging_factor)


def last_direction(current_A: np.ndarray) -> np.ndarray:
    """(N,) 1 in a charge and the rest after it, -1 in a discharge and the rest after it, 0 before any."""
    flows = np.abs(current_A) > _SAME_DIRECTION_SHARE * np.abs(current_A).max()
    last = np.maximum.accumulate(np.where(flows, np.arange(current_A.size), -1))
    return np.where(last >= 0, np.sign(current_A[np.maximum(last, 0)]), 0.0)


def _prior(problem: CircuitProblem, unknowns: Unknowns, records: Gaussian) -> Gaussian:
    """The prior about the levels that the resistances would have if each had its expected shape along SoC.

    records: their information on x.
    """
    shapes = np.ones((unknowns.sizes["resistances"] // RESISTANCE_GRID.size, RESISTANCE_GRID.size))
    if len(shapes) > 2:
        shapes[-1] = problem.slow_shape
    at_rest = [s.starts_at_rest for s in problem.records]
    nuisance = nuisance_prior(problem.prior, unknowns, problem.ocv, at_rest, problem.volts)
    levels = _levels(shapes, *nuisance.times(records))
    return nuisance.times(resistance_prior(problem.prior, unknowns, levels, shapes))


def _levels(shapes: np.ndarray, H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(2 + n,) levels [ohm] of resistances with given shapes (2 + n, 21) in the normal equations H x = g."""
    blocks, others = len(shapes), g.size - shapes.size
    S = np.zeros((g.size, blocks + others))
    for j in range(blocks):
        S[block(j), j] = shapes[j]
    S[shapes.size :, blocks:] = np.eye(others)
    ridge = np.zeros(S.shape[1])
    ridge[:blocks] = _RIDGE * np.trace(S.T @ H @ S) / S.shape[1]
    levels = _nonnegative(S.T @ H @ S + np.diag(ridge), S.T @ g, blocks)[:blocks]
    levels[:2] = max(levels[0], levels[1])
    return np.maximum(levels, _SMALLEST_SHARE * max(levels[1:].sum(), 1e-6))


def _nonnegative(H: np.ndarray, g: np.ndarray, bounded: int) -> np.ndarray:
    """Minimum of x' H x / 2 - g' x with the first `bounded` unknowns >= 0; the others are eliminated first."""
    nnls = require("scipy.optimize", "identification").nnls

    b, f = slice(0, bounded), slice(bounded, None)
    back = np.linalg.solve(H[f, f], np.column_stack([H[f, b], g[f]]))
    by_bounded, constant = back[:, :-1], back[:, -1]
    L = np.linalg.cholesky(H[b, b] - H[b, f] @ by_bounded)
    x, _ = nnls(L.T, np.linalg.solve(L, g[b] - H[b, f] @ constant), maxiter=50 * bounded)
    return np.concatenate([x, constant - by_bounded @ x])


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
