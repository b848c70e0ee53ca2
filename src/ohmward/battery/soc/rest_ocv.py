"""Coulomb counting that is corrected by the open-circuit voltage whenever the battery has rested long enough."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, pair_resistances
from ohmward.battery.soc.clean_sample import Rest, is_current, is_voltage, rested
from ohmward.battery.soc.coulomb import CoulombCounting, CoulombState
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.checks import require_positive
from ohmward.trace import clip, linearize, where


class RestOcvState(NamedTuple):
    """Coulomb counting, and the rest that the battery may be in."""

    counting: CoulombState
    rest: Rest


@dataclass(frozen=True)
class RestOcv:
    """Settings.

    Attributes:
        model, noise, gap_s, current_limit_C: as for coulomb counting.
        rest_share: current below this share of 1 C, and three sigma of its noise, counts as rest.
        settle_s: length of a rest before its voltage is used.
    """

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    gap_s: float = 600.0
    rest_share: float = 0.03
    settle_s: float = 900.0
    current_limit_C: float = 20.0

    def __post_init__(self) -> None:
        require_positive("gap_s", self.gap_s)
        require_positive("current_limit_C", self.current_limit_C)
        require_positive("rest_share", self.rest_share)

    @property
    def counting(self) -> CoulombCounting:
        """What runs between the rests."""
        return CoulombCounting(self.model, self.noise, self.gap_s, self.current_limit_C)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> RestOcvState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        return RestOcvState(self.counting.init(first, soc, soc_std), Rest())

    def step(self, state: RestOcvState, sample: SocSample) -> tuple[RestOcvState, SocEstimate]:
        """The state after a sample, and what is known then."""
        counting, counted = self.counting.step(state.counting, sample)
        quiet = is_current(sample.current_A, self.noise.rest_threshold_A(self.model.capacity_Ah, self.rest_share))
        dt_s = counting.elapsed_s - state.counting.elapsed_s
        measured = is_voltage(sample.voltage_V, self.model.ocv.voltage_V[-1])
        rest, due = rested(state.rest, quiet, dt_s, self.settle_s, measured)
        y = where(measured, sample.voltage_V, 0.0)
        corrected, voltage, voltage_std = self.corrected(counting, counted.soc_std, y)
        after = CoulombState(*(where(due, new, old) for new, old in zip(corrected, counting, strict=True)))
        estimate = self.counting.estimate(after, counted.flags + where(due, float(SocFlag.REST), 0.0))
        innovation = where(due, y - voltage, math.nan)
        estimate = estimate._replace(voltage_V=voltage, voltage_std_V=voltage_std, innovation_V=innovation)
        return RestOcvState(after, rest), estimate

    def corrected(self, state: CoulombState, soc_std: Any, voltage_V: Any) -> tuple[CoulombState, Any, Any]:
        """Coulomb counting started anew from this rest's voltage (a scalar Kalman update), OCV and its std [V]."""
        noise, T = self.noise, state.temperature_degC
        ocv, slope = linearize(lambda s: np.array([self.model.ocv.mean_V(s[0], T)]), np.array([state.soc]))
        gap = self.model.ocv.hysteresis_at(state.soc)
        left = sum(pair_resistances(state.soc, CircuitInput(0.0, T), self.model)) * 0.05 * self.model.capacity_Ah
        R = noise.voltage_std_V**2 + max(noise.model_std_V) ** 2 + (noise.soc_axis_std * slope[0, 0]) ** 2
        R = R + (0.7 * gap) ** 2 + left**2
        P = soc_std * soc_std
        S = slope[0, 0] * slope[0, 0] * P + R
        K = P * slope[0, 0] / S
        soc = clip(state.soc + K * (voltage_V - ocv[0]), 0.0, 1.0)
        anew = state._replace(soc=soc, white_variance=P * (R / S), moved=0.0 * P, elapsed_s=0.0 * P)
        return anew, ocv[0], np.sqrt(S)
