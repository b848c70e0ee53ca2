"""State of charge by a linear Kalman filter on the RC model, through the inverse OCV curve ([P] section 3).

    x = [V_cb, V_cs, model_error, offset, resistance]    soc = OCV^-1((C_b V_cb + C_s V_cs) / (C_b + C_s))

[P] has the first two, and takes V_cb alone for the open-circuit voltage; that leaves out the charge of the surface.
The others make the sigma honest, see `linear`. The capacitance is one number, so charge moves the voltages along a
straight line while the curve has bends: the difference of the slopes is process noise of both, which then follow the
voltage rather than the charge where the curve is not straight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc import rc_linear
from ohmward.battery.soc.clean_sample import CleanSocSample, first_input, sanitize
from ohmward.battery.soc.initial_soc import initial_soc
from ohmward.battery.soc.rc_linear import OFFSET, RESISTANCE, Gate, LinearState, VoltageUpdate, on_soc_grid
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.trace import clip, maximum, table

_CURVE_POINTS = 1001


@dataclass(frozen=True)
class RcKalman:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        model: the circuit and its OCV curve.
        noise: what to assume about sensors and model.
        gap_s: a longer step between two samples says nothing about the current in between.
        gate: largest NIS of a voltage that is used.
        reset_after_s: after so much time outside the gate it is the filter that is wrong, and it doubts itself.
        current_limit_C: a larger current, in multiples of the capacity per hour, is a fault of its sensor.
    """

    model: rc.RcModel
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    gap_s: float = 600.0
    gate: float = 25.0
    reset_after_s: float = 60.0
    current_limit_C: float = 20.0

    def __post_init__(self) -> None:
        rc_linear.require_settings(self.gap_s, self.gate, self.reset_after_s, self.current_limit_C)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the belief's mean, in order."""
        return rc_linear.STATE_NAMES

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> LinearState:
        """State before the first sample, which it looks at; `soc` None takes it from the first voltage."""
        u = first_input(first, self.current_limit_A)
        start = initial_soc(first.voltage_V, u, self.thevenin, self.noise, soc, soc_std)
        ocv_V, slope_V = self.ocv_V(start.soc), float(on_soc_grid(self.slope_V, start.soc))
        past_V = (self.model.r_bulk_ohm + self.model.r_surface_ohm) * self.noise.current_offset_std_A
        belief = rc_linear.start(ocv_V, (slope_V * start.std) ** 2, past_V, self.noise)
        return LinearState(pack(belief), u.current_A, 0.0, 0.0)

    def step(self, state: LinearState, sample: SocSample) -> tuple[LinearState, SocEstimate]:
        """The state after a sample, and what is known then."""
        reading = sanitize(sample, state.current_A, ROOM_DEGC, self.gap_s, self.current_limit_A, state.unknown_s)
        prior = self.predicted(unpack(state.belief), reading)
        outcome = self.corrected(prior, state, reading, sample.voltage_V)
        low, high = self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1]
        posterior, limited = rc_linear.limited(outcome.belief, self.open_circuit, low, high)
        after = LinearState(pack(posterior), reading.now.current_A, outcome.rejected_s, reading.unknown_s)
        flags = reading.flags + outcome.flags + limited * float(SocFlag.SOC_LIMITED)
        return after, self.estimate(posterior, outcome, flags)

    def predicted(self, belief: Belief, reading: CleanSocSample) -> Belief:
        """The belief after the step, before its voltage."""
        current_A, dt_s = reading.mean.current_A, reading.dt_s
        moved = abs(current_A) * dt_s / self.model.capacity_As
        kept = rc_linear.error_decay(moved, self.noise)
        F, B = rc_linear.transition(self.model, kept, dt_s)
        return kalman.predict(belief, F, self.process_noise(belief, reading, moved, kept), B * current_A)

    def process_noise(self, belief: Belief, reading: CleanSocSample, moved: Any, kept: Any) -> np.ndarray:
        """Q (5, 5) of a step in which SoC moves by `moved`."""
        noise = self.noise
        charge = rc_linear.charge_variance(reading, moved, noise, self.thevenin)
        bend_V = on_soc_grid(self.slope_V, self.soc(self.open_circuit @ belief.mean)) - self.straight_slope_V
        voltages = self.straight_slope_V**2 * charge + bend_V**2 * moved * 2 * noise.model_soc_length
        return rc_linear.process_noise(np.full((2, 2), voltages), kept, reading.dt_s, noise)

    def corrected(self, prior: Belief, state: LinearState, reading: CleanSocSample, voltage_V: Any) -> VoltageUpdate:
        """What becomes of the voltage of this step."""
        p, noise, current_A = self.model, self.noise, reading.now.current_A
        soc = self.soc(self.open_circuit @ prior.mean)
        over_V = rc_linear.overpotential(prior.mean, current_A, p)
        H = rc_linear.output(p, on_soc_grid(noise.model_std_V, soc), over_V)
        y_hat = (H @ prior.mean)[0] + rc.instant_resistance(p) * current_A
        R = rc_linear.voltage_variance(reading, over_V, on_soc_grid(self.slope_V, soc), noise)
        gate = Gate(self.gate, self.reset_after_s, self.model.ocv.voltage_V[-1], state.rejected_s)
        return rc_linear.correct(prior, H, R, y_hat, voltage_V, gate, reading)

    def estimate(self, belief: Belief, outcome: VoltageUpdate, flags: Any) -> SocEstimate:
        """What is known after the sample."""
        ocv_V = self.open_circuit @ belief.mean
        std_V = np.sqrt(maximum(self.open_circuit @ belief.cov @ self.open_circuit, 0.0))
        half_width = 0.5 * (self.soc_beyond(ocv_V + std_V) - self.soc_beyond(ocv_V - std_V))
        return SocEstimate(
            soc=self.soc(ocv_V),
            soc_std=np.sqrt(half_width**2 + self.noise.soc_axis_std**2),
            voltage_V=outcome.voltage_V,
            voltage_std_V=outcome.voltage_std_V,
            innovation_V=outcome.innovation_V,
            current_offset_A=belief.mean[OFFSET],
            soh_capacity=math.nan * ocv_V,
            resistance_ratio=1.0 + belief.mean[RESISTANCE],
            flags=flags,
        )

    def soc(self, ocv_V: Any) -> Any:
        """State of charge in [0, 1] at which the OCV curve passes `ocv_V`."""
        return clip(self.soc_beyond(ocv_V), 0.0, 1.0)

    def soc_beyond(self, ocv_V: Any) -> Any:
        """The same without limits: the inverse curve goes on as a straight line."""
        low, high = self.model.ocv.voltage_V[0], self.model.ocv.voltage_V[-1]
        return table(self.inverse_curve, low, (high - low) / (_CURVE_POINTS - 1), ocv_V)

    def ocv_V(self, soc: float) -> float:
        """Open-circuit voltage [V] at the curve's reference temperature."""
        return float(self.model.ocv.mean_V(soc, self.model.ocv.reference_degC))

    @property
    def current_limit_A(self) -> float:
        """Largest current [A] that is believed."""
        return self.current_limit_C * self.model.capacity_Ah

    @cached_property
    def thevenin(self) -> Thevenin:
        """The equivalent Thevenin circuit: what the start and the charge's variance are written for."""
        return rc.equivalent_thevenin(self.model)

    @cached_property
    def open_circuit(self) -> np.ndarray:
        """What makes the open-circuit voltage of the state, (5,): the mean of both capacitors by charge."""
        total_F = self.model.c_bulk_F + self.model.c_surface_F
        return np.array([self.model.c_bulk_F, self.model.c_surface_F, 0.0, 0.0, 0.0]) / total_F

    @cached_property
    def inverse_curve(self) -> tuple[float, ...]:
        """SoC on a uniform grid of voltage between the ends of the OCV curve."""
        ocv = self.model.ocv
        grid_V = np.linspace(ocv.voltage_V[0], ocv.voltage_V[-1], _CURVE_POINTS)
        return tuple(ocv.soc_at(v, ocv.reference_degC) for v in grid_V)

    @cached_property
    def slope_V(self) -> tuple[float, ...]:
        """Slope of the OCV curve [V per unit of SoC] on a uniform grid of SoC."""
        soc = np.linspace(0.0, 1.0, 101)
        return tuple(np.gradient(self.model.ocv.mean_V(soc, self.model.ocv.reference_degC), soc).tolist())

    @property
    def straight_slope_V(self) -> float:
        """Slope that the capacitances stand for, Q / (C_b + C_s) [V per unit of SoC]."""
        return self.model.capacity_As / (self.model.c_bulk_F + self.model.c_surface_F)
