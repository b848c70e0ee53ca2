"""The Thevenin model with the errors of sensors and model as states, so that a filter's sigma is honest.

    soc, v_1 ... v_n, hysteresis     the circuit
    offset_A                         of the current sensor; a random walk
    charge_gain                      of the current sensor over capacity, 1 / soh_capacity; a slow random walk
    ohmic_log_ratio, pair_log_ratio  ln of the resistances over the file's: R_0, and those of the RC pairs together;
                                     slow random walks. As logarithms they cannot turn negative, and twice as large is
                                     as likely as half as large.
    model_error                      voltage error of the model in its own standard deviations: of the curve and its
                                     temperature, and of the overpotential. A Gauss-Markov state along SoC, not time: it
                                     stays while SoC stays, and is new after `model_soc_length`.
    axis_error                       error of the curve's SoC axis in its own standard deviations, likewise: a shift of
                                     the curve
    level_error                      error of the level of the curve, likewise: it stays ten times as long; both grow
                                     away from the temperature of the curve
    voltage_gain_error               error of the voltage sensor's gain in its own standard deviations: it stays
    ohmic_activation_error_K, pair_activation_error_K
                                     errors of the activation temperatures: the band opens where the battery leaves the
                                     temperature of the test, and closes where it comes back
    hysteresis_log_ratio             ln of the hysteresis voltage over the file's; on the branch of the test, the
                                     open-circuit voltage stays

Those after the model error exist only where the file gives them a standard deviation, and that of the axis where a
test has shown the curve: the curve of a label is shifted differently from place to place, so that its axis belongs to
the model error. The measurement noise is not white either: an
error that persists for a correlation time is one observation in that time, however often it is sampled, so
R = variance * 2 correlation time / dt. Errors that change from place to place and in time enter both the state and R:
of the overpotential, and of the axis of a label.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import (
    HYSTERESIS_UNKNOWN_STD,
    HYSTERESIS_VARIANCE_PER_SOC,
    LEVEL_SOC_LENGTH,
    MOMENTARY_C,
    PAIR_CURRENT_C,
    RESISTANCE_CORRELATION,
    USUAL_C,
    BatteryNoise,
    CurrentSensor,
    path_std_A,
)
from ohmward.battery.models.ocv import beyond_line, slip_shape
from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import (
    CircuitInput,
    StateOfHealth,
    Thevenin,
    emptiness,
    log_ratio_by_weather,
    next_state,
    ohmic_resistance,
    open_circuit,
    overpotentials,
    pair_decays,
    pair_resistances,
    scaled_hysteresis,
    voltage,
)
from ohmward.battery.soc.clean_sample import WAITS_S, CleanSocSample
from ohmward.battery.soc.coulomb import charge_variance, growth_while_unknown
from ohmward.battery.soc.initial_soc import axis_error_V, lasting_std_V
from ohmward.filters.belief import Belief
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Scalar, clip, exp, linearize, maximum, minimum, sign, sqrt, where

#: Smallest standard deviation [V] of an RC voltage at the start, so that no variance is zero: far below any sensor's.
LEAST_PAIR_STD_V = 1e-5

#: The tangent is taken at least this far inside the ends of the curve, which goes on there as a straight line.
END_MARGIN = 0.01

#: The error of the tangent is evaluated over a SoC of at most this standard deviation, and within the steep ends of the
#: curve, each this wide, over one of at most `END_STD`: otherwise an unknown SoC would let no voltage in.
TANGENT_STD = 0.2
STEEP_END = 0.1
END_STD = 0.1

#: Share of an error of the activation that is not common to the whole overpotential: it differs with SoC, and between
#: the processes of the cell. Measured on LFP, NCA and NMC at -15 to 5 degC with files from 25 degC.
UNEVEN_ACTIVATION = 0.5

#: Relative error of the rate at which the hysteresis follows the charge; cells differ by a factor of two.
HYSTERESIS_RATE_STD = 0.5

#: The same where it follows the net charge: variance of its state per unit that it would move if it did not saturate.
#: After a turn from one branch to the other it is off by 0.14. On a branch it keeps a variance.
HYSTERESIS_TURN_VARIANCE = 0.01

#: Far below the resistance of any battery [ohm].
_LEAST_OHM = 1e-9

#: The largest capacity that is reported is ten times the file's: the gain is its inverse.
LEAST_CHARGE_GAIN = 0.1

#: Index of the state of charge in the state.
SOC = 0


class AugmentedState(NamedTuple):
    """Elements of the state vector, or of a vector of standard deviations or process variances.

    circuit: (n + 2,) state of the model, as `Thevenin.state_names`.
    All others are the states of the errors; 0 for one that the file takes as exact.
    """

    circuit: Any
    offset_A: Any
    charge_gain: Any
    ohmic_log_ratio: Any
    pair_log_ratio: Any
    model_error: Any
    axis_error: Any = 0.0
    level_error: Any = 0.0
    voltage_gain_error: Any = 0.0
    ohmic_activation_error_K: Any = 0.0
    pair_activation_error_K: Any = 0.0
    hysteresis_log_ratio: Any = 0.0

    def ohmic(self, coldness: Scalar) -> StateOfHealth:
        """State of health of R_0 at this coldness; of the resistance only, because the gain acts on the charge."""
        return StateOfHealth(resistance_ratio=exp(self.ohmic_log_ratio + coldness * self.ohmic_activation_error_K))

    def pair(self, coldness: Scalar) -> StateOfHealth:
        """The same for the RC pairs."""
        return StateOfHealth(resistance_ratio=exp(self.pair_log_ratio + coldness * self.pair_activation_error_K))


class VoltageError(NamedTuple):
    """Difference between the measured voltage and the model's."""

    model_std_V: Scalar  #: standard deviation of the error that stays with SoC, the unit of the state `model_error`
    variance: Scalar  #: of all other errors [V^2]
    weight: Scalar  #: factor of that variance in R, because errors persist from sample to sample
    uncertain_V2: Scalar = 0.0  #: part of both from the errors of overpotential and of a label's axis [V^2]
    #: mean [V] of what the tangent of the curve leaves out, and its part of the variance [V^2]
    tangent_V: Scalar = 0.0
    tangent_V2: Scalar = 0.0
    axis_std: Scalar = 0.0  #: of the SoC axis of the curve, the unit of the state `axis_error`
    axis_std_V: Scalar = 0.0  #: the same as a voltage
    level_std_V: Scalar = 0.0  #: of the error of the curve's level, the unit of the state `level_error`
    gain_std_V: Scalar = 0.0  #: of the error by the voltage sensor's gain, the unit of `voltage_gain_error`
    total_ohm: Scalar = 0.0  #: resistance to a steady current


