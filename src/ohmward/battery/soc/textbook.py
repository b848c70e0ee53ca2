"""State of charge by the filter of the textbooks and of [P] 2.3: SoC and RC voltages, nothing else.

    x = [soc, v_1 ... v_n]        y = V

It trusts current sensor, capacity and curve, so its sigma is far too small on a real robot: it is the baseline that
`compare` shows, and what fits into 2 KB of a microcontroller. The state moves linearly once the resistances are taken
at the mean, so it is predicted by the Kalman filter exactly; only the curve asks for the extended or unscented one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import (
    CircuitInput,
    Thevenin,
    charge,
    ohmic_resistance,
    pair_decays,
    pair_resistances,
)
from ohmward.battery.soc.clean_sample import LONGEST_STEP_S, first_input, is_current, is_voltage
from ohmward.battery.soc.initial_soc import initial_soc
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.errors import InputError
from ohmward.filters import conditionally_linear, extended, kalman
from ohmward.filters.belief import Belief, Correction, PackedBelief, pack, unpack
from ohmward.trace import clip, maximum, where

METHODS = ("ekf", "ukf")

#: How far an RC voltage may be from its model after a step, as a share of R_j times 1 C.
PAIR_SHARE = 0.005


class TextbookState(NamedTuple):
    """What the filter carries.

    belief: mean (n + 1,) and lower triangle of the covariance.
    current_A: of the sample before.
    """

    belief: PackedBelief
    current_A: Any


class CleanTextbookSample(NamedTuple):
    """What a sample says.

    voltage_V: measured; 0 where it is not.
    drop_V: across the ohmic resistance.
    measured: whether there is a voltage.
    """

    voltage_V: Any
    drop_V: Any
    measured: Any


@dataclass(frozen=True)
class TextbookFilter:
    """Settings; `init`, `start` and `step` are pure functions of them. Temperature and hysteresis are not looked at.

    Attributes:
        model: the circuit, at its reference temperature.
        noise: voltage and current noise; the rest of it is what this filter does not know.
        method: "ekf" or "ukf".
    """

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    method: str = "ukf"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> TextbookState:
        """State before the first sample; a SoC that is None comes from its voltage."""
        u = first_input(first)
        return self.start(first, *initial_soc(first.voltage_V, u, self.model, self.noise, soc, soc_std))

    def start(self, first: SocSample, soc: Any, soc_std: Any) -> TextbookState:
        """State before the first sample, with a SoC that is taken as it is; traceable."""
        u = first_input(first)
        std = [soc_std, *(r * abs(u.current_A) + 1e-3 for r in self.pairs(soc))]
        mean = np.array([soc, *(0.0 for _ in std[1:])])
        return TextbookState(pack(Belief(mean, np.diag(np.square(np.array(std))))), u.current_A)

    def step(self, state: TextbookState, sample: SocSample) -> tuple[TextbookState, SocEstimate]:
        """The state after a sample, and what is known then."""
        before, reading = self.predicted(state, sample)
        prior = unpack(before.belief)
        posterior, innovation, _ = self.correct(prior, np.array([reading.voltage_V]), reading.drop_V, reading.measured)
        known = posterior.mean[0], posterior.cov[0, 0], innovation.value[0], innovation.cov[0, 0]
        return before._replace(belief=pack(posterior)), self.estimate(*known, reading)

    def predicted(self, state: TextbookState, sample: SocSample) -> tuple[TextbookState, CleanTextbookSample]:
        """The state before the voltage of a sample is used, and what the sample says."""
        dt_s = where((sample.dt_s > 0) & (sample.dt_s <= LONGEST_STEP_S), sample.dt_s, 0.0)
        current_A = where(is_current(sample.current_A, math.inf), sample.current_A, state.current_A)
        prior = self.predict(unpack(state.belief), 0.5 * (current_A + state.current_A), dt_s)
        measured = is_voltage(sample.voltage_V, self.model.ocv.voltage_V[-1])
        drop_V = ohmic_resistance(prior.mean[0], self.input(current_A), self.model) * current_A
        return TextbookState(pack(prior), current_A), CleanTextbookSample(
            where(measured, sample.voltage_V, 0.0), drop_V, measured
        )

    def estimate(
        self, soc: Any, variance: Any, innovation_V: Any, innovation_V2: Any, reading: CleanTextbookSample
    ) -> SocEstimate:
        """What is known after a sample: SoC and its variance, the innovation and its variance [V^2]."""
        unknown = math.nan
        return SocEstimate(
            clip(soc, 0.0, 1.0),
            np.sqrt(maximum(variance, 0.0)),
            reading.voltage_V - innovation_V,
            np.sqrt(innovation_V2),
            where(reading.measured, innovation_V, math.nan),
            unknown,
            unknown,
            unknown,
            where(reading.measured, 0.0, float(SocFlag.NO_VOLTAGE)),
        )

    def predict(self, belief: Belief, current_A: Any, dt_s: Any) -> Belief:
        """The belief after `dt_s` of a constant current."""
        decays, pairs = pair_decays(self.model, dt_s), self.pairs(belief.mean[0])
        driven = [(1 - a) * r * current_A for a, r in zip(decays, pairs, strict=True)]
        moved = charge(current_A, dt_s, self.model) * (1 / self.model.capacity_As)
        wandered = [(PAIR_SHARE * r * self.model.capacity_Ah) ** 2 for r in pairs]
        soc_variance = (self.noise.current_std_A / self.model.capacity_As) ** 2 * dt_s
        Q = np.diag(np.array([soc_variance, *wandered]))
        return kalman.predict(belief, np.diag(np.array([1.0, *decays])), Q, np.array([moved, *driven]))

    def correct(self, prior: Belief, y: np.ndarray, drop_V: Any, measured: Any) -> Correction:
        """The belief after the voltage y = OCV(soc) + drop + v_1 + ... + v_n; unchanged if not `measured`."""

        def curve(x: np.ndarray) -> np.ndarray:
            return np.array([self.curve_V(x[0], drop_V)])

        H, R = np.array([[0.0, *(1.0 for _ in prior.mean[1:])]]), np.array([[self.voltage_variance]])
        if self.method == "ukf":
            return conditionally_linear.correct(prior, y, curve, H, R, used=measured)
        return extended.correct(prior, y, lambda x: curve(x) + H @ x, R, measured)

    def curve_V(self, soc: Any, drop_V: Any) -> Any:
        """What the terminal voltage [V] is but for the RC voltages."""
        return self.model.ocv.mean_V(soc, self.model.reference_degC) + drop_V

    @property
    def voltage_variance(self) -> float:
        """Of sensor and curve together [V^2]."""
        return self.noise.voltage_std_V**2 + max(self.noise.model_std_V) ** 2

    def pairs(self, soc: Any) -> list[Any]:
        """R_1 ... R_n [ohm] at this SoC."""
        return pair_resistances(soc, self.input(0.0), self.model)

    def input(self, current_A: Any) -> CircuitInput:
        """This current at the temperature of the file."""
        return CircuitInput(current_A, self.model.reference_degC)
