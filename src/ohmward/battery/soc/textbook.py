"""State of charge by the filter of the textbooks and of [P] 2.3: SoC and RC voltages, nothing else.

    x = [soc, v_1 ... v_n]        y = V

It trusts current sensor, capacity and curve, so its sigma is far too small on a real robot: it is the baseline of
`compare`, and fits into 2 KB of a microcontroller. The state moves linearly once the resistances are taken at the mean,
so that the Kalman filter predicts it exactly; only the curve needs the extended or the unscented one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import PAIR_CURRENT_C, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import (
    CircuitInput,
    Thevenin,
    charge,
    ohmic_drop,
    pair_decays,
    pair_resistances,
)
from ohmward.battery.soc.clean_sample import first_input, sanitize_bare
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.checks import require_one_of
from ohmward.filters import conditionally_linear, extended, kalman
from ohmward.filters.belief import Belief, Correction, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.trace import Scalar, clip, logical_not, maximum, where

METHODS = ("ekf", "ukf")

#: Standard deviation of an RC voltage at the start [V], in addition to that by the first current.
LEAST_START_STD_V = 1e-3


class TextbookState(NamedTuple):
    """State of the filter."""

    belief: PackedBelief  #: mean (n + 1,) and lower triangle of the covariance
    current_A: Any  #: of the sample before


class VoltageSample(NamedTuple):
    """Voltage of a sample."""

    voltage_V: Scalar  #: measured; 0 where it is missing
    drop_V: Scalar  #: across the ohmic resistance
    measured: Any  #: the condition that it is measured


@dataclass(frozen=True)
class TextbookFilter:
    """Settings; `init`, `start` and `step` are pure functions of them. Temperature and hysteresis are ignored."""

    model: Thevenin  #: the circuit, at its reference temperature
    #: noise of the voltage and error of the model; the other values are not used
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: current sensor; only its noise is used
    method: str = "ukf"  #: "ekf" or "ukf"

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> TextbookState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return VoltageStart(self.model, self.noise, self.sensor)

    def start_from(self, first: SocSample, part: Hypothesis) -> TextbookState:
        """State before the first sample with this density of SoC; traceable."""
        return self.start(first, part.start.soc, part.start.std)

    def start(self, first: SocSample, soc: Scalar, soc_std: Scalar) -> TextbookState:
        """State before the first sample at the given SoC, unchecked by its voltage; traceable."""
        u = first_input(first)
        std = [soc_std, *(r * abs(u.current_A) + LEAST_START_STD_V for r in self.pairs(soc))]
        mean = np.array([soc, *(0.0 for _ in std[1:])])
        return TextbookState(pack(Belief(mean, np.diag(np.square(np.array(std))))), u.current_A)

    def step(self, state: TextbookState, sample: SocSample) -> tuple[TextbookState, SocEstimate]:
        """State and estimate after a sample."""
        before, clean = self.predicted(state, sample)
        y = np.array([clean.voltage_V])
        posterior, innovation, _ = self.correct(unpack(before.belief), y, clean.drop_V, clean.measured)
        soc, variance = posterior.mean[0], posterior.cov[0, 0]
        estimate = self.estimate(soc, variance, innovation.value[0], innovation.cov[0, 0], clean)
        return before._replace(belief=pack(posterior)), estimate

    def predicted(self, state: TextbookState, sample: SocSample) -> tuple[TextbookState, VoltageSample]:
        """State before the voltage of a sample is used, and that voltage."""
        clean = sanitize_bare(sample, state.current_A, self.model.ocv.voltage_V[-1])
        prior = self.predict(unpack(state.belief), clean.mean_A, clean.dt_s)
        drop_V = ohmic_drop(prior.mean[0], self.input(clean.current_A), self.model)
        return TextbookState(pack(prior), clean.current_A), VoltageSample(clean.voltage_V, drop_V, clean.measured)

    def estimate(
        self, soc: Scalar, variance: Scalar, innovation_V: Scalar, innovation_V2: Any, clean: VoltageSample
    ) -> SocEstimate:
        """Estimate after a sample, from SoC and its variance, the innovation [V] and its variance [V^2]."""
        return SocEstimate(
            soc=clip(soc, 0.0, 1.0),
            soc_std=np.sqrt(maximum(variance, 0.0)),
            voltage_V=clean.voltage_V - innovation_V,
            voltage_std_V=np.sqrt(innovation_V2),
            innovation_V=where(clean.measured, innovation_V, math.nan),
            flags=flags_of({SocFlag.NO_VOLTAGE: logical_not(clean.measured)}),
        )

    def predict(self, belief: Belief, current_A: Scalar, dt_s: Scalar) -> Belief:
        """The belief after `dt_s` of a constant current."""
        decays, pairs = pair_decays(self.input(current_A), self.model, dt_s), self.pairs(belief.mean[0])
        driven = [(1 - a) * r * current_A for a, r in zip(decays, pairs, strict=True)]
        moved = charge(current_A, dt_s, self.model) * (1 / self.model.capacity_As)
        walk_V2 = [(PAIR_CURRENT_C * r * self.model.capacity_Ah) ** 2 for r in pairs]
        soc_variance = (self.sensor.noise_std_A / self.model.capacity_As) ** 2 * dt_s
        Q = np.diag(np.array([soc_variance, *walk_V2]))
        return kalman.predict(belief, np.diag(np.array([1.0, *decays])), Q, np.array([moved, *driven]))

    def correct(self, prior: Belief, y: np.ndarray, drop_V: Scalar, measured: Scalar) -> Correction:
        """The belief after the voltage y = OCV(soc) + drop + v_1 + ... + v_n; unchanged if not `measured`."""

        def curve(x: np.ndarray) -> np.ndarray:
            return np.array([self.curve_V(x[0], drop_V)])

        H = np.array([[0.0, *(1.0 for _ in prior.mean[1:])]])
        R = np.array([[self.voltage_variance]])
        if self.method == "ukf":
            return conditionally_linear.correct(prior, y, curve, H, R, used=measured)
        return extended.correct(prior, y, lambda x: curve(x) + H @ x, R, measured)

    def curve_V(self, soc: Scalar, drop_V: Scalar) -> Scalar:
        """Terminal voltage [V] without the RC voltages."""
        return self.model.ocv.mean_V(soc, self.model.reference_degC) + drop_V

    @property
    def voltage_variance(self) -> float:
        """Variance of sensor and curve together [V^2]."""
        return self.noise.voltage_std_V**2 + max(self.noise.model_std_V) ** 2

    def pairs(self, soc: Scalar) -> list[Any]:
        """R_1 ... R_n [ohm] at this SoC."""
        return pair_resistances(soc, self.input(0.0), self.model)

    def input(self, current_A: Scalar) -> CircuitInput:
        """This current at the temperature of the file."""
        return CircuitInput(current_A, self.model.reference_degC)
