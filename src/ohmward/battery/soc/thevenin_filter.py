"""State of charge by a Kalman filter on the Thevenin model that also knows how wrong sensors and model may be.

The state is the model's, then five that make the sigma honest:

    soc, v_1 ... v_n, hysteresis     the circuit
    offset                           of the current sensor [A]; a random walk
    charge_gain                      of the current sensor over capacity: 1 / capacity share; a slow random walk
    resistance                       share of the file's resistances; a slow random walk
    model_error                      voltage error of the model in its own standard deviations: of the curve, of its SoC
                                     axis, of the overpotential. It is a function of SoC: it stays while SoC stays, and
                                     is new after `model_soc_length`.

The measurement noise is not white either: an error that holds on for `correlation_s` is one observation in that time,
however often it is sampled, so R = variance * 2 correlation_s / dt. Axis and overpotential err in both ways.

One step works with the extended and the unscented filter, with or without matching R to the residuals ([T] 3.49-3.50).
Q is not matched: matching both finds the size of the noise but not the ratio of Q to R, which is what sets the gain
(`ohmward.filters.adaptive`), and the Q here is physical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
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
from ohmward.battery.soc.clean_sample import CleanSocSample, first_input, is_voltage, sanitize
from ohmward.battery.soc.coulomb import SPREAD, USUAL_C, charge_variance, grown
from ohmward.battery.soc.initial_soc import initial_soc
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.checks import require_between, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.filters import adaptive, extended, unscented
from ohmward.filters.belief import Belief, Correction, Innovation, PackedBelief, nis, pack, unpack
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import clip, linearize, maximum, minimum, table, where

#: A current of this instant that nobody measured, in multiples of the capacity per hour (over an hour: `USUAL_C`).
MOMENTARY_C = 1.0

METHODS: dict[str, ModuleType] = {"ekf": extended, "ukf": unscented}


class FilterState(NamedTuple):
    """All that the filter carries from sample to sample: plain numbers.

    belief: mean (n + 6,) and lower triangle of the covariance.
    noise: moments for covariance matching [V^2].
    current_A, temperature_degC: last credible ones.
    rest_s: how long the current has looked like rest.
    rejected_s: how long the voltage has contradicted the belief.
    unknown_s: how long the current has not been known.
    """

    belief: PackedBelief
    noise: adaptive.NoiseEstimate
    current_A: float
    temperature_degC: float
    rest_s: float
    rejected_s: float
    unknown_s: float


class VoltageError(NamedTuple):
    """How far the voltage may be from the model's.

    lasting_V: standard deviation of the error that stays with SoC; the state `model_error` counts in it.
    variance: of all else [V^2].
    weight: how many times that variance R is, because errors hold on from sample to sample.
    """

    lasting_V: Any
    variance: Any
    weight: Any


@dataclass(frozen=True)
class TheveninFilter:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        model: the circuit.
        noise: what to assume about sensors and model.
        method: "ekf" or "ukf" (redrawn sigma points).
        matching: learn R from the residuals (AEKF, AUKF), `noise` being the floor.
        window: effective samples of that; [T] takes 100.
        idle_current_A: true current of a rest (0 in a laboratory, minus the idle draw on a robot); None when unknown,
            then a rest teaches nothing about the current sensor.
        rest_hold_s: how long the current must look like rest first.
        gap_s: a longer step between two samples says nothing about the current in between.
        gate: largest NIS of a voltage that is used, and largest square of an error that holds on, in its variance.
        reset_after_s: after so much time beyond the gate it is the filter that is wrong: SoC is declared unknown.
        current_limit_C: a larger current, in multiples of the capacity per hour, is a fault of its sensor.
    """

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    method: str = "ekf"
    matching: bool = False
    window: float = 100.0
    idle_current_A: float | None = None
    rest_hold_s: float = 30.0
    gap_s: float = 600.0
    gate: float = 25.0
    reset_after_s: float = 60.0
    current_limit_C: float = 20.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        for name in ("gap_s", "gate", "current_limit_C"):
            require_positive(name, getattr(self, name))
        require_between("window", self.window, 1.0, math.inf)
        require_between("rest_hold_s", self.rest_hold_s, 0.0, math.inf)
        require_between("reset_after_s", self.reset_after_s, 0.0, math.inf)
        if self.idle_current_A is not None:
            require_finite("idle_current_A", self.idle_current_A)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the belief's mean, in order."""
        return (*self.model.state_names, "offset_A", "charge_gain", "resistance_ratio", "model_error")

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> FilterState:
        """State before the first sample, which it looks at: the voltage says how far a given SoC can be true.

        soc: initial state of charge, None when unknown.  soc_std: standard deviation of that value.
        """
        u = first_input(first, self.current_limit_A)
        return self.start(first, *initial_soc(first.voltage_V, u, self.model, self.noise, soc, soc_std))

    def start(self, first: SocSample, soc: float, soc_std: float) -> FilterState:
        """State before the first sample, with a SoC that is taken as it is; traceable, for microcontrollers."""
        u = first_input(first, self.current_limit_A)
        pairs = pair_resistances(soc, u, self.model)
        likely_A = abs(u.current_A) + self.noise.current_offset_std_A
        std = [soc_std, *(r * likely_A + 1e-5 for r in pairs), 0.7]
        std += [self.noise.current_offset_std_A, self.noise.capacity_std, self.noise.resistance_std, 1.0]
        mean = np.array([soc, *(0.0 for _ in pairs), 0.0, 0.0, 1.0, 1.0, 0.0])
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        belief = pack(Belief(mean, np.diag(np.square(np.array(std)))))
        return FilterState(belief, moments, u.current_A, u.temperature_degC, 0.0, 0.0, 0.0)

    def step(self, state: FilterState, sample: SocSample) -> tuple[FilterState, SocEstimate]:
        """The state after a sample, and what is known then."""
        reading = self.sanitize(state, sample)
        prior = METHODS[self.method].predict(
            unpack(state.belief), lambda x: self.next_state(x, reading), self.process_noise(state, reading)
        )
        rest_s, resting = self.rest(state, prior, reading)
        prior = choose(resting, self.zero_current_update(prior, reading), prior)

        lost = state.rejected_s > self.reset_after_s
        prior = choose(lost, _soc_unknown(prior), prior)
        error = self.voltage_error(prior, reading)
        R = np.array([[error.variance * error.weight]]) + (state.noise.residual if self.matching else 0.0)
        measured = is_voltage(sample.voltage_V, self.model.ocv.voltage_V[-1])
        y = np.array([where(measured, sample.voltage_V, 0.0)])
        correction = METHODS[self.method].correct(prior, y, lambda x: self.voltage(x, reading, error), R)
        accepted = measured & (nis(correction.innovation) <= self.gate)
        posterior, limited = _within_limits(choose(accepted, correction.belief, prior), self.model.pairs)

        moments = self.learn(state, correction, y - self.voltage(correction.belief.mean, reading, error))
        after = FilterState(
            pack(posterior),
            choose(accepted, moments, state.noise),
            reading.now.current_A,
            reading.now.temperature_degC,
            rest_s,
            self.rejected_s(state, correction.innovation, R[0, 0] - error.variance, reading, measured),
            reading.unknown_s,
        )
        flags = (
            reading.flags
            + where(measured, 0.0, float(SocFlag.NO_VOLTAGE))
            + where(measured & ~accepted, float(SocFlag.VOLTAGE_REJECTED), 0.0)
            + where(resting, float(SocFlag.REST), 0.0)
            + where(limited, float(SocFlag.SOC_LIMITED), 0.0)
            + where(measured & lost, float(SocFlag.DIVERGED), 0.0)
        )
        return after, self.estimate(posterior, correction, y, measured, flags)

    @property
    def current_limit_A(self) -> float:
        """Largest current [A] that is believed."""
        return self.current_limit_C * self.model.capacity_Ah

    def sanitize(self, state: FilterState, sample: SocSample) -> CleanSocSample:
        """The sample made safe."""
        before = state.current_A, state.temperature_degC
        return sanitize(sample, *before, self.gap_s, self.current_limit_A, state.unknown_s)

    def next_state(self, x: np.ndarray, reading: CleanSocSample) -> np.ndarray:
        """Mean of the state after the step, (n + 6,)."""
        circuit, offset, health, error = self.split(x)
        u = CircuitInput(reading.mean.current_A - offset, reading.mean.temperature_degC)
        moved = next_state(circuit, u, self.model, reading.dt_s, health)
        gain, resistance = x[-3], x[-2]
        kept = self.error_decay(u.current_A, reading)
        return np.array(
            [circuit[0] + gain * (moved[0] - circuit[0]), *moved[1:], offset, gain, resistance, kept * error]
        )

    def voltage(self, x: np.ndarray, reading: CleanSocSample, error: VoltageError) -> np.ndarray:
        """Terminal voltage [V] expected in state x, (1,)."""
        circuit, offset, health, deviations = self.split(x)
        u = CircuitInput(reading.now.current_A - offset, reading.now.temperature_degC)
        return voltage(circuit, u, self.model, health) + error.lasting_V * deviations

    def split(self, x: np.ndarray) -> tuple[np.ndarray, Any, StateOfHealth, Any]:
        """Circuit state, current offset, health (resistance only: the gain acts on the charge) and model error."""
        return x[:-4], x[-4], StateOfHealth(resistance_ratio=x[-2]), x[-1]

    def error_decay(self, current_A: Any, reading: CleanSocSample) -> Any:
        """Share of the model error that is still there after the charge of this step."""
        unknown_A = where(reading.known > 0.5, 0.0, USUAL_C * self.model.capacity_Ah)
        moved_As = (abs(current_A) + unknown_A) * reading.dt_s
        return np.exp(-moved_As / (self.model.capacity_As * self.noise.model_soc_length))

    def process_noise(self, state: FilterState, reading: CleanSocSample) -> np.ndarray:
        """Q (n + 6, n + 6) of this step."""
        noise, p, dt_s = self.noise, self.model, reading.dt_s
        moved = abs(reading.mean.current_A) * dt_s / p.capacity_As
        current_std_A = where(reading.known > 0.5, 0.005, MOMENTARY_C) * p.capacity_Ah
        pairs = [
            (r * current_std_A) ** 2 * (1 - a**2)
            for r, a in zip(pair_resistances(state.belief.mean[0], reading.mean, p), pair_decays(p, dt_s), strict=True)
        ]
        diagonal = [
            charge_variance(reading, noise, p),
            *pairs,
            0.01 * moved + grown(lambda t: minimum(p.hysteresis_rate * USUAL_C * t / 3600.0, 1.0) ** 2, reading),
            noise.current_offset_walk_A**2 * dt_s / 3600.0,
            noise.capacity_walk**2 * dt_s / 3.6e6,
            noise.resistance_walk**2 * dt_s / 3.6e5,
            1 - self.error_decay(reading.mean.current_A, reading) ** 2,
        ]
        return np.diag(np.array(diagonal))

    def voltage_error(self, prior: Belief, reading: CleanSocSample) -> VoltageError:
        """How far the voltage may be from what the model says in the state that is believed."""
        noise = self.noise
        circuit, offset, health, _ = self.split(prior.mean)
        u = CircuitInput(reading.now.current_A - offset, reading.now.temperature_degC)
        inside = np.array([clip(circuit[0], 0.01, 0.99)])  # beyond the ends the curve is straight and hides its bend
        slope, bend = linearize(lambda s: self.ocv_slope(s, circuit, u), inside)
        curvature_V = bend[0, 0] * prior.cov[0, 0]
        over = sum(
            v * v for v in overpotentials(circuit, u, self.model, health)
        )  # they may cancel, their errors do not
        doubtful = (noise.soc_axis_std * slope[0]) ** 2 + noise.overpotential_share**2 * over
        resistance = ohmic_resistance(circuit[0], u, self.model) + sum(pair_resistances(circuit[0], u, self.model))
        unmeasured_V = where(reading.measured > 0.5, 0.0, resistance * (MOMENTARY_C * self.model.capacity_Ah))
        return VoltageError(
            lasting_V=np.sqrt(_on_grid(noise.model_std_V, circuit[0]) ** 2 + doubtful),
            variance=noise.voltage_std_V**2 + doubtful + 0.5 * curvature_V * curvature_V + unmeasured_V * unmeasured_V,
            weight=maximum(1.0, 2 * noise.correlation_s / maximum(reading.dt_s, 1e-3)),
        )

    def ocv_slope(self, soc: np.ndarray, circuit: np.ndarray, u: CircuitInput) -> np.ndarray:
        """Rise of the open-circuit voltage per unit of SoC, (1,), at SoC (1,)."""
        return linearize(lambda s: np.array([open_circuit(np.array([*s, *circuit[1:]]), u, self.model)]), soc)[1][0]

    def rejected_s(
        self, state: FilterState, innovation: Innovation, repeated: Any, reading: CleanSocSample, measured: Any
    ) -> Any:
        """How long the voltage has contradicted the belief, this step included.

        The gate on NIS finds single outliers. R is so large because an error may hold on; one that holds on beyond
        what the variance itself allows is a contradiction although every single sample passes that gate.

        repeated: part of R that is there only because samples are not independent.
        """
        nu, S = innovation.value[0], innovation.cov[0, 0]
        contradicts = nu * nu > self.gate * (S - repeated)
        rejected_s = where(contradicts & (state.rejected_s <= self.reset_after_s), state.rejected_s + reading.dt_s, 0.0)
        return where(measured, rejected_s, state.rejected_s)

    def rest(self, state: FilterState, prior: Belief, reading: CleanSocSample) -> tuple[Any, Any]:
        """How long the current has looked like rest, and whether it counts as one.

        It looks like rest where the current is the declared one within three sigma of its noise and two of the offset.
        A wider gate would take another steady current for the declared one, and learn the difference as an offset.
        """
        if self.idle_current_A is None:
            return 0.0 * reading.dt_s, reading.dt_s < 0.0
        excess = reading.now.current_A - self.idle_current_A - prior.mean[-4]
        reach = 2.0 * np.sqrt(maximum(prior.cov[-4, -4], 0.0)) + 3.0 * self.noise.current_std_A
        looks = (abs(excess) < reach) & (reading.known > 0.5)
        rest_s = where(looks, state.rest_s + reading.dt_s, 0.0)
        return rest_s, rest_s > self.rest_hold_s

    def zero_current_update(self, belief: Belief, reading: CleanSocSample) -> Belief:
        """The belief once the sensor's reading at a known current has been used: it is the offset."""
        if self.idle_current_A is None:
            return belief
        offset = belief.mean[-4]
        R = self.noise.current_std_A**2
        K = belief.cov[:, -4] / (belief.cov[-4, -4] + R)
        mean = belief.mean + K * (reading.now.current_A - self.idle_current_A - offset)
        return Belief(mean, mirror_lower(belief.cov - np.outer(K, belief.cov[-4])))

    def learn(self, state: FilterState, correction: Correction, residual: np.ndarray) -> adaptive.NoiseEstimate:
        """Moments that R is matched to, as after this voltage."""
        if not self.matching:
            return state.noise
        return adaptive.remember(state.noise, correction.innovation.value, residual, self.window)

    def estimate(
        self, posterior: Belief, correction: Correction, y: np.ndarray, measured: Any, flags: Any
    ) -> SocEstimate:
        """What is known after the sample."""
        x, innovation = posterior.mean, correction.innovation
        return SocEstimate(
            soc=x[0],
            soc_std=np.sqrt(maximum(posterior.cov[0, 0], 0.0)),
            voltage_V=y[0] - innovation.value[0],
            voltage_std_V=np.sqrt(innovation.cov[0, 0]),
            innovation_V=where(measured, innovation.value[0], math.nan),
            current_offset_A=x[-4],
            soh_capacity=1.0 / maximum(x[-3], 0.1),
            resistance_ratio=x[-2],
            flags=flags,
        )