@dataclass(frozen=True)
class AugmentedThevenin:
    """Model functions of the filter: next state, voltage, and their noise."""

    model: Thevenin  #: the circuit
    noise: BatteryNoise  #: noise of voltage and model
    sensor: CurrentSensor  #: current sensor

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state, in order."""
        return (*self.model.state_names, *self.error_names)

    @property
    def error_names(self) -> tuple[str, ...]:
        """Names of the states of the errors, in order; without those that the file takes as exact."""
        stds = {
            "axis_error": self.axis_is_shift,
            "level_error": self.noise.level_std_V,
            "voltage_gain_error": self.noise.voltage_gain_std,
            "ohmic_activation_error_K": self.noise.activation_std_K,
            "pair_activation_error_K": self.noise.activation_std_K,
            "hysteresis_log_ratio": self.noise.hysteresis_std * any(self.model.ocv.hysteresis_V),
        }
        return tuple(name for name in AugmentedState._fields[1:] if stds.get(name, 1.0))

    @property
    def axis_is_shift(self) -> bool:
        """True where an error of the SoC axis shifts the whole curve: in the file of a tested battery."""
        return self.noise.level_std_V > 0.0

    @property
    def hysteresis_index(self) -> int:
        """Index of the hysteresis in the state."""
        return self.state_names.index("hysteresis")

    @property
    def offset_index(self) -> int:
        """Index of the current sensor's offset in the state."""
        return self.state_names.index("offset_A")

    @property
    def gain_index(self) -> int:
        """Index of the gain of the charge in the state."""
        return self.state_names.index("charge_gain")

    def start(self, soc: Scalar, soc_std: Scalar, u: CircuitInput) -> Belief:
        """Belief before the first sample, at this SoC with current and temperature u."""
        noise = self.noise
        likely_A = abs(u.current_A) + self.sensor.offset_std_A
        weather = log_ratio_by_weather(u, self.model)
        # root of the second moment of a log-normal ratio
        wider = exp(noise.resistance_variance_at(u, self.model))
        resistance_std = sqrt(noise.resistance_std**2 + weather * weather)
        pairs = [wider * r * likely_A + LEAST_PAIR_STD_V for r in pair_resistances(soc, u, self.model)]
        std = AugmentedState(
            circuit=[soc_std, *pairs, HYSTERESIS_UNKNOWN_STD],
            offset_A=self.sensor.offset_std_A,
            charge_gain=math.hypot(noise.capacity_std, self.sensor.gain_std),
            ohmic_log_ratio=resistance_std,
            pair_log_ratio=resistance_std,
            model_error=1.0,
            axis_error=1.0,
            level_error=1.0,
            voltage_gain_error=1.0,
            ohmic_activation_error_K=noise.activation_std_K,
            pair_activation_error_K=noise.activation_std_K,
            hysteresis_log_ratio=noise.hysteresis_std,
        )
        mean = AugmentedState([soc, *(0.0 for _ in pairs), 0.0], self.sensor.offset_A, 1.0, 0.0, 0.0, 0.0)
        cov = np.diag(np.square(self.vector(std)))
        names = ("ohmic_log_ratio", "pair_log_ratio", "charge_gain")
        ohmic, pair, gain = (self.state_names.index(name) for name in names)
        cov[ohmic, pair] = cov[pair, ohmic] = RESISTANCE_CORRELATION * noise.resistance_std**2 + weather * weather
        for ratio in (ohmic, pair):
            cov[gain, ratio] = cov[ratio, gain] = noise.ageing_covariance
        return Belief(self.vector(mean), cov)

    def at_rest(self, belief: Belief, dt_s: float, temperature_degC: float) -> Belief:
        """The belief after `dt_s` [s] at a current of exactly zero: RC voltages fade, all else stays."""
        decays = pair_decays(CircuitInput(0.0, temperature_degC), self.model, dt_s)
        F, Q = np.eye(len(belief.mean)), np.zeros_like(belief.cov)
        for j, a in enumerate(decays, start=1):
            F[j, j], Q[j, j] = a, LEAST_PAIR_STD_V**2 * (1 - a * a)
        return Belief(F @ belief.mean, F @ belief.cov @ F.T + Q)

    def split(self, x: np.ndarray) -> AugmentedState:
        """The elements of a state vector."""
        n = self.model.pairs + 2
        return AugmentedState(x[:n], **dict(zip(self.error_names, x[n:], strict=True)))

    def vector(self, state: AugmentedState) -> np.ndarray:
        """The elements in one vector, as `state_names`."""
        return np.array([*state.circuit, *(getattr(state, name) for name in self.error_names)])

    def coldness(self, u: CircuitInput) -> Scalar:
        """Distance from the temperature of the file in an Arrhenius law, 1/T - 1/T_reference [1/K].

        Where T is not measured, errors are those of a battery that is colder by its standard deviation.
        """
        return coldness_per_K(u.error_degC, self.model.reference_degC)

    def next_state(self, x: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """Mean of the state after the step."""
        before = self.split(x)
        u = clean.mean._replace(current_A=clean.mean.current_A - before.offset_A)
        soc, *rest = next_state(before.circuit, u, self.model, clean.dt_s, before.pair(self.coldness(u)))
        charged = before.circuit[SOC] + before.charge_gain * (soc - before.circuit[SOC])
        model_decay, level_decay = self.error_decays(u.current_A, clean)
        return self.vector(
            before._replace(
                circuit=[charged, *rest],
                model_error=model_decay * before.model_error,
                axis_error=model_decay * before.axis_error,
                level_error=level_decay * before.level_error,
            )
        )

    def voltage(self, x: np.ndarray, clean: CleanSocSample, error: VoltageError) -> np.ndarray:
        """Terminal voltage [V] expected in state x, (1,)."""
        state = self.split(x)
        u = clean.now._replace(current_A=clean.now.current_A - state.offset_A)
        _, *v, h = state.circuit
        hysteresis = scaled_hysteresis(h, exp(state.hysteresis_log_ratio), self.model)
        circuit = np.array([self.curve_soc(state, error.axis_std), *v, hysteresis])
        circuit_V = voltage(circuit, u, self.model, state.ohmic(self.coldness(u)))
        lasting_V = error.model_std_V * state.model_error + error.level_std_V * state.level_error
        gain_V = error.gain_std_V * state.voltage_gain_error
        return circuit_V + lasting_V + gain_V + error.tangent_V

    def resistance_ratio(self, state: AugmentedState) -> Scalar:
        """Resistance to a steady current over the file's, at the reference temperature of the file."""
        soc, u = state.circuit[SOC], CircuitInput(-1.0, self.model.reference_degC)
        ohmic_ohm, pair_ohm = ohmic_resistance(soc, u, self.model), sum(pair_resistances(soc, u, self.model))
        grown_ohm = ohmic_ohm * exp(state.ohmic_log_ratio) + pair_ohm * exp(state.pair_log_ratio)
        per_ohm = 1.0 / (ohmic_ohm + pair_ohm + _LEAST_OHM)
        return where(ohmic_ohm + pair_ohm > 0.0, grown_ohm * per_ohm, 1.0)

    def known(self, belief: Belief) -> dict[str, Scalar]:
        """SoC, offset, capacity and resistance with their standard deviations, as the fields of `SocEstimate`.

        The standard deviation of a function g of the state is sqrt(G P G'), G = dg/dx. Capacity cannot be separated
        from the gain of the sensor that counts it, so the error of the gain is added.
        """
        x, P = self.split(belief.mean), belief.cov
        variances = self.split(np.diag(P))
        soh = 1.0 / maximum(x.charge_gain, LEAST_CHARGE_GAIN)
        ratio, G = linearize(lambda x: np.array([self.resistance_ratio(self.split(x))]), belief.mean)
        return {
            "soc": x.circuit[SOC],
            "soc_std": np.sqrt(maximum(variances.circuit[SOC], 0.0)),
            "current_offset_A": x.offset_A,
            "current_offset_std_A": np.sqrt(maximum(variances.offset_A, 0.0)),
            "soh_capacity": soh,
            "soh_capacity_std": soh
            * np.sqrt(soh * soh * maximum(variances.charge_gain, 0.0) + self.sensor.gain_std**2),
            "resistance_ratio": ratio[0],
            "resistance_ratio_std": np.sqrt(maximum((G @ P @ G.T)[0, 0], 0.0)),
        }

    def error_decays(self, current_A: Scalar, clean: CleanSocSample) -> tuple[Scalar, Scalar]:
        """Decay factors of the model error and the level error over the charge of this step."""
        moved = self.moved(current_A, clean)
        return exp(-moved / self.noise.model_soc_length), exp(-moved / LEVEL_SOC_LENGTH)

    def moved(self, current_A: Scalar, clean: CleanSocSample) -> Scalar:
        """Charge that flows in this step, in or out, over the capacity; a usual one where it is not known."""
        unknown_A = where(clean.current_known, 0.0, USUAL_C * self.model.capacity_Ah)
        return (abs(current_A) + unknown_A) * clean.dt_s / self.model.capacity_As

    def process_noise(self, x: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """Q of this step from the state x, (n, n) for n states."""
        noise, p, dt_s, state = self.noise, self.model, clean.dt_s, self.split(x)
        walk_A = self.walk_A(clean)
        path_A = path_std_A(clean.change_A, dt_s)
        pairs = list(zip(self.pair_ohm(x, clean), pair_decays(clean.mean, p, dt_s), strict=True))
        model_decay, level_decay = self.error_decays(clean.mean.current_A, clean)
        variances = AugmentedState(
            circuit=[
                charge_variance(clean, self.sensor, p),
                *((walk_A * r) ** 2 * (1 - a**2) + (path_A * r * (1 - a)) ** 2 for r, a in pairs),
                self.hysteresis_variance(state.circuit[-1], clean),
            ],
            offset_A=self.sensor.offset_walk_variance(dt_s),
            charge_gain=noise.capacity_walk_variance(dt_s),
            ohmic_log_ratio=noise.resistance_walk_variance(dt_s),
            pair_log_ratio=noise.resistance_walk_variance(dt_s),
            model_error=1 - model_decay**2,
            axis_error=1 - model_decay**2,
            level_error=1 - level_decay**2,
        )
        return np.diag(self.vector(variances))

    def walk_A(self, clean: CleanSocSample) -> Scalar:
        """Standard deviation [A] of the current that would cause the random walk of the RC voltages."""
        return where(clean.unknown_s < WAITS_S, PAIR_CURRENT_C, MOMENTARY_C) * self.model.capacity_Ah

    def pair_ohm(self, x: np.ndarray, clean: CleanSocSample) -> list[Any]:
        """Resistances [ohm] of the RC pairs in state x."""
        ratio = self.split(x).pair(self.coldness(clean.mean)).resistance_ratio
        return [ratio * r for r in pair_resistances(x[SOC], clean.mean, self.model)]

    def hysteresis_variance(self, h: Scalar, clean: CleanSocSample) -> Scalar:
        """Process variance of the hysteresis state h: its rate is uncertain, and the current may be unknown.

        A rate that is wrong by `HYSTERESIS_RATE_STD` leaves an error in proportion to the distance still to go.
        """
        p, i = self.model, clean.mean.current_A
        moved = abs(i) * clean.dt_s / p.capacity_As
        unknown = growth_while_unknown(
            lambda t_s: minimum(p.hysteresis_rate * USUAL_C * t_s / SECONDS_PER_HOUR, 1.0) ** 2, clean
        )
        if p.net_charge_hysteresis:
            turned = HYSTERESIS_TURN_VARIANCE * p.hysteresis_rate * moved
        else:
            ahead = HYSTERESIS_RATE_STD * (sign(i) - h)
            turned = (1 - exp(-p.hysteresis_rate * moved)) * ahead * ahead
        return HYSTERESIS_VARIANCE_PER_SOC * moved + turned + unknown

    def voltage_error(self, prior: Belief, clean: CleanSocSample) -> VoltageError:
        """Errors of the voltage that the model predicts at the prior mean."""
        noise, state = self.noise, self.split(prior.mean)
        u = clean.now._replace(current_A=clean.now.current_A - state.offset_A)
        soc = state.circuit[SOC]
        axis_std = sqrt(self.axis_variance(state))
        shift_std = axis_std if self.axis_is_shift else 0.0
        inside = np.array([clip(self.curve_soc(state, shift_std), END_MARGIN, 1 - END_MARGIN)])
        slope = self.ocv_slope(inside, state.circuit, u)
        std = minimum(np.sqrt(maximum(prior.cov[SOC, SOC], 0.0)), TANGENT_STD)
        tangent_V, tangent_V2 = self.tangent_error(inside[0], slope[0], std, state.circuit, u)
        over_V2 = sum(v * v for v in self.overpotentials(state, u))  # they may cancel, their errors do not
        uncertain_V2 = self.overpotential_share(soc, u) ** 2 * over_V2
        if not self.axis_is_shift:
            uncertain_V2 = uncertain_V2 + (axis_std * slope[0]) ** 2
        total_ohm = self.total_ohm(state, u)
        momentary_V = total_ohm * (MOMENTARY_C * self.model.capacity_Ah)
        unmeasured_V = where(clean.current_measured, 0.0, momentary_V)
        curve_V, level_V = noise.curve_stds(soc, u.error_degC - self.model.ocv.reference_degC)
        return VoltageError(
            model_std_V=np.sqrt(curve_V**2 + uncertain_V2),
            variance=noise.voltage_std_V**2 + uncertain_V2 + tangent_V2 + unmeasured_V * unmeasured_V,
            weight=noise.samples_per_error(clean.voltage_step_s),
            uncertain_V2=uncertain_V2,
            tangent_V=tangent_V,
            tangent_V2=tangent_V2,
            axis_std=shift_std,
            axis_std_V=shift_std * slope[0],
            level_std_V=level_V,
            gain_std_V=noise.gain_error_V(soc, u, self.model),
            total_ohm=total_ohm,
        )

    def error_shares(self, soc: Scalar, u: CircuitInput) -> dict[str, Scalar]:
        """Shares of the lasting errors in the standard deviation of their sum at rest; their squares add up to 1."""
        _, level_V = self.noise.curve_stds(soc, u.error_degC - self.model.ocv.reference_degC)
        stds_V = {
            "axis_error": axis_error_V(soc, u, self.model, self.noise),
            "level_error": level_V,
            "voltage_gain_error": self.noise.gain_error_V(soc, u, self.model),
        }
        total_V = lasting_std_V(soc, u, self.model, self.noise)
        shares = {name: std_V / total_V for name, std_V in stds_V.items() if name in self.error_names}
        return {"model_error": np.sqrt(maximum(1.0 - sum(share * share for share in shares.values()), 0.0))} | shares

    def tangent_error(
        self, soc: Scalar, slope: Scalar, std: Scalar, circuit: np.ndarray, u: CircuitInput
    ) -> tuple[Scalar, Scalar]:
        """Mean [V] and variance [V^2] of what the tangent of the open-circuit voltage leaves out for a normal SoC."""
        away, near = math.sqrt(3.0) * std, math.sqrt(3.0) * minimum(std, END_STD)
        low = maximum(soc - away, minimum(soc - near, STEEP_END))
        high = minimum(soc + away, maximum(soc + near, 1.0 - STEEP_END))
        low_V, middle_V, high_V = (open_circuit(np.array([s, *circuit[1:]]), u, self.model) for s in (low, soc, high))
        above_V, below_V = high_V - middle_V - slope * (high - soc), low_V - middle_V - slope * (low - soc)
        return beyond_line(above_V, below_V)

    def overpotentials(self, state: AugmentedState, u: CircuitInput) -> list[Any]:
        """Overpotentials [V] in this state: of the RC pairs, then the ohmic drop."""
        return overpotentials(state.circuit, u, self.model, state.ohmic(self.coldness(u)))

    def overpotential_share(self, soc: Scalar, u: CircuitInput) -> Scalar:
        """Relative error of the overpotential beyond a common factor; it grows away from the test's temperature."""
        base = self.noise.overpotential_share_at(soc)
        cold = self.coldness(u)
        uneven = UNEVEN_ACTIVATION * self.noise.activation_std_K * cold
        weather = UNEVEN_ACTIVATION * log_ratio_by_weather(u, self.model)
        empty = self.noise.empty_activation_std_K * maximum(cold, 0.0) * emptiness(soc)
        return np.sqrt(base**2 + uneven * uneven + weather * weather + empty * empty)

    def curve_soc(self, state: AugmentedState, axis_std: Scalar) -> Scalar:
        """SoC at which the curve of the file has the voltage of the aged battery; axis_std: unit of the axis error."""
        return state.circuit[SOC] + self.model.ocv_slip * self.slip_at(state) + axis_std * state.axis_error

    def axis_variance(self, state: AugmentedState) -> Scalar:
        """Variance of the SoC axis of the curve: the file's, and what a loss of capacity adds."""
        slipped = self.noise.ocv_slip_std * self.slip_at(state)
        return self.noise.axis_std_at(state.circuit[SOC]) ** 2 + slipped * slipped

    def slip_at(self, state: AugmentedState) -> Scalar:
        """Slip of the electrodes in this state per unit of `ocv_slip`; the loss is relative to the capacity left."""
        return slip_shape(state.circuit[SOC], self.model.ocv_slip) * (state.charge_gain - 1.0)

    def total_ohm(self, state: AugmentedState, u: CircuitInput) -> Scalar:
        """Resistance to a steady current [ohm] in this state."""
        soc, cold = state.circuit[SOC], self.coldness(u)
        pairs = state.pair(cold).resistance_ratio * sum(pair_resistances(soc, u, self.model))
        return state.ohmic(cold).resistance_ratio * ohmic_resistance(soc, u, self.model) + pairs

    def ocv_slope(self, soc: np.ndarray, circuit: np.ndarray, u: CircuitInput) -> np.ndarray:
        """Slope of the open-circuit voltage per unit of SoC, (1,), at SoC (1,)."""
        return linearize(lambda s: np.array([open_circuit(np.array([*s, *circuit[1:]]), u, self.model)]), soc)[1][0]
