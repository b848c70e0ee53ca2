"""State of charge by a linear Kalman filter on the RC model ([P] section 3).

    x = [V_cb, V_cs, model_error, offset, resistance]

[P] has V_cb, V_cs and V_o and finds SoC by the inverse OCV curve. The other states keep sigma honest: `offset` [A] is
the output of the current sensor at zero current, `resistance` the relative error of all resistances together; both are
random walks, and the voltage is linear in both as long as the current is measured. `model_error` is the voltage error
of the model in its own standard deviations, a Gauss-Markov state along SoC: constant while SoC is, and decorrelated
after `model_soc_length`. Errors of a battery model are not white; treated as white noise they would average out, and
the filter would be overconfident.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise, CurrentSensor, on_soc_grid
from ohmward.battery.models.temperature import ROOM_DEGC, coldness_per_K
from ohmward.battery.models.thevenin import CircuitInput, Thevenin
from ohmward.battery.soc.clean_sample import (
    CURRENT_GAP_S,
    CleanSocSample,
    SampleLimits,
    first_input,
    sample_limits,
    sanitize,
)
from ohmward.battery.soc.coulomb import charge_variance
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis, InitialSoc
from ohmward.checks import require_positive
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose, require_gate, time_rejected
from ohmward.trace import Scalar, clip, exp, logical_not, maximum, sqrt, table, where
from ohmward_lab.published import rc, rc_circuit
from ohmward_lab.published.rc import Circuit, RcModel

BULK, SURFACE, MODEL_ERROR, OFFSET, RESISTANCE = range(5)


#: Points of the inverse curve over voltage.
_CURVE_POINTS = 1001


@dataclass(frozen=True)
class SocByCurve:
    """SoC at which the OCV curve has the mean voltage of both capacitors ([P] 3.1, which uses that of the bulk).

    The capacitance is one number, so charge moves the voltages along a straight line while the OCV is curved. The
    difference of the slopes is process noise of both voltages, which then follow the measured voltage rather than the
    charge where the curve is not straight.
    """

    model: RcModel
    noise: BatteryNoise

    def ocv_V(self, soc: Scalar) -> Scalar:
        """Open-circuit voltage [V] at the curve's reference temperature."""
        return self.model.ocv.mean_V(soc, self.model.ocv.reference_degC)

    def slope_V(self, soc: Scalar) -> Scalar:
        """Slope of the open-circuit voltage [V per unit of SoC]."""
        return on_soc_grid(self._slopes_V, soc)

    def curvature_variance_V2(self, soc: Scalar) -> Scalar:
        """Process variance of both voltages [V^2 per unit of SoC moved] where the curve is not the straight line."""
        curvature_V = self.slope_V(soc) - line_slope_V(self.model)
        return curvature_V**2 * 2 * self.noise.model_soc_length

    def soc(self, x: np.ndarray) -> Scalar:
        """State of charge in [0, 1] in state x."""
        return clip(self.soc_beyond(self.open_circuit @ x), 0.0, 1.0)

    def soc_variance(self, belief: Belief) -> Scalar:
        """Variance of SoC: square of half its range on the curve between plus and minus one sigma of the OCV."""
        ocv_V = self.open_circuit @ belief.mean
        std_V = np.sqrt(maximum(self.open_circuit @ belief.cov @ self.open_circuit, 0.0))
        half_width = 0.5 * (self.soc_beyond(ocv_V + std_V) - self.soc_beyond(ocv_V - std_V))
        return half_width**2

    def project(self, belief: Belief) -> tuple[Belief, Scalar]:
        """The belief with its open-circuit voltage projected onto the curve, and the condition that it had to be."""
        row, (mean, P) = self.open_circuit, belief
        value = row @ mean
        excess = value - clip(value, self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1])
        common = P @ row
        projected = mean - common * (excess / maximum(row @ common, 1e-30))
        return Belief(projected, P), abs(excess) > 0.0

    def soc_beyond(self, ocv_V: Scalar) -> Scalar:
        """SoC at which the curve passes `ocv_V`, without limits: the inverse curve goes on as a straight line."""
        low, high = self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1]
        return table(self._inverse_curve, low, (high - low) / (_CURVE_POINTS - 1), ocv_V)

    @cached_property
    def open_circuit(self) -> np.ndarray:
        """Row (5,) that gives the open-circuit voltage of a state: mean of both capacitors, weighted by capacitance."""
        total_F = self.model.c_bulk_F + self.model.c_surface_F
        return np.array([self.model.c_bulk_F, self.model.c_surface_F, 0.0, 0.0, 0.0]) / total_F

    @cached_property
    def _inverse_curve(self) -> tuple[float, ...]:
        """SoC on a uniform grid of voltage between the ends of the OCV curve."""
        ocv = self.model.ocv
        grid_V = np.linspace(ocv.voltage_V[0], ocv.voltage_V[-1], _CURVE_POINTS)
        return tuple(ocv.soc_at(v, ocv.reference_degC) for v in grid_V)

    @cached_property
    def _slopes_V(self) -> tuple[float, ...]:
        """Slope of the OCV curve on a uniform grid of SoC."""
        ocv, soc = self.model.ocv, np.linspace(0.0, 1.0, 101)
        return tuple(np.gradient(ocv.mean_V(soc, ocv.reference_degC), soc).tolist())


