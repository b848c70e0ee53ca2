"""One cell beside the typical cell of its pack: a Kalman filter of their differences.

All cells of a string carry the same current, and are of one make. The offset of the current sensor, the error of the
open-circuit curve and the temperature are common to them: they spoil the state of charge of all cells alike, and
nothing of their differences. So one filter follows the typical cell with all its errors, and each cell has a small one
for its differences d (bar-delta filtering, Plett 2009, EVS24):

    s_k = s + d_soc,    d_soc' = d_soc + d_gain moved
    V_k - V = U(s_k) - U(s) + (e^d_ohmic - 1) R_0 i + (e^d_pair - 1) sum of v_j + d_curve

The state of charge s of the typical cell is known within its own error e, which the voltage of one cell is not to
correct. It is a considered state (Schmidt 1966): its covariance with the differences is kept. A cell at the knee of
its curve tells s_k = s + e + d_soc whatever e is; where the filter of the typical cell then finds e, d_soc moves along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.cells.cell_sample import (
    COMMON,
    CURVE,
    GAIN,
    OHMIC,
    PAIR,
    SOC,
    CellEstimate,
    CellSample,
    CellSpread,
    Differences,
    TypicalCell,
)
from ohmward.battery.cells.cell_voltage import LEAST_VARIANCE, CellVoltage
from ohmward.battery.models.noise import RESISTANCE_CORRELATION, BatteryNoise
from ohmward.battery.models.thevenin import (
    CircuitInput,
    Thevenin,
    charge,
    next_state,
    ohmic_resistance,
    pair_resistances,
)
from ohmward.battery.soc.augmented_thevenin import LEAST_CHARGE_GAIN
from ohmward.battery.soc.clean_sample import (
    CURRENT_GAP_S,
    CleanSocSample,
    SampleLimits,
    first_input,
    sample_limits,
    sanitize,
)
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.checks import require_positive
from ohmward.filters.belief import Belief, Innovation, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose, passes, require_gate, time_rejected
from ohmward.filters.kalman import gain, joseph
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import clip, exp, logical_not, maximum, minimum
from ohmward.trace.expression import Scalar

#: The difference of the curves of two cells is new after this change of SoC at the earliest, and where the cells are
#: further apart, after their distance.
LEAST_CURVE_LENGTH = 0.05
#: Far below the resistance of any battery [ohm].
_LEAST_OHM = 1e-9


class CellState(NamedTuple):
    """State of the filter between two samples: plain numbers."""

    belief: PackedBelief  #: mean as `Differences`, and lower triangle of the covariance
    pair_V: np.ndarray  #: (n,) RC voltages of a pack of typical cells with the resistances of the battery file
    soc: Scalar  #: of the typical cell
    #: last credible ones
    current_A: Scalar
    temperature_degC: Scalar
    rejected_s: Scalar  #: time for which the voltage has contradicted the belief
    unknown_s: Scalar  #: time for which the current has not been known


@dataclass(frozen=True)
class CellFilter:
    """Settings; `init` and `step` are pure functions of them. Voltages are those of a pack of equal cells."""

    model: Thevenin  #: the circuit of the pack
    noise: BatteryNoise  #: of the model, for its walks and the error of its aged curve
    n_series: int  #: cells in series
    spread: CellSpread = field(default_factory=CellSpread)  #: differences to expect
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between
    gate: float = 25.0  #: largest NIS of a voltage that is used
    reset_after_s: float = 600.0  #: time of contradiction after which the differences are declared unknown

    def __post_init__(self) -> None:
        require_positive("n_series", self.n_series)
        require_gate(self.gate, self.reset_after_s)

    @cached_property
    def voltage(self) -> CellVoltage:
        """Model of the measured difference."""
        return CellVoltage(self.model, self.noise, self.n_series, self.spread)

    @property
    def limits(self) -> SampleLimits:
        """Limits of what is believed of a sample."""
        return sample_limits(self.model, self.gap_s)

    def init(self, first: CellSample) -> CellState:
        """State before the first sample: the cell is a typical one, within the spread."""
        u = first_input(_of_pack(first), self.limits.current_A)
        typical = first.typical
        belief = self.start(typical.soc_std**2)
        return CellState(
            pack(belief), np.zeros(self.model.pairs), typical.soc, u.current_A, u.temperature_degC, 0.0, 0.0
        )

    def start(self, common_variance: Scalar) -> Belief:
        """Belief before any voltage; common_variance: of the typical cell's state of charge."""
        spread = self.spread
        variance = Differences(
            common_soc=maximum(common_variance, LEAST_VARIANCE),
            soc=spread.soc_std**2,
            charge_gain=spread.capacity_std**2,
            ohmic_log=spread.resistance_std**2,
            pair_log=spread.resistance_std**2,
            curve=1.0,
        )
        cov = np.diag(np.array(variance))
        cov[OHMIC, PAIR] = cov[PAIR, OHMIC] = RESISTANCE_CORRELATION * spread.resistance_std**2
        return Belief(np.zeros(len(variance)), cov)

    def step(self, state: CellState, sample: CellSample) -> tuple[CellState, CellEstimate]:
        """State and estimate after a sample."""
        clean = self.sanitize(state, sample)
        typical = sample.typical
        moved = self.moved(clean, typical)
        prior = self.follow(unpack(state.belief), typical, typical.soc - state.soc - moved / self.soh(typical))
        prior = self.predict(prior, clean, moved)
        pair_V = self.next_pairs(state, clean, typical)

        diverged = state.rejected_s > self.reset_after_s
        prior = choose(diverged, self.start(typical.soc_std**2), prior)
        corrected, innovation, contradicts = self.correct(prior, clean, typical, pair_V)
        accepted = clean.voltage_measured & passes(innovation, self.gate)
        posterior = self.within_limits(choose(accepted, corrected, prior), typical)
        contradicts = contradicts & logical_not(diverged)  # a reset begins the time anew
        rejected_s = time_rejected(state.rejected_s, clean.dt_s, contradicts, clean.voltage_measured)
        after = CellState(
            pack(posterior), pair_V, typical.soc, clean.now.current_A, clean.now.temperature_degC, rejected_s,
            clean.unknown_s,
        )  # fmt: skip
        flags = clean.flags + flags_of(
            {
                SocFlag.VOLTAGE_REJECTED: clean.voltage_measured & logical_not(accepted),
                SocFlag.DIVERGED: clean.voltage_measured & diverged,
            }
        )
        return after, self.estimate(posterior, typical, clean.now, flags)

    def sanitize(self, state: CellState, sample: CellSample) -> CleanSocSample:
        """The sample with what cannot be true replaced and flagged; without a typical cell or in gas, no voltage."""
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(_of_pack(sample), before, self.limits, state.unknown_s)
        usable = clean.voltage_measured & (sample.typical.voltage_V > 0.0)
        if self.model.gassing_V is not None:
            usable = usable & (clean.voltage_V < self.model.gassing_V)
        return clean._replace(voltage_measured=usable)

    def soh(self, typical: TypicalCell) -> Scalar:
        """Capacity of the typical cell over the battery file's."""
        return maximum(typical.soh_capacity, LEAST_CHARGE_GAIN)

    def moved(self, clean: CleanSocSample, typical: TypicalCell) -> Scalar:
        """Charge of this step over the capacity of the battery file."""
        return charge(clean.mean.current_A - typical.current_offset_A, clean.dt_s, self.model) / self.model.capacity_As

    def follow(self, belief: Belief, typical: TypicalCell, correction: Scalar) -> Belief:
        """The belief after the filter of the typical cell has corrected its state of charge, or lost some of it.

        With P- and P+ the variances before and after, and b = cov(x, e) / P-, the regression on what it has found is
        x + b correction, and the covariance falls by (P- - P+) b b'. What it has lost has nothing to do with the
        differences.
        """
        before = maximum(belief.cov[COMMON, COMMON], LEAST_VARIANCE)
        now = maximum(typical.soc_std * typical.soc_std, LEAST_VARIANCE)
        b = belief.cov[:, COMMON] / before
        mean = belief.mean + b * correction
        mean[COMMON] = 0.0
        cov = belief.cov + np.outer(b, b) * minimum(now - before, 0.0)
        cov[COMMON, COMMON] = now
        return Belief(mean, mirror_lower(cov))

    def predict(self, belief: Belief, clean: CleanSocSample, moved: Scalar) -> Belief:
        """The belief after the step, before its voltage: d_soc' = d_soc + d_gain moved."""
        decay = exp(-abs(moved) / clip(abs(belief.mean[SOC]), LEAST_CURVE_LENGTH, self.noise.model_soc_length))
        F = np.diag(np.array([1.0] * len(belief.mean), dtype=object))
        F[SOC, GAIN], F[CURVE, CURVE] = moved, decay
        Q = Differences(
            common_soc=0.0,
            soc=self.spread.soc_walk_variance(clean.dt_s) + self.spread.efficiency_std**2 * abs(moved),
            charge_gain=self.noise.capacity_walk_variance(clean.dt_s),
            ohmic_log=self.noise.resistance_walk_variance(clean.dt_s),
            pair_log=self.noise.resistance_walk_variance(clean.dt_s),
            curve=1 - decay * decay,
        )
        return Belief(F @ belief.mean, mirror_lower(F @ belief.cov @ F.T + np.diag(np.array(Q))))

    def next_pairs(self, state: CellState, clean: CleanSocSample, typical: TypicalCell) -> np.ndarray:
        """(n,) RC voltages after the step."""
        u = clean.mean._replace(current_A=clean.mean.current_A - typical.current_offset_A)
        before = np.array([typical.soc, *state.pair_V, 0.0])
        return next_state(before, u, self.model, clean.dt_s)[1:-1]

    def correct(
        self, prior: Belief, clean: CleanSocSample, typical: TypicalCell, pair_V: np.ndarray
    ) -> tuple[Belief, Innovation, Any]:
        """The belief after the voltage of the cell, its innovation, and the condition that it contradicts the belief.

        The error of the typical cell is only considered: its gain is 0.
        """
        u = CircuitInput(clean.now.current_A - typical.current_offset_A, clean.now.temperature_degC)
        expected = self.voltage.expect(prior, typical, 1.0 / self.soh(typical), (u, pair_V))
        R = np.array([[expected.variance * self.noise.samples_per_error(clean.dt_s)]])
        H = expected.slopes
        C = prior.cov @ H.T
        S = mirror_lower(H @ C + R)
        K = gain(C, S)
        K[COMMON, 0] = 0.0
        nu = np.array([clean.voltage_V - typical.voltage_V - expected.voltage_V])
        contradicts = nu[0] * nu[0] > self.gate * (S[0, 0] - R[0, 0] + expected.variance)
        return Belief(prior.mean + K @ nu, joseph(prior.cov, K, H, R)), Innovation(nu, S), contradicts

    def within_limits(self, belief: Belief, typical: TypicalCell) -> Belief:
        """The belief with the state of charge of the cell in its range."""
        mean = belief.mean.copy()
        mean[SOC] = clip(typical.soc + mean[SOC], 0.0, 1.0) - typical.soc
        return Belief(mean, belief.cov)

    def estimate(self, posterior: Belief, typical: TypicalCell, u: CircuitInput, flags: Scalar) -> CellEstimate:
        """Estimate after the sample."""
        x, P = Differences(*posterior.mean), posterior.cov
        capacity_ratio = 1.0 / maximum(1.0 + x.charge_gain * self.soh(typical), LEAST_CHARGE_GAIN)
        gain_std = self.soh(typical) * np.sqrt(maximum(P[GAIN, GAIN], 0.0))
        share = self.ohmic_share(typical, u)
        ratio = share * exp(x.ohmic_log) + (1.0 - share) * exp(x.pair_log)
        own = share * share * P[OHMIC, OHMIC] + (1.0 - share) * (1.0 - share) * P[PAIR, PAIR]
        log_variance = own + 2.0 * share * (1.0 - share) * P[OHMIC, PAIR]
        return CellEstimate(
            soc=typical.soc + x.soc,
            soc_std=np.sqrt(maximum(P[COMMON, COMMON] + 2.0 * P[COMMON, SOC] + P[SOC, SOC], 0.0)),
            soc_difference=x.soc,
            soc_difference_std=np.sqrt(maximum(P[SOC, SOC], 0.0)),
            capacity_ratio=capacity_ratio,
            capacity_ratio_std=capacity_ratio * capacity_ratio * gain_std,
            resistance_ratio=ratio,
            resistance_ratio_std=ratio * np.sqrt(maximum(log_variance, 0.0)),
            flags=flags,
        )

    def ohmic_share(self, typical: TypicalCell, u: CircuitInput) -> Scalar:
        """Share of the ohmic resistance in that to a steady current."""
        ohmic_ohm = ohmic_resistance(typical.soc, u, self.model)
        pair_ohm = sum(pair_resistances(typical.soc, u, self.model))
        return ohmic_ohm / maximum(ohmic_ohm + pair_ohm, _LEAST_OHM)


def _of_pack(sample: CellSample) -> SocSample:
    """The sample as one of a pack."""
    return SocSample(sample.dt_s, sample.current_A, sample.voltage_V, sample.temperature_degC)
