"""Differences between one cell and the typical cell of its pack: a Kalman filter.

All cells of a string carry the same current, and are of one make. The offset of the current sensor, the error of the
open-circuit curve and the temperature are common to them: they falsify the state of charge of all cells alike, but not
their differences. So one filter follows the typical cell with all its errors, and each cell has a small one for its
differences d (bar-delta filtering, Plett 2009, EVS24):

    s_k = s + d_soc,    d_soc' = d_soc + d_gain moved
    V_k - V = U(s_k) - U(s) + (e^d_ohmic - 1) R_0 i + (e^d_pair - 1) sum of v_j + d_curve

The state of charge s of the typical cell has an error e of its own, which the voltage of one cell must not correct. It
is a consider state (Schmidt 1966): its covariance with the differences is kept. A cell at the knee of its curve shows
s_k = s + e + d_soc whatever e is; when the filter of the typical cell then finds e, d_soc moves along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import RESISTANCE_CORRELATION, BatteryNoise, walk_variance
from ohmward.battery.models.ocv import beyond_line, slip_shape
from ohmward.battery.models.thevenin import (
    CircuitInput,
    StateOfHealth,
    Thevenin,
    charge,
    next_state,
    ohmic_resistance,
    overpotentials,
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
    without_voltage,
)
from ohmward.battery.soc.sample import SocFlag, SocSample
from ohmward.battery.soc.voltage_faults import FROZEN_STD, stands_for
from ohmward.checks import require_each_not_negative, require_positive
from ohmward.filters.belief import Belief, Innovation, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose, passes, require_gate, time_rejected
from ohmward.filters.kalman import gain, joseph
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.quantities import DAY_S
from ohmward.trace import Scalar, clip, exp, linearize, logical_not, maximum, minimum, where


@dataclass(frozen=True)
class CellSpread:
    """Standard deviations of one cell about the typical one of its pack. All voltages are of one cell.

    New cells of one batch differ by 0.5 to 2 % in capacity and by 1 to 6 % in resistance (Dubarry et al. 2010, J. Power
    Sources 195, 7117; Rumpf et al. 2017, J. Energy Storage 14, 224). Aged ones differ by 2 to 6 and by 5 to 20 %, with
    a few far below the others (Baumhofer et al. 2014, J. Power Sources 247, 332); these are what a pack is watched for.
    """

    soc_std: float = 0.05  #: of the state of charge, where nothing balances the cells
    capacity_std: float = 0.1  #: relative, of the capacity
    resistance_std: float = 0.3  #: of the logarithm of the resistance
    #: of the open-circuit voltage at the same state of charge, and of the channels that measure it
    curve_std_V: float = 0.003
    soc_axis_std: float = 0.005  #: of the SoC axis of that curve
    #: relative error of the overpotential beyond a common factor of the cell: a pack is not equally warm everywhere
    overpotential_share: float = 0.05
    voltage_std_V: float = 0.002  #: white noise of a cell's channel
    soc_walk: float = 0.002  #: random walk of the state of charge in a day, by leakage and by balancing
    efficiency_std: float = 0.01  #: the same for each full charge that flows

    def __post_init__(self) -> None:
        require_each_not_negative("spread.", self, *self.__dataclass_fields__)


class Differences(NamedTuple):
    """Elements of the state vector."""

    common_soc: Any  #: error of the state of charge of the typical cell, its mean always 0
    soc: Any  #: state of charge of the cell minus the typical cell's
    charge_gain: Any  #: the same difference for the inverse of the capacity, over the battery file's
    #: ln of the ohmic resistance and of the RC pairs' over the typical cell's
    ohmic_log: Any
    pair_log: Any
    curve: Any  #: difference of the open-circuit voltages at the same state of charge, in its own standard deviations


COMMON, SOC, GAIN, OHMIC, PAIR, CURVE = range(len(Differences._fields))
"""Indices of the state."""


class TypicalCell(NamedTuple):
    """Estimate of the typical cell, as in `SocEstimate`, and its voltage."""

    soc: Any
    soc_std: Any
    current_offset_A: Any
    soh_capacity: Any
    resistance_ratio: Any
    voltage_V: Any  #: measured, of a pack of such cells


class CellSample(NamedTuple):
    """One sample of a cell.

    dt_s, current_A, temperature_degC: as in `SocSample`.
    voltage_V: measured, of a pack of such cells; nan where there is none.
    typical: estimate of the typical cell after this sample.
    """

    dt_s: Any
    current_A: Any
    voltage_V: Any
    temperature_degC: Any
    typical: TypicalCell


class CellEstimate(NamedTuple):
    """Estimate of a cell after a sample."""

    soc: Any  #: state of charge of the cell
    soc_std: Any  #: its standard deviation
    soc_difference: Any  #: state of charge minus the typical cell's
    soc_difference_std: Any  #: its standard deviation
    capacity_ratio: Any  #: capacity over that of the typical cell
    capacity_ratio_std: Any  #: its standard deviation
    resistance_ratio: Any  #: resistance over that of the typical cell
    resistance_ratio_std: Any  #: its standard deviation
    flags: Any  #: sum of `SocFlag` values


#: Smallest variance of a state of charge: no voltage determines it better.
LEAST_VARIANCE = 1e-8
#: Share of the hysteresis by which two cells that carry the same current differ.
_HYSTERESIS_SPREAD = 0.2


class LinearCurve(NamedTuple):
    """Open-circuit voltage, linearised over a belief of the state of charge."""

    voltage_V: Scalar  #: mean [V]
    slope: Scalar  #: [V] for each unit of SoC
    variance: Scalar  #: of what the straight line leaves out [V^2]


#: Shortest correlation length, as a change of SoC, of the difference between the curves of two cells; where the cells
#: are further apart, it is their distance.
LEAST_CURVE_LENGTH = 0.05
#: Far below the resistance of any battery [ohm].
_LEAST_OHM = 1e-9


class CellState(NamedTuple):
    """State of the filter between two samples: plain numbers."""

    belief: PackedBelief  #: mean as `Differences`, and lower triangle of the covariance
    pair_V: np.ndarray  #: (n,) RC voltages of a pack of typical cells with the resistances of the battery file
    soc: Scalar  #: of the typical cell
    current_A: Scalar  #: last credible current
    temperature_degC: Scalar  #: last credible temperature
    rejected_s: Scalar  #: time for which the voltage has contradicted the belief
    unknown_s: Scalar  #: time for which the current has not been known
    held_V: Scalar = -1.0  #: last measured voltage; at the start one that no cell has
    came_V: Scalar = 0.0  #: voltage of the typical cell when that one first came
    voltage_age_s: Scalar = 0.0  #: time since a voltage was used


@dataclass(frozen=True)
class CellFilter:
    """Settings; `init` and `step` are pure functions of them. Voltages are those of a pack of equal cells."""

    model: Thevenin  #: the circuit of the pack
    noise: BatteryNoise  #: of the model
    n_series: int  #: cells in series
    spread: CellSpread = field(default_factory=CellSpread)  #: expected differences
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between
    gate: float = 25.0  #: largest NIS of a voltage that is used
    reset_after_s: float = 600.0  #: time of contradiction after which the differences are declared unknown

    def __post_init__(self) -> None:
        require_positive("n_series", self.n_series)
        require_gate(self.gate, self.reset_after_s)

    @property
    def limits(self) -> SampleLimits:
        """Plausibility limits of a sample; a dead cell may show any voltage below those of a battery."""
        return sample_limits(self.model, self.gap_s)._replace(lowest_ocv_V=0.0)

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
        typical, measured = sample.typical, self.sanitize(state, sample)
        came_V, clean = self.without_frozen(state, measured, typical)
        moved = self.moved(clean, typical)
        prior = self.follow(unpack(state.belief), typical, typical.soc - state.soc - moved / self.soh(typical))
        prior = self.predict(prior, clean, moved)
        pair_V = self.next_pairs(state, clean, typical)

        diverged = state.rejected_s > self.reset_after_s
        prior = choose(diverged, self.start(typical.soc_std**2), prior)
        corrected, innovation, contradicts = self.correct(prior, clean, typical, pair_V)
        accepted = clean.voltage_measured & passes(innovation, self.gate)
        posterior = self.within_limits(choose(accepted, corrected, prior), typical)
        contradicts = contradicts & logical_not(diverged)  # a reset restarts the timer
        rejected_s = time_rejected(state.rejected_s, stands_for(clean), contradicts, clean.voltage_measured)
        after = CellState(
            pack(posterior), pair_V, typical.soc, clean.now.current_A, clean.now.temperature_degC, rejected_s,
            clean.unknown_s, where(measured.voltage_measured, measured.voltage_V, state.held_V), came_V,
            where(clean.voltage_measured, 0.0, clean.voltage_step_s),
        )  # fmt: skip
        flags = clean.flags + flags_of(
            {
                SocFlag.VOLTAGE_REJECTED: clean.voltage_measured & logical_not(accepted),
                SocFlag.DIVERGED: clean.voltage_measured & diverged,
            }
        )
        return after, self.estimate(posterior, typical, clean.now, flags)

    def sanitize(self, state: CellState, sample: CellSample) -> CleanSocSample:
        """Sample with impossible values replaced and flagged; no voltage without a typical cell or while gassing."""
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(_of_pack(sample), before, self.limits, state.unknown_s, state.voltage_age_s)
        usable = clean.voltage_measured & (sample.typical.voltage_V > 0.0)
        if self.model.gassing_V is not None:
            usable = usable & (clean.voltage_V < self.model.gassing_V)
        return clean._replace(voltage_measured=usable)

    def without_frozen(
        self, state: CellState, clean: CleanSocSample, typical: TypicalCell
    ) -> tuple[Scalar, CleanSocSample]:
        """The typical cell's voltage when this one first came, and the sample without a voltage of a dead channel.

        It stands still to the last digit while the typical cell's moves away.
        """
        same = clean.voltage_measured & (clean.voltage_V == state.held_V)
        came_V = where(clean.voltage_measured & logical_not(same), typical.voltage_V, state.came_V)
        frozen = same & (abs(typical.voltage_V - came_V) > FROZEN_STD * self.n_series * self.spread.voltage_std_V)
        return came_V, without_voltage(clean, frozen, SocFlag.NO_VOLTAGE)

    def soh(self, typical: TypicalCell) -> Scalar:
        """Capacity of the typical cell over the battery file's."""
        return maximum(typical.soh_capacity, LEAST_CHARGE_GAIN)

    def moved(self, clean: CleanSocSample, typical: TypicalCell) -> Scalar:
        """Charge of this step over the capacity of the battery file."""
        return charge(clean.mean.current_A - typical.current_offset_A, clean.dt_s, self.model) / self.model.capacity_As

    def follow(self, belief: Belief, typical: TypicalCell, correction: Scalar) -> Belief:
        """The belief after the filter of the typical cell has corrected its state of charge, or become less certain.

        With P- and P+ the variances before and after, and b = cov(x, e) / P-, the regression on its correction is
        x + b correction, and the covariance falls by (P- - P+) b b'. Where it became less certain, the differences are
        not affected.
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
        soc_walk_variance = walk_variance(self.spread.soc_walk, DAY_S, clean.dt_s)
        Q = Differences(
            common_soc=0.0,
            soc=soc_walk_variance + self.spread.efficiency_std**2 * abs(moved),
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
        expected_V, H, variance = self.expect(prior, typical, 1.0 / self.soh(typical), (u, pair_V))
        R = np.array([[variance * self.noise.samples_per_error(clean.voltage_step_s)]])
        C = prior.cov @ H.T
        S = mirror_lower(H @ C + R)
        K = gain(C, S)
        K[COMMON, 0] = 0.0
        nu = np.array([clean.voltage_V - typical.voltage_V - expected_V])
        contradicts = nu[0] * nu[0] > self.gate * (S[0, 0] - R[0, 0] + variance)
        return Belief(prior.mean + K @ nu, joseph(prior.cov, K, H, R)), Innovation(nu, S), contradicts

    def expect(
        self, prior: Belief, typical: TypicalCell, charge_gain: Scalar, now: tuple[CircuitInput, np.ndarray]
    ) -> tuple[Scalar, np.ndarray, Scalar]:
        """The difference of the voltages [V] expected for a belief, linearised over it.

        charge_gain: of the typical cell.
        now: current and temperature, and the (n,) RC voltages of the typical cell with the resistances of the file.
        Returns: also its derivatives (1, 6) by the state, and the variance that the states do not describe [V^2].
        """
        u, pair_V = now
        x, P, slip = Differences(*prior.mean), prior.cov, self.model.ocv_slip
        soc = typical.soc + x.soc
        variance = P[COMMON, COMMON] + 2.0 * P[COMMON, SOC] + P[SOC, SOC]
        own = self.curve(soc, variance, slip * (charge_gain + x.charge_gain - 1.0), u)
        common = self.curve(typical.soc, P[COMMON, COMMON], slip * (charge_gain - 1.0), u)
        curve_std_V = self.curve_std_V(prior, typical, (own, common), u)
        ratio = typical.resistance_ratio

        def overpotentials_V(soc: Scalar, ohmic: Scalar, pair: Scalar) -> list[Scalar]:
            state = np.array([soc, *(pair * v for v in pair_V), 0.0])
            return overpotentials(state, u, self.model, StateOfHealth(resistance_ratio=ohmic))

        def own_overpotentials_V(d: Differences) -> list[Scalar]:
            return overpotentials_V(soc, ratio * exp(d.ohmic_log), ratio * exp(d.pair_log))

        def difference_V(z: np.ndarray) -> np.ndarray:
            d = Differences(*z)
            slipped = slip * slip_shape(soc, slip) * (d.charge_gain - x.charge_gain)
            own_V = (
                own.voltage_V + own.slope * (d.common_soc + (d.soc - x.soc) + slipped) + sum(own_overpotentials_V(d))
            )
            common_V = common.voltage_V + common.slope * d.common_soc + sum(overpotentials_V(typical.soc, ratio, ratio))
            return np.array([own_V - common_V + curve_std_V * d.curve])

        voltage_V, slopes = linearize(difference_V, np.array([0.0, *prior.mean[1:]]))
        *pairs_V, drop_V = own_overpotentials_V(x)
        variance = self.white_variance(x, typical, (drop_V, sum(pairs_V))) + own.variance + common.variance
        return voltage_V[0], slopes, variance

    def white_variance(self, x: Differences, typical: TypicalCell, over_V: tuple[Scalar, Scalar]) -> Scalar:
        """Variance of the channel, and of the overpotentials (ohmic, RC) beyond a common factor of each [V^2]."""
        uneven = self.noise.overpotential_share_at(typical.soc) * (exp(x.pair_log) - 1.0)
        share2 = self.spread.overpotential_share**2 + uneven * uneven
        channel_V = self.n_series * self.spread.voltage_std_V
        return channel_V * channel_V + share2 * sum(v * v for v in over_V)

    def curve(self, soc: Scalar, variance: Scalar, slipped: Scalar, u: CircuitInput) -> LinearCurve:
        """Open-circuit voltage of a cell whose electrodes have slipped, linearised over its belief of SoC.

        Over three points of the belief, weights 1/6, 2/3, 1/6 (Gauss-Hermite), none beyond empty or full: statistical
        linearisation (Gelb 1974, 6.2), because a knee is narrower than the belief.
        """
        step = np.sqrt(3.0 * maximum(variance, LEAST_VARIANCE))

        def voltage(point: Scalar) -> Scalar:
            inside = clip(point, 0.0, 1.0)
            on_curve = inside + slipped * slip_shape(inside, self.model.ocv_slip)
            return self.model.ocv.mean_V(on_curve, u.temperature_degC)

        low, middle, high = voltage(soc - step), voltage(soc), voltage(soc + step)
        slope = (high - low) / (2.0 * step)
        mean, variance = beyond_line(high - middle - slope * step, low - middle + slope * step)
        return LinearCurve(middle + mean, slope, maximum(variance, 0.0))

    def curve_std_V(
        self, prior: Belief, typical: TypicalCell, curves: tuple[LinearCurve, LinearCurve], u: CircuitInput
    ) -> Scalar:
        """Standard deviation of the difference of the open-circuit voltages beyond that of the curve [V].

        Two cells at the same state of charge differ by manufacture. At two states of charge d apart the errors of the
        file's curve differ too: by its axis where the slopes differ, and by 2 (1 - e^(-|d| / length)) of its variance.

        curves: of the cell and of the typical one.
        """
        x, spread, noise = Differences(*prior.mean), self.spread, self.noise
        soc, slope, slope_of_typical = typical.soc + x.soc, curves[0].slope, curves[1].slope
        gain2 = x.charge_gain * x.charge_gain + prior.cov[GAIN, GAIN]
        distance = np.sqrt(x.soc * x.soc + prior.cov[SOC, SOC])
        model_std_V = noise.model_std_at(soc)
        terms = (
            self.n_series * spread.curve_std_V,
            spread.soc_axis_std * slope,
            noise.ocv_slip_std * slip_shape(soc, self.model.ocv_slip) * np.sqrt(gain2) * slope,
            noise.soc_axis_std * (slope - slope_of_typical),
            _HYSTERESIS_SPREAD * self.model.hysteresis_V_at(soc, u.temperature_degC),
        )
        of_curve_V2 = model_std_V * model_std_V * 2.0 * (1.0 - exp(-distance / noise.model_soc_length))
        return np.sqrt(sum(term * term for term in terms) + of_curve_V2)

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
        ohmic_ohm = ohmic_resistance(typical.soc, u, self.model)
        pair_ohm = sum(pair_resistances(typical.soc, u, self.model))
        share = ohmic_ohm / maximum(ohmic_ohm + pair_ohm, _LEAST_OHM)
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


def _of_pack(sample: CellSample) -> SocSample:
    """The sample as one of a pack."""
    return SocSample(sample.dt_s, sample.current_A, sample.voltage_V, sample.temperature_degC)
