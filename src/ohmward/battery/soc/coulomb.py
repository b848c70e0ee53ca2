"""Coulomb counting: the baseline. Its sigma grows by offset, gain error and noise of the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import PATH_SHARE, SOC_UNKNOWN_STD, USUAL_C, BatteryNoise
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, charge
from ohmward.battery.soc.clean_sample import (
    CURRENT_GAP_S,
    CleanSocSample,
    SampleLimits,
    first_input,
    sample_limits,
    sanitize,
)
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.checks import require_positive
from ohmward.filters.flags import flags_of
from ohmward.trace import clip, minimum, where
from ohmward.trace.expression import Scalar


class CoulombState(NamedTuple):
    """State of coulomb counting."""

    soc: Any  #: state of charge
    white_variance: Any  #: variance of the errors that accumulate at random: start, sensor noise, gaps
    moved: Any  #: net change of SoC since the start; a gain error multiplies it
    elapsed_s: Any  #: time since the start; an offset multiplies it
    #: last credible ones
    current_A: Any
    temperature_degC: Any
    unknown_s: Any  #: time for which the current has not been known


@dataclass(frozen=True)
class CoulombCounting:
    """Settings; the voltage is looked at once, to find or check the initial SoC."""

    model: Thevenin  #: gives capacity and coulombic efficiency, and the OCV for the start
    #: of the model; its capacity, and its voltage for the start
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: of the current
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between

    def __post_init__(self) -> None:
        require_positive("gap_s", self.gap_s)

    @property
    def limits(self) -> SampleLimits:
        """Limits of what is believed of a sample."""
        return sample_limits(self.model, self.gap_s)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = 0.03) -> CoulombState:
        """State before the first sample; `soc` None takes it from the first voltage."""
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return VoltageStart(self.model, self.noise, self.sensor, self.limits.current_A)

    def start_from(self, first: SocSample, part: Hypothesis) -> CoulombState:
        """State before the first sample with this density of SoC; traceable."""
        u, start = first_input(first, self.limits.current_A), part.start
        return CoulombState(start.soc, start.std**2, 0.0, 0.0, u.current_A, u.temperature_degC, 0.0)

    def step(self, state: CoulombState, sample: SocSample) -> tuple[CoulombState, SocEstimate]:
        """State and estimate after a sample."""
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(sample, before, self.limits, state.unknown_s)
        d_soc = charge(clean.mean.current_A, clean.dt_s, self.model) / self.model.capacity_As
        soc = clip(state.soc + d_soc, 0.0, 1.0)
        after = CoulombState(
            soc,
            state.white_variance + charge_variance(clean, self.sensor, self.model),
            state.moved + d_soc,
            state.elapsed_s + clean.dt_s,
            clean.now.current_A,
            clean.now.temperature_degC,
            clean.unknown_s,
        )
        limited = flags_of({SocFlag.SOC_LIMITED: state.soc + d_soc != soc})
        return after, self.estimate(after, clean.flags + limited)

    def estimate(self, state: CoulombState, flags: Scalar) -> SocEstimate:
        """Estimate in a state; flags: sum of `SocFlag`."""
        offset = self.sensor.offset_std_A * state.elapsed_s / self.model.capacity_As
        gain = np.hypot(self.noise.capacity_std, self.sensor.gain_std) * state.moved
        std = np.sqrt(state.white_variance + offset**2 + gain**2)
        unknown = SocEstimate(*[math.nan * state.soc] * len(SocEstimate._fields))
        return unknown._replace(soc=state.soc, soc_std=std, flags=flags)


def charge_variance(clean: CleanSocSample, sensor: CurrentSensor, model: Thevenin) -> Scalar:
    """Variance of the change of SoC in one step: sensor noise, the path between two samples (`PATH_SHARE`), a gap.

    An unknown current is a usual one, `USUAL_C`, in either direction, and the same one until it is known again: its
    variance grows with the square of the time, whether that is one long step or many short ones.
    """
    sensor_As2 = sensor.noise_std_A**2 * clean.dt_s
    path_As2 = (PATH_SHARE * clean.change_A * clean.dt_s) ** 2
    known = minimum((sensor_As2 + path_As2) / model.capacity_As**2, SOC_UNKNOWN_STD**2)
    unknown = growth_while_unknown(lambda t_s: minimum(USUAL_C * t_s / 3600.0, SOC_UNKNOWN_STD) ** 2, clean)
    return where(clean.current_known, known, unknown)


def growth_while_unknown(variance: Callable[[Any], Any], clean: CleanSocSample) -> Scalar:
    """Growth in this step of a variance that is `variance(t)` after a time t [s] without a known current; else 0."""
    growth = variance(clean.unknown_s) - variance(clean.unknown_s - clean.dt_s)
    return where(clean.current_known, 0.0, growth)
