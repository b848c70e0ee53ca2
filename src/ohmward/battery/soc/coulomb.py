"""Coulomb counting: the baseline, alone or corrected by the open-circuit voltage after every rest that is long enough.

Its sigma grows by offset, gain error and noise of the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import (
    HYSTERESIS_UNKNOWN_STD,
    SOC_UNKNOWN_STD,
    USUAL_C,
    BatteryNoise,
    CurrentSensor,
    path_std_A,
)
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, charge, pair_resistances
from ohmward.battery.soc.clean_sample import (
    CURRENT_GAP_S,
    CleanSocSample,
    Rest,
    SampleLimits,
    continue_rest,
    first_input,
    is_current,
    sample_limits,
    sanitize,
)
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.checks import require_each_positive, require_positive
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Scalar, clip, linearize, minimum, where


class CoulombState(NamedTuple):
    """State of coulomb counting."""

    soc: Any  #: state of charge
    white_variance: Any  #: variance of the errors that accumulate at random: start, sensor noise, gaps
    moved: Any  #: net change of SoC since the start; a gain error multiplies it
    elapsed_s: Any  #: time since the start; an offset multiplies it
    current_A: Any  #: last credible current
    temperature_degC: Any  #: last credible temperature
    unknown_s: Any  #: time for which the current has not been known


@dataclass(frozen=True)
class CoulombCounting:
    """Settings; the voltage is used once, to find or check the initial SoC."""

    model: Thevenin  #: gives capacity and coulombic efficiency, and the OCV for the start
    #: errors of the model: of its capacity, and of its voltage for the start
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: current sensor
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between

    def __post_init__(self) -> None:
        require_positive("gap_s", self.gap_s)

    @property
    def limits(self) -> SampleLimits:
        """Plausibility limits of a sample."""
        return sample_limits(self.model, self.gap_s)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> CoulombState:
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
        return SocEstimate(state.soc, std, flags=flags)


def charge_variance(clean: CleanSocSample, sensor: CurrentSensor, model: Thevenin) -> Scalar:
    """Variance of the change of SoC in one step: sensor noise, the path between two samples (`path_std_A`), a gap.

    An unknown current is assumed to be a usual one, `USUAL_C`, in either direction, and constant until it is known
    again: the variance grows with the square of the time, whether in one long step or in many short ones.
    """
    sensor_As2 = sensor.noise_std_A**2 * clean.dt_s
    path_As2 = (path_std_A(clean.change_A, clean.dt_s) * clean.dt_s) ** 2
    known = minimum((sensor_As2 + path_As2) / model.capacity_As**2, SOC_UNKNOWN_STD**2)
    unknown = growth_while_unknown(lambda t_s: minimum(USUAL_C * t_s / SECONDS_PER_HOUR, SOC_UNKNOWN_STD) ** 2, clean)
    return where(clean.current_known, known, unknown)


def growth_while_unknown(variance: Callable[[Any], Any], clean: CleanSocSample) -> Scalar:
    """Growth in this step of a variance that is `variance(t)` after a time t [s] without a known current; else 0."""
    growth = variance(clean.unknown_s) - variance(clean.unknown_s - clean.dt_s)
    return where(clean.current_known, 0.0, growth)


#: Overpotential that remains after a rest has settled, as the current through the RC pairs that would cause it, in
#: multiples of the capacity per hour: after `settle_s` the pairs have relaxed, but diffusion, not modelled, has not.
REST_CURRENT_C = 0.05


class RestOcvState(NamedTuple):
    """State of coulomb counting, and the present rest, if any."""

    counting: CoulombState
    rest: Rest


@dataclass(frozen=True)
class RestOcv:
    """Settings; the first four are those of coulomb counting."""

    model: Thevenin
    noise: BatteryNoise = field(default_factory=BatteryNoise)
    sensor: CurrentSensor = field(default_factory=CurrentSensor)
    gap_s: float = CURRENT_GAP_S
    rest_share: float = 0.03  #: current below this share of 1 C plus three sigma of its noise counts as rest
    settle_s: float = 900.0  #: length of a rest before its voltage is used

    def __post_init__(self) -> None:
        require_each_positive("", self, "gap_s", "rest_share", "settle_s")

    @property
    def counting(self) -> CoulombCounting:
        """Estimator between the rests."""
        return CoulombCounting(self.model, self.noise, self.sensor, self.gap_s)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> RestOcvState:
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
        measured = self.counting.limits.is_voltage(sample.voltage_V)
        dt_s = counting.elapsed_s - state.counting.elapsed_s
        rest, due = continue_rest(state.rest, resting, dt_s, self.settle_s, measured)
        y = where(measured, sample.voltage_V, 0.0)
        restarted, voltage_V, voltage_std_V = self.correct(counting, counted.soc_std, y)
        after = choose(due, restarted, counting)
        estimate = self.counting.estimate(after, counted.flags + flags_of({SocFlag.REST: due}))
        return RestOcvState(after, rest), estimate._replace(
            voltage_V=voltage_V,
            voltage_std_V=voltage_std_V,
            innovation_V=where(due, y - voltage_V, math.nan),
        )

    def correct(self, state: CoulombState, soc_std: Scalar, voltage_V: Scalar) -> tuple[CoulombState, Scalar, Scalar]:
        """Coulomb counting restarted from the voltage of a rest by a scalar Kalman update.

        soc_std: of the SoC so far.
        Returns: also the open-circuit voltage expected before it, and the standard deviation of the innovation [V].
        """
        noise, p = self.noise, self.model
        soc = np.array([state.soc])
        ocv_V, slope = linearize(lambda s: np.array([p.ocv.mean_V(s[0], state.temperature_degC)]), soc)
        H = slope[0, 0]
        hysteresis_V = p.hysteresis_V_at(state.soc, state.temperature_degC)
        pairs = pair_resistances(state.soc, CircuitInput(0.0, state.temperature_degC), p)
        past_V = sum(pairs) * REST_CURRENT_C * p.capacity_Ah
        R = noise.voltage_std_V**2 + max(noise.model_std_V) ** 2 + (noise.axis_std_at(state.soc) * H) ** 2
        R = R + (HYSTERESIS_UNKNOWN_STD * hysteresis_V) ** 2 + past_V**2
        P = soc_std * soc_std
        S = H * H * P + R
        K = P * H / S
        corrected = clip(state.soc + K * (voltage_V - ocv_V[0]), 0.0, 1.0)
        restarted = state._replace(soc=corrected, white_variance=P * (R / S), moved=0.0 * P, elapsed_s=0.0 * P)
        return restarted, ocv_V[0], np.sqrt(S)
