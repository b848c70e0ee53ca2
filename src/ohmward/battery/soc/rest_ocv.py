"""Coulomb counting that is corrected by the open-circuit voltage whenever the battery has rested long enough."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, BatteryNoise
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, pair_resistances
from ohmward.battery.soc.clean_sample import CURRENT_GAP_S, Rest, continue_rest, is_current, is_voltage
from ohmward.battery.soc.coulomb import CoulombCounting, CoulombState
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.checks import require_each_positive
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.trace import clip, linearize, where
from ohmward.trace.expression import Scalar

#: Overpotential that is left when a rest has settled, as the current through the pairs that would hold it, in multiples
#: of the capacity per hour: after `settle_s` the pairs of the model have relaxed, the diffusion that it lacks has not.
REST_CURRENT_C = 0.05


class RestOcvState(NamedTuple):
    """Coulomb counting, and the rest that the battery may be in."""

    counting: CoulombState
    rest: Rest


class OcvUpdate(NamedTuple):
    """Coulomb counting started anew from the voltage of a rest, a scalar Kalman update."""

    counting: CoulombState  #: after it
    #: open-circuit voltage expected before it, and the standard deviation of the innovation
    voltage_V: Scalar
    voltage_std_V: Scalar


@dataclass(frozen=True)
class RestOcv:
    """Settings.

    Attributes:
        model, noise, sensor, gap_s: as for coulomb counting.
        rest_share: current below this share of 1 C, and three sigma of its noise, counts as rest.
        settle_s: length of a rest before its voltage is used.
    """

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)
    gap_s: float = CURRENT_GAP_S
    rest_share: float = 0.03
    settle_s: float = 900.0

    def __post_init__(self) -> None:
        require_each_positive("", self, "gap_s", "rest_share")

    @property
    def counting(self) -> CoulombCounting:
        """Estimator between the rests."""
        return CoulombCounting(self.model, self.noise, self.sensor, self.gap_s)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> RestOcvState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return self.counting.voltage_start

    def start_from(self, first: SocSample, part: Hypothesis) -> RestOcvState:
        """State before the first sample with this density of SoC; traceable."""
        return RestOcvState(self.counting.start_from(first, part), Rest())

    def step(self, state: RestOcvState, sample: SocSample) -> tuple[RestOcvState, SocEstimate]:
        """State and estimate after a sample."""
        counting, counted = self.counting.step(state.counting, sample)
        resting = is_current(sample.current_A, self.sensor.rest_threshold_A(self.model.capacity_Ah, self.rest_share))
        measured = is_voltage(sample.voltage_V, self.model.ocv.voltage_V[-1])
        dt_s = counting.elapsed_s - state.counting.elapsed_s
        rest, due = continue_rest(state.rest, resting, dt_s, self.settle_s, measured)
        y = where(measured, sample.voltage_V, 0.0)
        update = self.correct(counting, counted.soc_std, y)
        after = choose(due, update.counting, counting)
        estimate = self.counting.estimate(after, counted.flags + flags_of({SocFlag.REST: due}))
        return RestOcvState(after, rest), estimate._replace(
            voltage_V=update.voltage_V,
            voltage_std_V=update.voltage_std_V,
            innovation_V=where(due, y - update.voltage_V, math.nan),
        )

    def correct(self, state: CoulombState, soc_std: Scalar, voltage_V: Scalar) -> OcvUpdate:
        """Coulomb counting started anew from this voltage of a rest; soc_std: of the SoC so far."""
        noise, p = self.noise, self.model
        soc = np.array([state.soc])
        ocv_V, slope = linearize(lambda s: np.array([p.ocv.mean_V(s[0], state.temperature_degC)]), soc)
        H = slope[0, 0]
        hysteresis_V = p.hysteresis_V_at(state.soc, state.temperature_degC)
        pairs = pair_resistances(state.soc, CircuitInput(0.0, state.temperature_degC), p)
        past_V = sum(pairs) * REST_CURRENT_C * p.capacity_Ah
        R = noise.voltage_std_V**2 + max(noise.model_std_V) ** 2 + (noise.soc_axis_std * H) ** 2
        R = R + (HYSTERESIS_UNKNOWN_STD * hysteresis_V) ** 2 + past_V**2
        P = soc_std * soc_std
        S = H * H * P + R
        K = P * H / S
        corrected = clip(state.soc + K * (voltage_V - ocv_V[0]), 0.0, 1.0)
        restarted = state._replace(soc=corrected, white_variance=P * (R / S), moved=0.0 * P, elapsed_s=0.0 * P)
        return OcvUpdate(restarted, ocv_V[0], np.sqrt(S))
