"""The Thevenin model with the errors of sensors and model as states, so that a filter's sigma is honest.

    soc, v_1 ... v_n, hysteresis     the circuit
    offset_A                         of the current sensor; a random walk
    charge_gain                      of the current sensor over capacity, 1 / soh_capacity; a slow random walk
    resistance_ratio                 of the resistances to the file's; a slow random walk
    model_error                      voltage error of the model in its own standard deviations: of the curve, of its SoC
                                     axis, of the overpotential. A Gauss-Markov state along SoC, not time: it stays
                                     while SoC stays, and is new after `model_soc_length`.

The measurement noise is not white either: an error that holds on for `correlation_s` is one observation in that time,
however often it is sampled, so R = variance * 2 correlation_s / dt. Axis and overpotential err in both ways.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import (
    HYSTERESIS_UNKNOWN_STD,
    HYSTERESIS_VARIANCE_PER_SOC,
    MOMENTARY_C,
    PAIR_CURRENT_C,
    USUAL_C,
    BatteryNoise,
)
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.models.thevenin import (
    CircuitInput,
    StateOfHealth,
    Thevenin,
    next_state,
    ohmic_resistance,
    open_circuit,
    overpotentials,
    pair_decays,
    pair_resistances,
    voltage,
)
from ohmward.battery.soc.clean_sample import CleanSocSample
from ohmward.battery.soc.coulomb import charge_variance, growth_while_unknown
from ohmward.filters.belief import Belief
from ohmward.trace import clip, linearize, minimum, where
from ohmward.trace.expression import Scalar

#: Standard deviation [V] that an RC voltage has at the start at least, so that no variance is zero: far below a sensor.
LEAST_PAIR_STD_V = 1e-5

#: The curvature is taken at least this far inside the ends of the curve, which goes on there as a straight line.
END_MARGIN = 0.01

#: Index of the state of charge in the state.
SOC = 0


class AugmentedState(NamedTuple):
    """The state vector taken apart; likewise vectors of standard deviations or of process variances.

    circuit: (n + 2,) state of the model, as `Thevenin.state_names`.
    offset_A, charge_gain, resistance_ratio, model_error: the four states of the errors.
    """

    circuit: Any
    offset_A: Any
    charge_gain: Any
    resistance_ratio: Any
    model_error: Any

    @property
    def health(self) -> StateOfHealth:
        """State of health of the circuit: resistance only, because the gain acts on the charge."""
        return StateOfHealth(resistance_ratio=self.resistance_ratio)

    def vector(self) -> np.ndarray:
        """The elements in one vector (n + 6,)."""
        return np.array([*self.circuit, self.offset_A, self.charge_gain, self.resistance_ratio, self.model_error])


class VoltageError(NamedTuple):
    """Difference between the measured voltage and the model's.

    model_std_V: standard deviation of the error that stays with SoC, the unit of the state `model_error`.
    variance: of all else [V^2].
    weight: factor of that variance in R, because errors hold on from sample to sample.
    """

    model_std_V: Scalar
    variance: Scalar
    weight: Scalar


@dataclass(frozen=True)
class AugmentedThevenin:
    """Model functions of the filter: next state, voltage, and their noise.

    Attributes:
        model: the circuit.
        noise: of voltage and model.
        sensor: of the current.
    """

    model: Thevenin
    noise: BatteryNoise
    sensor: CurrentSensor

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state, in order."""
        return (*self.model.state_names, *AugmentedState._fields[1:])

    @property
    def hysteresis_index(self) -> int:
        """Index of the hysteresis in the state."""
        return self.state_names.index("hysteresis")

    @property
    def offset_index(self) -> int:
        """Index of the current sensor's offset in the state."""
        return self.state_names.index("offset_A")

    def start(self, soc: Scalar, soc_std: Scalar, u: CircuitInput) -> Belief:
        """Belief before the first sample, at this SoC with current and temperature u."""
        noise = self.noise
        likely_A = abs(u.current_A) + self.sensor.offset_std_A
        pairs = [r * likely_A + LEAST_PAIR_STD_V for r in pair_resistances(soc, u, self.model)]
        std = AugmentedState(
            circuit=[soc_std, *pairs, HYSTERESIS_UNKNOWN_STD],
            offset_A=self.sensor.offset_std_A,
            charge_gain=math.hypot(noise.capacity_std, self.sensor.gain_std),
            resistance_ratio=noise.resistance_std,
            model_error=1.0,
        )
        relaxed = [soc, *(0.0 for _ in pairs), 0.0]
        mean = AugmentedState(relaxed, offset_A=0.0, charge_gain=1.0, resistance_ratio=1.0, model_error=0.0)
        return Belief(mean.vector(), np.diag(np.square(std.vector())))

    def split(self, x: np.ndarray) -> AugmentedState:
        """The elements of a state vector (n + 6,)."""
        *circuit, offset_A, charge_gain, resistance_ratio, model_error = x
        return AugmentedState(np.array(circuit), offset_A, charge_gain, resistance_ratio, model_error)

    def next_state(self, x: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """Mean of the state after the step, (n + 6,)."""
        before = self.split(x)
        u = CircuitInput(clean.mean.current_A - before.offset_A, clean.mean.temperature_degC)
        soc, *rest = next_state(before.circuit, u, self.model, clean.dt_s, before.health)
        charged = before.circuit[SOC] + before.charge_gain * (soc - before.circuit[SOC])
        decay = self.error_decay(u.current_A, clean)
        return before._replace(circuit=[charged, *rest], model_error=decay * before.model_error).vector()

    def voltage(self, x: np.ndarray, clean: CleanSocSample, error: VoltageError) -> np.ndarray:
        """Terminal voltage [V] expected in state x, (1,)."""
        state = self.split(x)
        u = CircuitInput(clean.now.current_A - state.offset_A, clean.now.temperature_degC)
        return voltage(state.circuit, u, self.model, state.health) + error.model_std_V * state.model_error

    def error_decay(self, current_A: Scalar, clean: CleanSocSample) -> Scalar:
        """Decay factor of the model error by the charge of this step."""
        unknown_A = where(clean.current_known, 0.0, USUAL_C * self.model.capacity_Ah)
        moved_As = (abs(current_A) + unknown_A) * clean.dt_s
        return np.exp(-moved_As / (self.model.capacity_As * self.noise.model_soc_length))

    def process_noise(self, x: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """Q (n + 6, n + 6) of this step from the state x."""
        noise, p, dt_s = self.noise, self.model, clean.dt_s
        moved = abs(clean.mean.current_A) * dt_s / p.capacity_As
        wander_A = where(clean.current_known, PAIR_CURRENT_C, MOMENTARY_C) * p.capacity_Ah
        resistances = pair_resistances(x[SOC], clean.mean, p)
        decays = pair_decays(clean.mean, p, dt_s)
        pairs = [(r * wander_A) ** 2 * (1 - a**2) for r, a in zip(resistances, decays, strict=True)]
        unknown = growth_while_unknown(lambda t_s: minimum(p.hysteresis_rate * USUAL_C * t_s / 3600.0, 1.0) ** 2, clean)
        variances = AugmentedState(
            circuit=[charge_variance(clean, self.sensor, p), *pairs, HYSTERESIS_VARIANCE_PER_SOC * moved + unknown],
            offset_A=self.sensor.offset_walk_variance(dt_s),
            charge_gain=noise.capacity_walk_variance(dt_s),
            resistance_ratio=noise.resistance_walk_variance(dt_s),
            model_error=1 - self.error_decay(clean.mean.current_A, clean) ** 2,
        )
        return np.diag(variances.vector())

    def voltage_error(self, prior: Belief, clean: CleanSocSample) -> VoltageError:
        """Errors of the voltage that the model gives in the state that is believed."""
        noise, state = self.noise, self.split(prior.mean)
        u = CircuitInput(clean.now.current_A - state.offset_A, clean.now.temperature_degC)
        soc = state.circuit[SOC]
        inside = np.array([clip(soc, END_MARGIN, 1 - END_MARGIN)])
        slope, curvature = linearize(lambda s: self.ocv_slope(s, state.circuit, u), inside)
        curvature_V = curvature[0, 0] * prior.cov[SOC, SOC]
        over = overpotentials(state.circuit, u, self.model, state.health)  # they may cancel, their errors do not
        over_V2 = sum(v * v for v in over)
        uncertain_V2 = (noise.soc_axis_std * slope[0]) ** 2 + noise.overpotential_share_at(soc) ** 2 * over_V2
        resistance_ohm = ohmic_resistance(soc, u, self.model) + sum(pair_resistances(soc, u, self.model))
        unmeasured_V = where(clean.current_measured, 0.0, resistance_ohm * (MOMENTARY_C * self.model.capacity_Ah))
        return VoltageError(
            model_std_V=np.sqrt(noise.model_std_at(soc) ** 2 + uncertain_V2),
            variance=noise.voltage_std_V**2
            + uncertain_V2
            + 0.5 * curvature_V * curvature_V
            + unmeasured_V * unmeasured_V,
            weight=noise.samples_per_error(clean.dt_s),
        )

    def ocv_slope(self, soc: np.ndarray, circuit: np.ndarray, u: CircuitInput) -> np.ndarray:
        """Slope of the open-circuit voltage per unit of SoC, (1,), at SoC (1,)."""
        return linearize(lambda s: np.array([open_circuit(np.array([*s, *circuit[1:]]), u, self.model)]), soc)[1][0]
