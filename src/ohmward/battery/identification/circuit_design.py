"""Design matrix of the circuit's voltage: linear in everything but time constants and rates.

With the SoC known, the time constants, the hysteresis rate gamma and the activation K fixed,

    V = OCV(soc) + c(soc) + (T - T_0) e(soc) + ms D(soc) h + r0(soc, sign i) i + sum_j v_j,   v_j driven by r_j(soc) i,

is linear in r0_discharge, r0_charge, r_1 ... r_n on a grid of SoC, in the scale ms of the hysteresis, in a correction
c of the OCV curve and one e of its change with temperature on knots, and in the states v_j and h at the start of each
record.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.identification.fit_samples import FitSamples
from ohmward.battery.identification.open_loop import hysteresis_decay, net_charge_hysteresis, scan
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import arrhenius_factor
from ohmward.battery.models.thevenin import emptying_factor

RESISTANCE_GRID = np.linspace(0.0, 1.0, 21)
OCV_KNOTS = np.concatenate(
    [[0.0, 0.01, 0.02, 0.03, 0.05, 0.075], np.linspace(0.1, 0.9, 17), [0.92, 0.94, 0.96, 0.97, 0.98, 0.99, 1.0]]
)
#: Entropy changes smoothly along SoC but for the stages of graphite, whose width this is.
ENTROPY_KNOTS = np.linspace(0.0, 1.0, 11)


class Rates(NamedTuple):
    """Parameters that the voltage is not linear in."""

    tau_s: tuple[float, ...]  #: (n,) time constants
    hysteresis_rate: float  #: gamma
    #: of r0, of r_1 ... r_n and of the time constants.
    activation_K: float = 0.0
    pair_activation_K: float = 0.0
    tau_activation_K: float = 0.0
    #: the drop beyond which r0 i grows as its logarithm; None for one in proportion to the current
    transfer_V: float | None = None
    empty_activation_K: float = 0.0  #: of r_1 ... r_n at empty beyond that, the chemistry's.
    net_charge_hysteresis: bool = False  #: True where the hysteresis follows the net charge
    hysteresis_activation_K: float = 0.0  #: of the hysteresis voltage, the chemistry's

    @property
    def activations_K(self) -> tuple[float, float, float]:
        """Activations of r0, of r_1 ... r_n and of the time constants."""
        return self.activation_K, self.pair_activation_K, self.tau_activation_K


class ParameterLayout(NamedTuple):
    """Layout of the vector x (K,) of the linear unknowns.

    pairs: number n of RC pairs; records: number of records; hysteresis: True where the OCV curve has any; entropy: True
    where the temperature of the curve is corrected as well.
    Resistances come first: r0_discharge, r0_charge, r_1 ... r_n on RESISTANCE_GRID; then ms (with hysteresis), the OCV
    correction on OCV_KNOTS, that of its change with temperature on ENTROPY_KNOTS (with entropy), and for each record
    v_1 ... v_n (and h with hysteresis) at its start.
    """

    pairs: int
    records: int
    hysteresis: bool
    entropy: bool = False

    @property
    def blocks(self) -> int:
        """Number of resistances along SoC."""
        return 2 + self.pairs

    @property
    def resistances(self) -> slice:
        """All resistances."""
        return slice(0, self.blocks * RESISTANCE_GRID.size)

    def block(self, j: int) -> slice:
        """One resistance along SoC: 0 r0_discharge, 1 r0_charge, 1 + j r_j."""
        return slice(j * RESISTANCE_GRID.size, (j + 1) * RESISTANCE_GRID.size)

    @property
    def scale(self) -> slice:
        """Scale ms of the hysteresis; empty without hysteresis."""
        return slice(self.resistances.stop, self.resistances.stop + self.hysteresis)

    @property
    def correction(self) -> slice:
        """Correction of the OCV curve on OCV_KNOTS [V]."""
        return slice(self.scale.stop, self.scale.stop + OCV_KNOTS.size)

    @property
    def entropic(self) -> slice:
        """Correction of the change of the OCV curve with temperature on ENTROPY_KNOTS [V/K]; empty without entropy."""
        return slice(self.correction.stop, self.correction.stop + self.entropy * ENTROPY_KNOTS.size)

    def initial(self, record: int) -> slice:
        """States at the start of a record."""
        width = self.pairs + self.hysteresis
        return slice(self.entropic.stop + record * width, self.entropic.stop + (record + 1) * width)

    @property
    def size(self) -> int:
        """Length K of x."""
        return self.initial(self.records).start


def design(
    samples: FitSamples,
    record: int,
    layout: ParameterLayout,
    rates: Rates,
    ocv: OcvCurve,
    capacity_Ah: float,
    reference_degC: float,
) -> np.ndarray:
    """(N, K) columns of one record: voltage = ocv(soc) + columns @ x."""
    A = np.zeros((samples.soc.size, layout.size))
    ohmic, pairs, faster = arrhenius_factors(samples.temperature_degC, rates, reference_degC)
    here = hat(samples.soc, RESISTANCE_GRID) * (ohmic * samples.current_A)[:, None]
    emptying = emptying_factor(samples.soc_before, samples.temperature_degC, rates.empty_activation_K, reference_degC)
    driven = hat(samples.soc_before, RESISTANCE_GRID) * (pairs * emptying * samples.mean_current_A)[:, None]
    A[:, layout.block(0)] = np.where(samples.current_A[:, None] > 0, 0.0, here)
    A[:, layout.block(1)] = np.where(samples.current_A[:, None] > 0, here, 0.0)
    initial = layout.initial(record).start
    for j, tau in enumerate(rates.tau_s):
        decay = np.exp(-samples.dt_s * faster / tau)
        A[:, layout.block(2 + j)] = scan(decay, (1 - decay)[:, None] * driven)
        A[:, initial + j] = np.cumprod(decay)
    A[:, layout.correction] = hat(samples.soc, OCV_KNOTS)
    if layout.entropy:
        warmer_K = samples.temperature_degC - ocv.reference_degC
        A[:, layout.entropic] = warmer_K[:, None] * hat(samples.soc, ENTROPY_KNOTS)
    if layout.hysteresis:
        wider = arrhenius_factor(samples.temperature_degC, rates.hysteresis_activation_K, reference_degC)
        gap_V = wider * ocv.hysteresis_at(samples.soc)
        h, of_start = _hysteresis(samples, rates, capacity_Ah)
        A[:, layout.scale] = (gap_V * h)[:, None]
        A[:, initial + layout.pairs] = gap_V * of_start
    return A


def _hysteresis(samples: FitSamples, rates: Rates, capacity_Ah: float) -> tuple[np.ndarray, np.ndarray]:
    """(N,) hysteresis state from the middle at the start, and what is left of a state at the start.

    A state that saturates is not linear in its start; the mean slope between the branches takes its place.
    """
    if rates.net_charge_hysteresis:
        low, middle, high = (
            net_charge_hysteresis(samples, capacity_Ah, rates.hysteresis_rate, start) for start in (-1.0, 0.0, 1.0)
        )
        return middle, 0.5 * (high - low)
    decay = hysteresis_decay(samples, capacity_Ah, rates.hysteresis_rate)
    return scan(decay, (1 - decay) * np.sign(samples.mean_current_A)), np.cumprod(decay)


def arrhenius_factors(temperature_degC: np.ndarray, rates: Rates, reference_degC: float) -> tuple[Any, Any, Any]:
    """Factors at each sample, (N,) or 1: of r0, of r_1 ... r_n, and of the rates 1 / tau_j."""
    ohmic_K, pairs_K, tau_K = rates.activations_K
    ohmic, pairs, faster = (arrhenius_factor(temperature_degC, A, reference_degC) for A in (ohmic_K, pairs_K, -tau_K))
    return ohmic, pairs, faster


def hat(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(N, K) weights of linear interpolation between the knots, held beyond the ends."""
    x = np.clip(x, knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = (x - knots[left]) / (knots[left + 1] - knots[left])
    weights = np.zeros((x.size, knots.size))
    rows = np.arange(x.size)
    weights[rows, left] = 1 - share
    weights[rows, left + 1] += share
    return weights


def pair_names(pairs: int) -> Sequence[str]:
    """Names of the resistances along SoC, in the order of the blocks."""
    return ("r0_discharge_ohm", "r0_charge_ohm", *(f"r{j}_ohm" for j in range(1, pairs + 1)))
