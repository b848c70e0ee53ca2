"""The Thevenin model whose noise is what the battery file says times factors, so that logs can tell the factors.

The estimators count an error that holds on for a correlation time as one observation in that time (R times a weight).
That is no density of the samples. Here the same error is a state,

    V = h(x) + c s e + v,    e' = a e + sqrt(1 - a^2) w,    a = exp(-dt / (c_t tau)),    v ~ N(0, (c_v v_0)^2)

with v_0, s and tau the file's `voltage_std_V`, what its `overpotential_share` and `soc_axis_std` make of this state,
and `correlation_s`; the state `model_error` is times c too. What the cold, age and temperature add to s is no part of
the file's noise, and stays; what the tangent of the curve leaves out is no noise either, and only its mean is
expected. The innovations of an extended Kalman filter on it are white where the factors are right,
and their density is the likelihood of the factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.augmented_thevenin import SOC, AugmentedThevenin
from ohmward.battery.soc.clean_sample import CleanSocSample, sanitize
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.soc.thevenin_filter import TheveninFilter
from ohmward.filters import extended
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import choose
from ohmward.trace import exp, log, maximum, sqrt, where
from ohmward.trace.expression import Scalar

#: Names of the factors, in order.
FACTORS = ("voltage", "model", "correlation")


class TuningState(NamedTuple):
    """State between two samples."""

    belief: PackedBelief  #: of the states of `AugmentedThevenin`, and e
    log_factors: np.ndarray  #: (3,) ln of c_v, c and c_t; they stay
    #: as in `thevenin_filter.FilterState`
    current_A: Scalar
    temperature_degC: Scalar
    unknown_s: Scalar


class ScoredSample(NamedTuple):
    """Score of a sample for given factors."""

    log_density: Any  #: of its voltage before it was used; 0 where there was none
    innovation: Any  #: in its own standard deviations; nan where there was none
    innovation_V: Any  #: the same in volts
    soc: Any  #: state of charge after it


def with_factors(noise: BatteryNoise, factors: np.ndarray) -> BatteryNoise:
    """The noise of a battery file times `FACTORS` (3,)."""
    voltage, model, correlation = map(float, factors)
    share = noise.overpotential_share
    return replace(
        noise,
        voltage_std_V=voltage * noise.voltage_std_V,
        model_std_V=tuple(model * std for std in noise.model_std_V),
        overpotential_share=tuple(model * s for s in share) if isinstance(share, tuple) else model * share,
        soc_axis_std=model * noise.soc_axis_std,
        correlation_s=correlation * noise.correlation_s,
    )


@dataclass(frozen=True)
class NoiseModel:
    """Settings: a battery file; `init` and `step` are pure functions of them."""

    battery: Battery

    @cached_property
    def filter(self) -> TheveninFilter:
        """The filter of the battery file, for its start, its limits and its gate."""
        return TheveninFilter(require_thevenin(self.battery), self.battery.noise, self.battery.sensor)

    @property
    def system(self) -> AugmentedThevenin:
        """The model functions with the file's noise."""
        return self.filter.system

    @cached_property
    def unscaled(self) -> AugmentedThevenin:
        """The model functions with those errors of the voltage alone that no factor scales."""
        return replace(self.system, noise=with_factors(self.battery.noise, np.array([1.0, 0.0, 1.0])))

    def init(self, first: SocSample, log_factors: np.ndarray, soc: float | None = None) -> TuningState:
        """State before the first sample; soc: None takes it from the first voltage, which is looked at."""
        noise = with_factors(self.battery.noise, np.exp(log_factors))
        start = TheveninFilter(self.filter.model, noise, self.battery.sensor).init(first, soc)
        inner = unpack(start.belief)
        n = len(inner.mean)
        mean, cov = np.zeros(n + 1), np.zeros((n + 1, n + 1))
        mean[:n], cov[:n, :n], cov[n, n] = inner.mean, inner.cov, 1.0
        return TuningState(pack(Belief(mean, cov)), log_factors, start.current_A, start.temperature_degC, 0.0)

    def step(self, state: TuningState, sample: SocSample) -> tuple[TuningState, ScoredSample]:
        """State after a sample, and what it says of the factors."""
        before = CircuitInput(state.current_A, state.temperature_degC)
        clean = sanitize(sample, before, self.filter.limits, state.unknown_s)
        prior = self.predict(unpack(state.belief), clean, exp(state.log_factors[2]))
        corrected, scored = self.correct(prior, clean, exp(state.log_factors[0]), exp(state.log_factors[1]))
        within, _ = self.filter.within_limits(corrected)
        after = TuningState(
            pack(within), state.log_factors, clean.now.current_A, clean.now.temperature_degC, clean.unknown_s
        )
        return after, scored._replace(soc=within.mean[SOC])

    def predict(self, belief: Belief, clean: CleanSocSample, longer: Scalar) -> Belief:
        """The belief before the voltage; longer: c_t."""
        decay = exp(-clean.dt_s / (maximum(self.battery.noise.correlation_s, 1e-3) * longer))
        n = len(belief.mean) - 1
        Q = np.zeros((n + 1, n + 1), dtype=object)
        Q[:n, :n] = self.system.process_noise(belief.mean[:n], clean)
        Q[n, n] = 1.0 - decay * decay
        return extended.predict(belief, lambda x: np.array([*self.system.next_state(x[:n], clean), decay * x[n]]), Q)

    def correct(
        self, prior: Belief, clean: CleanSocSample, noisier: Scalar, wronger: Scalar
    ) -> tuple[Belief, ScoredSample]:
        """The belief after the voltage where current and voltage were measured; noisier, wronger: c_v, c."""
        n = len(prior.mean) - 1
        inner = Belief(prior.mean[:n], prior.cov[:n, :n])
        error, unscaled = (system.voltage_error(inner, clean) for system in (self.system, self.unscaled))
        white = self.battery.noise.voltage_std_V
        stays_V2, all_V2 = unscaled.model_std_V**2, error.model_std_V**2
        scaled = error._replace(model_std_V=sqrt(stays_V2 + wronger**2 * (all_V2 - stays_V2)))
        held_V2 = unscaled.uncertain_V2 + wronger**2 * (error.uncertain_V2 - unscaled.uncertain_V2)

        def measured(x: np.ndarray) -> np.ndarray:
            return self.system.voltage(x[:n], clean, scaled) + sqrt(held_V2) * x[n]

        drawn_V2 = error.variance - error.uncertain_V2 - error.tangent_V2
        R = np.array([[(noisier**2 - 1.0) * white**2 + drawn_V2]])
        correction = extended.correct(prior, np.array([clean.voltage_V]), measured, R)
        nu, S = correction.innovation.value[0], correction.innovation.cov[0, 0]
        there = clean.voltage_measured & clean.current_measured
        density = -0.5 * (nu * nu / S + log(S))
        corrected = choose(there, correction.belief, prior)
        innovation, innovation_V = where(there, nu / sqrt(S), np.nan), where(there, nu, np.nan)
        return corrected, ScoredSample(where(there, density, 0.0), innovation, innovation_V, corrected.mean[SOC])