def line_slope_V(model: RcModel) -> float:
    """Slope Q / (C_b + C_s) [V per unit of SoC] of the straight OCV line that the capacitances represent."""
    return model.capacity_As / (model.c_bulk_F + model.c_surface_F)


class RcFilterState(NamedTuple):
    """State of the filter between two samples: plain numbers."""

    belief: PackedBelief  #: mean (5,) and lower triangle of the covariance
    current_A: Scalar  #: of the sample before
    rejected_s: Scalar  #: time for which the voltage has been outside its gate
    unknown_s: Scalar  #: time for which the current has not been known


class RcUpdate(NamedTuple):
    """The belief after a voltage, or the prior where it was not used."""

    belief: Belief
    #: terminal voltage expected before the measurement, and its standard deviation
    voltage_V: Scalar
    voltage_std_V: Scalar
    innovation_V: Scalar  #: measured minus expected; nan where there is no measurement
    rejected_s: Scalar  #: time for which the voltage has been outside its gate
    flags: Scalar  #: sum of `SocFlag`


@dataclass(frozen=True)
class RcFilter:
    """Settings; `init` and `step` are pure functions of them."""

    model: rc.RcModel  #: the circuit and its OCV curve
    noise: BatteryNoise = field(default_factory=BatteryNoise)  #: of voltage and model
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: of the current
    gap_s: float = CURRENT_GAP_S  #: in a longer step the current between the two samples is unknown
    gate: float = 25.0  #: largest NIS of a voltage that is used
    reset_after_s: float = 60.0  #: time of rejection after which the filter has diverged and inflates its covariance

    def __post_init__(self) -> None:
        require_positive("gap_s", self.gap_s)
        require_gate(self.gate, self.reset_after_s)

    @property
    def limits(self) -> SampleLimits:
        """Limits of plausible samples."""
        return sample_limits(self.thevenin, self.gap_s)

    @cached_property
    def link(self) -> SocByCurve:
        """The link between state of charge and voltage."""
        return SocByCurve(self.model, self.noise)

    @cached_property
    def thevenin(self) -> Thevenin:
        """The equivalent Thevenin circuit, for the start and the variance of the charge."""
        return rc.equivalent_thevenin(self.model)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> RcFilterState:
        """State before the first sample, whose voltage gives the SoC where `soc` is None."""
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return VoltageStart(self.thevenin, self.noise, self.sensor, self.limits.current_A)

    def start_from(self, first: SocSample, part: Hypothesis) -> RcFilterState:
        """State before the first sample with this density of SoC; traceable."""
        u = first_input(first, self.limits.current_A)
        belief = self.start_belief(part.start, self.coldness(u.temperature_degC))
        return RcFilterState(pack(belief), u.current_A, 0.0, 0.0)

    def coldness(self, temperature_degC: Scalar) -> Scalar:
        """1/T - 1/T_reference [1/K]."""
        return coldness_per_K(temperature_degC, self.model.ocv.reference_degC)

    def start_belief(self, start: InitialSoc, coldness: Scalar = 0.0) -> Belief:
        """Belief before the first sample: both capacitors at the open-circuit voltage of this SoC.

        coldness: 1/T - 1/T_reference [1/K].
        """
        noise, ocv_V = self.noise, self.link.ocv_V(start.soc)
        resistance_std = sqrt(noise.resistance_variance(coldness))
        past_V = (self.model.r_bulk_ohm + self.model.r_surface_ohm) * self.sensor.offset_std_A
        mean = np.array([ocv_V, ocv_V, 0.0, 0.0, 0.0])
        common = charge_direction(self.link.slope_V(start.soc)) * start.std
        own = np.array([0.0, past_V, 1.0, self.sensor.offset_std_A, resistance_std])
        return Belief(mean, np.outer(common, common) + np.diag(own**2))

    def step(self, state: RcFilterState, sample: SocSample) -> tuple[RcFilterState, SocEstimate]:
        """State and estimate after a sample."""
        clean = sanitize(sample, CircuitInput(state.current_A, ROOM_DEGC), self.limits, state.unknown_s)
        p = rc_circuit.circuit_at(self.model, clean.now.temperature_degC)
        prior = self.predict(unpack(state.belief), clean, p)
        update = self.correct(prior, state.rejected_s, clean, p)
        posterior, limited = self.link.project(update.belief)
        flags = clean.flags + update.flags + flags_of({SocFlag.SOC_LIMITED: limited})
        after = RcFilterState(pack(posterior), clean.now.current_A, update.rejected_s, clean.unknown_s)
        return after, self.estimate(posterior, update, flags)

    def predict(self, belief: Belief, clean: CleanSocSample, p: Circuit) -> Belief:
        """The belief after the step, before the correction by its voltage."""
        current_A = clean.mean.current_A
        moved = abs(current_A) * clean.dt_s / self.model.capacity_As
        decay = self.error_decay(moved)
        F, B = self.transition(p, decay, clean.dt_s)
        Q = self.process_noise(belief.mean, clean, moved, decay)
        return kalman.predict(belief, F, Q, B * current_A)

    def transition(self, p: Circuit, decay: Scalar, dt_s: Scalar) -> tuple[np.ndarray, np.ndarray]:
        """F (5, 5) and B (5,) of the step x+ = F x + B i_measured; decay: factor of the model error."""
        A, b = rc_circuit.transition(p, dt_s)
        B = np.array([*b, 0.0, 0.0, 0.0])
        F = _block_diagonal(A, np.diag(np.array([decay, 1.0, 1.0])))
        F[:, OFFSET] -= B  # the true current is the measured one less the offset
        return F, B

    def error_decay(self, moved: Scalar) -> Scalar:
        """Decay factor of the model error after SoC has moved by this."""
        return exp(-moved / self.noise.model_soc_length)

    def process_noise(self, x: np.ndarray, clean: CleanSocSample, moved: Scalar, decay: Scalar) -> np.ndarray:
        """Q (5, 5) of a step in which SoC moves by `moved`, without sign."""
        noise = self.noise
        direction = charge_direction(line_slope_V(self.model))
        gain_variance = noise.capacity_std**2 + self.sensor.gain_std**2
        charge = charge_variance(clean, self.sensor, self.thevenin) + gain_variance * moved
        uneven_V2 = self.link.curvature_variance_V2(self.link.soc(x))
        offset_A2 = self.sensor.offset_walk_variance(clean.dt_s)
        walks = np.array([1 - decay**2, offset_A2, noise.resistance_walk_variance(clean.dt_s)])
        own = _block_diagonal(np.full((2, 2), uneven_V2 * moved), np.diag(walks))
        return own + np.outer(direction * charge, direction)

    def correct(self, prior: Belief, rejected_s: Scalar, clean: CleanSocSample, p: Circuit) -> RcUpdate:
        """The belief after the voltage of this step.

        A filter that has diverged was overconfident: it inflates its covariance until the voltage lies at the edge of
        its gate, at every sample until a voltage passes.
        """
        current_A = clean.now.current_A
        soc = self.link.soc(prior.mean)
        over_V = self.overpotential(prior.mean, current_A, p)
        H = self.output(p, self.model_std_V(soc, clean), over_V)
        R = self.voltage_variance(clean, over_V, self.link.slope_V(soc), soc)
        y_hat = (H @ prior.mean)[0] + rc.instant_resistance(p) * current_A
        y = where(clean.voltage_measured, clean.voltage_V, y_hat)
        prior_V2 = (H @ prior.cov @ H.T)[0, 0]

        gate_V2 = (y - y_hat) ** 2 / self.gate
        outside = clean.voltage_measured & (gate_V2 > prior_V2 + R)
        diverged = outside & (rejected_s > self.reset_after_s)
        rejected = outside & logical_not(diverged)
        wider = where(diverged, maximum((gate_V2 - R) / maximum(prior_V2, 1e-30), 1.0), 1.0)
        inflated = prior._replace(cov=wider * prior.cov)
        posterior, innovation = kalman.update(inflated, np.array([y]), H, np.array([[R]]), np.array([y_hat]))
        return RcUpdate(
            belief=choose(clean.voltage_measured & logical_not(rejected), posterior, prior),
            voltage_V=y_hat,
            voltage_std_V=sqrt(innovation.cov[0, 0]),
            innovation_V=where(clean.voltage_measured, innovation.value[0], math.nan),
            rejected_s=time_rejected(rejected_s, clean.dt_s, outside, clean.voltage_measured),
            flags=flags_of({SocFlag.VOLTAGE_REJECTED: rejected, SocFlag.DIVERGED: diverged}),
        )

    def overpotential(self, x: np.ndarray, current_A: Scalar, p: Circuit) -> Scalar:
        """Voltage beyond V_cb [V] in state x at the measured current, with the resistances of p."""
        return rc_circuit.voltage(x[:2], current_A - x[OFFSET], p)[0] - x[BULK]

    def output(self, p: Circuit, model_std_V: Scalar, overpotential_V: Scalar) -> np.ndarray:
        """H (1, 5): the voltage is H x + `rc.instant_resistance` * measured current."""
        bulk_share, surface_share = rc.divider(p)
        return np.array([[surface_share, bulk_share, model_std_V, -rc.instant_resistance(p), overpotential_V]])

    def model_std_V(self, soc: Scalar, clean: CleanSocSample) -> Scalar:
        """Standard deviation of the model's voltage error [V] at this SoC and temperature."""
        own_V, per_K = self.noise.model_std_at(soc), self.noise.ocv_std_V_per_K
        if per_K == 0.0:
            return own_V
        away_K = clean.now.temperature_degC - self.model.ocv.reference_degC
        return sqrt(own_V**2 + (per_K * away_K) ** 2)

    def voltage_variance(self, clean: CleanSocSample, overpotential_V: Scalar, slope_V: Scalar, soc: Scalar) -> Scalar:
        """R [V^2] of a step: white noise, and errors that persist for `correlation_s` and count once in that time.

        overpotential_V: voltage beyond the open circuit's.  slope_V: slope of the open-circuit voltage per unit of SoC.
        soc: at which `overpotential_share` is taken.
        """
        noise = self.noise
        share2 = noise.overpotential_share_at(soc) ** 2
        if noise.activation_std_K:
            share2 = share2 + (noise.activation_std_K * self.coldness(clean.now.temperature_degC)) ** 2
        over_V2 = share2 * overpotential_V**2
        axis_V2 = (noise.soc_axis_std * slope_V) ** 2
        return (noise.voltage_std_V**2 + over_V2 + axis_V2) * noise.samples_per_error(clean.dt_s)

    def estimate(self, belief: Belief, update: RcUpdate, flags: Scalar) -> SocEstimate:
        """Estimate after the sample."""
        return SocEstimate(
            soc=self.link.soc(belief.mean),
            soc_std=sqrt(self.link.soc_variance(belief) + self.noise.soc_axis_std**2),
            voltage_V=update.voltage_V,
            voltage_std_V=update.voltage_std_V,
            innovation_V=update.innovation_V,
            current_offset_A=belief.mean[OFFSET],
            current_offset_std_A=sqrt(belief.cov[OFFSET, OFFSET]),
            resistance_ratio=1.0 + belief.mean[RESISTANCE],
            resistance_ratio_std=sqrt(belief.cov[RESISTANCE, RESISTANCE]),
            flags=flags,
        )


def charge_direction(slope_V: Scalar) -> np.ndarray:
    """Change of the state (5,) by a charge error of one full capacity: it moves both capacitors."""
    return np.array([slope_V, slope_V, 0.0, 0.0, 0.0])


def _block_diagonal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The square matrices a (n, n) and b (m, m) as blocks of one of (n + m, n + m)."""
    n, m = len(a), len(b)
    return np.block([[a, np.zeros((n, m))], [np.zeros((m, n)), b]])
