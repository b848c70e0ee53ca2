"""Linear unknowns of the circuit: their layout, the columns of the voltage, and the prior that cells have in common.

With the SoC known, the time constants, the hysteresis rate gamma and the activation K fixed,

    V = OCV(soc) + c(soc) + (T - T_0) e(soc) + ms D(soc) h + r0(soc, sign i) i + sum_j v_j,   v_j driven by r_j(soc) i,

is linear in r0_discharge, r0_charge, r_1 ... r_n on a grid of SoC, in the scale ms of the hysteresis, in a correction
c of the OCV curve and one e of its change with temperature on knots, and in the states v_j and h at the start of each
record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import ChemistryPrior, CurvePrior
from ohmward.battery.identification.fit_samples import FitSamples, hysteresis_along, pair_steps, scan
from ohmward.battery.identification.soc_axis import axis_bridge
from ohmward.battery.models.noise import on_soc_grid
from ohmward.battery.models.ocv import OcvCurve, correlation, hat
from ohmward.battery.models.thevenin import RESISTANCE_GRID, CircuitInput, Thevenin, ohmic_drop
from ohmward.battery.posterior import ENTROPY_KNOTS, ENTROPY_LENGTH, ENTROPY_SHARE, OCV_KNOTS, Gaussian, Unknowns

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
    for j in range(levels.size):
        add_rows(precision, block(j), _walk(prior, levels[j]) / shapes[j])
        if j != 1:
            row = 1 / (levels[j] * RESISTANCE_GRID.size * shapes[j])
            add_rows(precision, block(j), row[None, :])
            information[block(j)] += row
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


def add_rows(precision: np.ndarray, where: slice, rows: np.ndarray) -> None:
    """Add the precision of `rows` @ x[where] ~ N(., 1) to precision (K, K), in place."""
    precision[where, where] += rows.T @ rows


def _walk(prior: ChemistryPrior, level: float) -> np.ndarray:
    """(20, 21) differences of neighbouring grid points over their standard deviation."""
    std = prior.walk_share * level * np.sqrt(np.diff(RESISTANCE_GRID) / 0.1)
    return np.diff(np.eye(RESISTANCE_GRID.size), axis=0) / std[:, None]
