"""Coulomb counting: the baseline. Its sigma grows with what the sensor may hide: offset, gain, noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.estimate import Estimate, Flag, Sample
from ohmward.battery.initial_soc import initial_soc
from ohmward.battery.noise import Noise
from ohmward.battery.reading import ROOM_DEGC, Reading, finite_or, read
from ohmward.battery.thevenin import Input, Thevenin, charge
from ohmward.trace import clip, isfinite, where


class CoulombState(NamedTuple):
    """What coulomb counting carries.

    soc: state of charge.
    white_variance: of what accumulates at random: start, sensor noise, gaps.
    moved: net change of SoC since the start; a gain error multiplies it.
    elapsed_s: time since the start; an offset multiplies it.
    current_A, temperature_degC: last finite ones.
    """

    soc: Any
    white_variance: Any
    moved: Any
    elapsed_s: Any
    current_A: Any
    temperature_degC: Any


@dataclass(frozen=True)
class CoulombCounting:
    """Settings; the voltage is looked at once, to find or check the initial SoC.

    Attributes:
        model: gives capacity and coulombic efficiency, and the OCV for the start.
        noise: of the current sensor.
        gap_s: a longer step between two samples says nothing about the current in between.
    """

    model: Thevenin
    noise: Noise = field(default_factory=Noise)
    gap_s: float = 600.0

    def init(self, first: Sample, soc: float | None = None, soc_std: float = 0.03) -> CoulombState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        u = Input(finite_or(first.current_A, 0.0), finite_or(first.temperature_degC, ROOM_DEGC))
        start = initial_soc(first.voltage_V, u, self.model, self.noise, soc, soc_std)
        return CoulombState(start.soc, start.std**2, 0.0, 0.0, u.current_A, u.temperature_degC)

    def step(self, state: CoulombState, sample: Sample) -> tuple[CoulombState, Estimate]:
        """The state after a sample, and what is known then."""
        reading = read(sample, state.current_A, state.temperature_degC, self.gap_s)
        d_soc = charge(reading.mean.current_A, reading.dt_s, self.model) / self.model.capacity_As
        soc = clip(state.soc + d_soc, 0.0, 1.0)
        after = CoulombState(
            soc,
            state.white_variance + charge_variance(reading, self.noise, self.model),
            state.moved + d_soc,
            state.elapsed_s + reading.dt_s,
            reading.now.current_A,
            reading.now.temperature_degC,
        )
        limited = where(state.soc + d_soc == soc, 0.0, float(Flag.SOC_LIMITED))
        no_voltage = where(isfinite(sample.voltage_V), 0.0, float(Flag.NO_VOLTAGE))
        return after, self.estimate(after, reading.flags + no_voltage + limited)

    def estimate(self, state: CoulombState, flags: Any) -> Estimate:
        """SoC and the sum of what may be wrong with it."""
        offset = self.noise.current_offset_std_A * state.elapsed_s / self.model.capacity_As
        gain = self.noise.capacity_std * state.moved
        std = np.sqrt(state.white_variance + offset**2 + gain**2)
        unknown = math.nan * state.soc
        return Estimate(state.soc, std, unknown, unknown, unknown, unknown, unknown, unknown, flags)


def charge_variance(reading: Reading, noise: Noise, model: Thevenin) -> Any:
    """Variance of the change of SoC in one step: sensor noise, the path between two samples, a gap.

    The path: between two samples the current is taken as linear; 0.15 of the step in current is how far its mean may
    be from that. A gap: nothing is known but that 0.3 C is a usual current.
    """
    sensor = noise.current_std_A**2 * reading.dt_s
    path = (0.15 * reading.change_A * reading.dt_s) ** 2
    unknown = where(reading.known > 0.5, 0.0, (0.3 * model.capacity_Ah * reading.dt_s) ** 2)
    return clip((sensor + path + unknown) / model.capacity_As**2, 0.0, 0.25)
