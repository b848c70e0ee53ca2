"""The SoC filter of [T] 3.4.2: the RC model with state of charge as a third state and a straight OCV line.

    x = [V_cb, V_cs, model_error, offset, resistance, soc]    d soc/dt = i / Q    V_cb = OCV line(soc) at the start

[T] has V_cb, V_cs and soc; the others make the sigma honest, see `linear`. SoC counts charge on its own, so it does
not change when the circuit's capacitances do, and the voltage corrects it by what the filter knows of their common
errors: a wrong start, a wrong current. What bends the OCV curve away from the line is model error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.temperature import ROOM_DEGC
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.soc import rc_linear
from ohmward.battery.soc.clean_sample import CleanSocSample, first_input, sanitize
from ohmward.battery.soc.initial_soc import initial_soc
from ohmward.battery.soc.rc_linear import BULK, OFFSET, RESISTANCE, Gate, LinearState, VoltageUpdate, on_soc_grid
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.trace import maximum

SOC = 5
"""Place of SoC in the state."""


class Parameters(NamedTuple):
    """Parameters that come from somewhere else, sample by sample, and how far they may be off, as shares.

    capacitance_std: adds up over a full charge.  resistance_std: of the overpotential.
    """

    circuit: rc.Circuit
    capacitance_std: Any = 0.0
    resistance_std: Any = 0.0


@dataclass(frozen=True)
class RcSoc:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        model: the circuit and its OCV curve, through which a straight line is laid.
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
        return (*rc_linear.STATE_NAMES, "soc")

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> LinearState:
        """State before the first sample, which it looks at; `soc` None takes it from the first voltage."""
        u = first_input(first, self.current_limit_A)
        at = initial_soc(first.voltage_V, u, self.thevenin, self.noise, soc, soc_std)
        empty_V, slope_V = self.line
        past_V = (self.model.r_bulk_ohm + self.model.r_surface_ohm) * self.noise.current_offset_std_A
        circuit = rc_linear.start(empty_V + slope_V * at.soc, (slope_V * at.std) ** 2, past_V, self.noise)
        common = np.array([slope_V, slope_V, 0.0, 0.0, 0.0])[:, None] * at.std**2
        cov = np.block([[circuit.cov, common], [common.T, np.array([[at.std**2]])]])
        return LinearState(pack(Belief(np.array([*circuit.mean, at.soc]), cov)), u.current_A, 0.0, 0.0)

    def step(
        self, state: LinearState, sample: SocSample, parameters: Parameters | None = None
    ) -> tuple[LinearState, SocEstimate]:
        """The state after a sample, and what is known then; `parameters` replace the model's where they are given."""
        parameters = parameters or Parameters(self.model.circuit)
        reading = sanitize(sample, state.current_A, ROOM_DEGC, self.gap_s, self.current_limit_A, state.unknown_s)
        prior = self.predicted(unpack(state.belief), reading, parameters)
        outcome = self.corrected(prior, state, reading, sample.voltage_V, parameters)
        posterior, limited = rc_linear.limited(outcome.belief, np.eye(SOC + 1)[SOC], 0.0, 1.0)
        after = LinearState(pack(posterior), reading.now.current_A, outcome.rejected_s, reading.unknown_s)
        flags = reading.flags + outcome.flags + limited * float(SocFlag.SOC_LIMITED)
        return after, self.estimate(posterior, outcome, flags)

    def predicted(self, belief: Belief, reading: CleanSocSample, parameters: Parameters) -> Belief:
        """The belief after the step, before its voltage."""
        p, noise = parameters.circuit, self.noise
        current_A, dt_s = reading.mean.current_A, reading.dt_s
        moved = abs(current_A) * dt_s / self.model.capacity_As
        kept = rc_linear.error_decay(moved, noise)
        F5, B5 = rc_linear.transition(p, kept, dt_s)
        per_A = dt_s / self.model.capacity_As
        F = rc_linear.block_diagonal(F5, np.eye(1))
        F[SOC, OFFSET] = -per_A
        direction = self.charge_direction(p)
        doubt_V2 = (direction[BULK] * parameters.capacitance_std) ** 2 * moved
        Q = rc_linear.process_noise(np.full((2, 2), doubt_V2), kept, dt_s, noise)
        common = direction * rc_linear.charge_variance(reading, moved, noise, self.thevenin)
        Q = rc_linear.block_diagonal(Q, np.zeros((1, 1))) + np.outer(common, direction)
        return kalman.predict(belief, F, Q, np.array([*B5, per_A]) * current_A)

    def charge_direction(self, p: rc.Circuit) -> np.ndarray:
        """What an error of the charge by a full capacity does to the state, (6,): it moves all that count charge."""
        slope_V = self.model.capacity_As / (p.c_bulk_F + p.c_surface_F)
        return np.array([slope_V, slope_V, 0.0, 0.0, 0.0, 1.0])

    def corrected(
        self, prior: Belief, state: LinearState, reading: CleanSocSample, voltage_V: Any, parameters: Parameters
    ) -> VoltageUpdate:
        """What becomes of the voltage of this step."""
        p, current_A = parameters.circuit, reading.now.current_A
        over_V = rc_linear.overpotential(prior.mean, current_A, p)
        H5 = rc_linear.output(p, on_soc_grid(self.model_std_V, prior.mean[SOC]), over_V)
        H = np.hstack([H5, np.zeros((1, 1))])
        y_hat = (H @ prior.mean)[0] + rc.instant_resistance(p) * current_A
        R = rc_linear.voltage_variance(reading, over_V, self.line[1], self.noise, parameters.resistance_std)
        gate = Gate(self.gate, self.reset_after_s, self.model.ocv.voltage_V[-1], state.rejected_s)
        return rc_linear.correct(prior, H, R, y_hat, voltage_V, gate, reading)

    def estimate(self, belief: Belief, outcome: VoltageUpdate, flags: Any) -> SocEstimate:
        """What is known after the sample."""
        variance = maximum(belief.cov[SOC, SOC], 0.0)
        return SocEstimate(
            soc=belief.mean[SOC],
            soc_std=np.sqrt(variance + self.noise.soc_axis_std**2),
            voltage_V=outcome.voltage_V,
            voltage_std_V=outcome.voltage_std_V,
            innovation_V=outcome.innovation_V,
            current_offset_A=belief.mean[OFFSET],
            soh_capacity=math.nan * belief.mean[BULK],
            resistance_ratio=1.0 + belief.mean[RESISTANCE],
            flags=flags,
        )

    @property
    def current_limit_A(self) -> float:
        """Largest current [A] that is believed."""
        return self.current_limit_C * self.model.capacity_Ah

    @cached_property
    def thevenin(self) -> Thevenin:
        """The equivalent Thevenin circuit: what the start and the charge's variance are written for."""
        return rc.equivalent_thevenin(self.model)

    @cached_property
    def line(self) -> tuple[float, float]:
        """The straight line for which the capacitances stand, through the middle of the OCV curve.

        Voltage [V] at SoC 0, and slope Q / (C_b + C_s) [V per unit of SoC].
        """
        soc, ocv_V = self._curve
        slope_V = self.model.capacity_As / (self.model.c_bulk_F + self.model.c_surface_F)
        return float(np.median(ocv_V - slope_V * soc)), slope_V

    @cached_property
    def model_std_V(self) -> tuple[float, ...]:
        """Model error [V] along SoC, that of the line included."""
        soc, ocv_V = self._curve
        empty_V, slope_V = self.line
        bend_V = ocv_V - empty_V - slope_V * soc
        return tuple(np.hypot(bend_V, on_soc_grid(self.noise.model_std_V, soc)).tolist())

    @property
    def _curve(self) -> tuple[np.ndarray, np.ndarray]:
        soc = np.linspace(0.0, 1.0, 101)
        return soc, self.model.ocv.mean_V(soc, self.model.ocv.reference_degC)
