"""Design matrix of the circuit's voltage: linear in everything but time constants and rates.

With the SoC known, the time constants, the hysteresis rate gamma and the activation K fixed,

    V = OCV(soc) + c(soc) + (T - T_0) e(soc) + ms D(soc) h + r0(soc, sign i) i + sum_j v_j,   v_j driven by r_j(soc) i,

is linear in r0_discharge, r0_charge, r_1 ... r_n on a grid of SoC, in the scale ms of the hysteresis, in a correction
c of the OCV curve and one e of its change with temperature on knots, and in the states v_j and h at the start of each
record.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.fit_samples import FitSamples, hysteresis_along, pair_steps, scan
from ohmward.battery.models.ocv import OcvCurve, hat
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_drop
from ohmward.battery.posterior import ENTROPY_KNOTS, OCV_KNOTS

RESISTANCE_GRID = np.linspace(0.0, 1.0, 21)


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
    empty_activation_K: float = 0.0  #: of r_1 ... r_n at empty beyond that, the chemistry's.
    net_charge_hysteresis: bool = False  #: True where the hysteresis follows the net charge
    hysteresis_activation_K: float = 0.0  #: of the hysteresis voltage, the chemistry's


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
    # linear in the resistances: those of 1 ohm give the columns
    ones = (1.0, 1.0)
    unit = Thevenin(
        capacity_Ah,
        ocv,
        ones,
        ones,
        (ones,) * layout.pairs,
        reference_degC=reference_degC,
        **rates._replace(transfer_V=None)._asdict(),
    )
    A = np.zeros((samples.soc.size, layout.size))
    drop_V = ohmic_drop(samples.soc, CircuitInput(samples.current_A, samples.temperature_degC), unit)
    here, before = hat(samples.soc, RESISTANCE_GRID) * drop_V[:, None], hat(samples.soc_before, RESISTANCE_GRID)
    A[:, layout.block(0)] = np.where(samples.current_A[:, None] > 0, 0.0, here)
    A[:, layout.block(1)] = np.where(samples.current_A[:, None] > 0, here, 0.0)
    initial = layout.initial(record).start
    for j, pair in enumerate(pair_steps(samples, unit)):
        A[:, layout.block(2 + j)] = scan(pair.decay, before * pair.drive_V[:, None])
        A[:, initial + j] = np.cumprod(pair.decay)
    A[:, layout.correction] = hat(samples.soc, OCV_KNOTS)
    if layout.entropy:
        warmer_K = samples.temperature_degC - ocv.reference_degC
        A[:, layout.entropic] = warmer_K[:, None] * hat(samples.soc, ENTROPY_KNOTS)
    if layout.hysteresis:
        gap_V = unit.hysteresis_V_at(samples.soc, samples.temperature_degC)
        # a state that saturates is not linear in its start; the mean slope between the branches takes its place
        low, middle, high = hysteresis_along(samples, unit, (-1.0, 0.0, 1.0)).T
        A[:, layout.scale] = (gap_V * middle)[:, None]
        A[:, initial + layout.pairs] = gap_V * 0.5 * (high - low)
    return A


def pair_names(pairs: int) -> Sequence[str]:
    """Names of the resistances along SoC, in the order of the blocks."""
    return ("r0_discharge_ohm", "r0_charge_ohm", *(f"r{j}_ohm" for j in range(1, pairs + 1)))