def _soc_unknown(belief: Belief) -> Belief:
    """The belief with a SoC of which next to nothing is known, the mean as it was."""
    opened = np.zeros_like(belief.cov)
    opened[0, 0] = maximum(SPREAD**2 - belief.cov[0, 0], 0.0)
    return Belief(belief.mean, belief.cov + opened)


def _within_limits(belief: Belief, pairs: int) -> tuple[Belief, Any]:
    """The belief with SoC projected into [0, 1] along its covariance, hysteresis into [-1, 1]; and whether SoC was.

    Their standard deviations stay within what it means to know nothing of them.
    """
    mean, P = belief.mean, belief.cov
    soc, h = clip(mean[0], 0.0, 1.0), pairs + 1
    projected = mean - P[:, 0] * ((mean[0] - soc) / maximum(P[0, 0], 1e-12))
    limited = np.array([soc, *projected[1:h], clip(projected[h], -1.0, 1.0), *projected[h + 1 :]])
    highest_std = {0: SPREAD, h: 1.0}
    scale = np.array([_at_most(highest_std[k], P[k, k]) if k in highest_std else 1.0 for k in range(len(mean))])
    return Belief(limited, mirror_lower(P * np.outer(scale, scale))), abs(mean[0] - soc) > 0.0


def _at_most(std: float, variance: Any) -> Any:
    """Factor that brings a standard deviation down to `std`; 1 where it is below."""
    return std / np.sqrt(maximum(variance, std**2))


def _on_grid(values: tuple[float, ...], soc: Any) -> Any:
    """Linear between points on a uniform grid of SoC from 0 to 1, constant beyond."""
    return table(values, 0.0, 1.0 / (len(values) - 1), clip(soc, 0.0, 1.0))
