"""Coulomb counting: the baseline. Its sigma grows with what the sensor may hide: offset, gain, noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import Thevenin, charge
from ohmward.battery.soc.clean_sample import CleanSocSample, first_input, is_voltage, sanitize
from ohmward.battery.soc.initial_soc import initial_soc
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.checks import require_positive
from ohmward.trace import clip, minimum, where

#: A usual current, in multiples of the capacity per hour: what an unknown one is taken to be.
USUAL_C = 0.3

#: Standard deviation of a SoC of which nothing is known: an unknown current makes it no worse.
SPREAD = 0.5


class CoulombState(NamedTuple):
    """What coulomb counting carries.

    soc: state of charge.
    white_variance: of what accumulates at random: start, sensor noise, gaps.
    moved: net change of SoC since the start; a gain error multiplies it.
    elapsed_s: time since the start; an offset multiplies it.
    current_A, temperature_degC: last credible ones.
    unknown_s: how long the current has not been known.
    """

    soc: Any
    white_variance: Any
    moved: Any
    elapsed_s: Any
    current_A: Any
    temperature_degC: Any
    unknown_s: Any


@dataclass(frozen=True)
class CoulombCounting:
    """Settings; the voltage is looked at once, to find or check the initial SoC.

    Attributes:
        model: gives capacity and coulombic efficiency, and the OCV for the start.
        noise: of the current sensor.
        gap_s: a longer step between two samples says nothing about the current in between.
        current_limit_C: a larger current, in multiples of the capacity per hour, is a fault of its sensor.
    """

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    gap_s: float = 600.0
    current_limit_C: float = 20.0

    def __post_init__(self) -> None:
        require_positive("gap_s", self.gap_s)
        require_positive("current_limit_C", self.current_limit_C)

    @property
    def current_limit_A(self) -> float:
        """Largest current [A] that is believed."""
        return self.current_limit_C * self.model.capacity_Ah

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> CoulombState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        u = first_input(first, self.current_limit_A)
        start = initial_soc(first.voltage_V, u, self.model, self.noise, soc, soc_std)
        return CoulombState(start.soc, start.std**2, 0.0, 0.0, u.current_A, u.temperature_degC, 0.0)

    def step(self, state: CoulombState, sample: SocSample) -> tuple[CoulombState, SocEstimate]:
        """The state after a sample, and what is known then."""
        reading = self.sanitize(state, sample)
        d_soc = charge(reading.mean.current_A, reading.dt_s, self.model) / self.model.capacity_As
        soc = clip(state.soc + d_soc, 0.0, 1.0)
        after = CoulombState(
            soc,
            state.white_variance + charge_variance(reading, self.noise, self.model),
            state.moved + d_soc,
            state.elapsed_s + reading.dt_s,
            reading.now.current_A,
            reading.now.temperature_degC,
            reading.unknown_s,
        )
        limited = where(state.soc + d_soc == soc, 0.0, float(SocFlag.SOC_LIMITED))
        credible = is_voltage(sample.voltage_V, self.model.ocv.voltage_V[-1])
        no_voltage = where(credible, 0.0, float(SocFlag.NO_VOLTAGE))
        return after, self.estimate(after, reading.flags + no_voltage + limited)

    def sanitize(self, state: CoulombState, sample: SocSample) -> CleanSocSample:
        """The sample made safe."""
        before = state.current_A, state.temperature_degC
        return sanitize(sample, *before, self.gap_s, self.current_limit_A, state.unknown_s)

    def estimate(self, state: CoulombState, flags: Any) -> SocEstimate:
        """SoC and the sum of what may be wrong with it."""
        offset = self.noise.current_offset_std_A * state.elapsed_s / self.model.capacity_As
        gain = self.noise.capacity_std * state.moved
        std = np.sqrt(state.white_variance + offset**2 + gain**2)
        unknown = math.nan * state.soc
        return SocEstimate(state.soc, std, unknown, unknown, unknown, unknown, unknown, unknown, flags)


def charge_variance(reading: CleanSocSample, noise: BatteryNoise, model: Thevenin) -> Any:
    """Variance of the change of SoC in one step: sensor noise, the path between two samples, a gap.

    The path: between two samples the current is taken as linear; 0.15 of the step in current is how far its mean may
    be from that. An unknown current is a usual one, `USUAL_C`, in either direction, and the same one until it is known
    again: its variance grows with the square of the time, whether that is one long step or many short ones.
    """
    sensor = noise.current_std_A**2 * reading.dt_s
    path = (0.15 * reading.change_A * reading.dt_s) ** 2
    unknown = grown(lambda t: minimum(USUAL_C * t / 3600.0, SPREAD) ** 2, reading)
    known = minimum((sensor + path) / model.capacity_As**2, SPREAD**2)
    return where(reading.known > 0.5, known, unknown)


def grown(variance: Callable[[Any], Any], reading: CleanSocSample) -> Any:
    """By how much a variance grew in this step that is `variance(t)` after a time t [s] without a known current."""
    growth = variance(reading.unknown_s) - variance(reading.unknown_s - reading.dt_s)
    return where(reading.known > 0.5, 0.0, growth)
