"""Noise of a battery file by maximum likelihood on logs of which nobody knows the true state of charge."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.models.noise import BatteryNoise
from ohmward.battery.tuning.noise_model import FACTORS, NoiseModel, with_factors
from ohmward.battery.tuning.search import WIDEST, Likelihood, Maximum, Progress, maximum
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.logs.log import Log

#: Fewer voltages tell nothing.
LEAST_VOLTAGES = 1000
#: A 95 % interval wider than this factor to either side tells nothing.
WIDEST_INTERVAL = 3.0
#: Least change of SoC that tells errors which come with current and charge.
LEAST_SWEEP = 0.05
#: Points along SoC, and how far from a state of charge the logs tell the error of the model.
_GRID, _MARGIN = 21, 0.03
#: Root mean square of the innovations over what they should be, within which the noise explains the log.
_MOST_TUNED_EXCESS = 1.5
#: Root mean square of the innovations over that of the steps of the voltage, above which the last voltage would have
#: told the next one better than the battery file.
_MOST_OVER_LAST = 1.0


class TunedFactor(NamedTuple):
    """A factor of the file's noise."""

    quantity: str  #: one of `FACTORS`
    #: most likely, and its 95 % interval; nan where there is none
    factor: float
    low: float
    high: float
    refused: str = ""  #: the reason for which the file keeps its own; "" where the factor is taken


class Tuning(NamedTuple):
    """Result of `tune_noise`."""

    battery: Battery  #: with the noise that was told
    factors: tuple[TunedFactor, ...]  #: of the noise
    voltages: int  #: number of voltages
    #: root mean square of the innovations of the noise model over what they should be, with the file's noise and with
    #: the tuned
    excess_before: float
    excess: float
    over_last: float  #: root mean square of the innovations over that of the steps from one voltage to the next
    gain: float  #: of ln of the likelihood
    #: of each log, (T, 2) in their standard deviations with the file's noise and with the tuned; nan where there was no
    #: voltage
    innovations: tuple[np.ndarray, ...]

    @property
    def explains(self) -> bool:
        """True where no innovations are too large for this noise, and the file tells more than the last voltage."""
        return self.excess < _MOST_TUNED_EXCESS and self.over_last < _MOST_OVER_LAST


def tune_noise(
    battery: Battery,
    logs: Sequence[Log],
    initial_soc: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """The battery with the noise that is most likely on these logs; see `noise_model` for the likelihood.

    battery: with a Thevenin model.
    logs: drives, charges and rests of this battery, without a truth; they count together.
    initial_soc: state of charge at the start of logs by their names, where it is known.
    progress: called with (populations of factors done, all).

    Raises:
        InputError: no logs, too few voltages, or a battery file without a Thevenin model.
    """
    require_thevenin(battery)
    likelihood = Likelihood(NoiseModel(battery), logs, initial_soc or {})
    scored_before = [likelihood.scored(log, np.zeros((1, len(FACTORS)))) for log in logs]
    voltages = sum(int(np.isfinite(one.innovation).sum()) for one in scored_before)
    if voltages < LEAST_VOLTAGES:
        raise InputError(
            f"only {voltages} samples of the logs have a current and a voltage that this battery can have, at least "
            f"{LEAST_VOLTAGES} are needed: give longer logs, or the battery file of this battery"
        )
    found = maximum(likelihood, progress)
    factors = tuple(_judged(k, found, battery, logs) for k in range(len(FACTORS)))
    log_factors = np.array([0.0 if one.refused else math.log(one.factor) for one in factors])
    scored = [likelihood.scored(log, log_factors[None]) for log in logs]
    before, after = (sum(float(one.log_density.sum()) for one in of) for of in (scored_before, scored))
    innovations = tuple(np.hstack([a.innovation, b.innovation]) for a, b in zip(scored_before, scored, strict=True))
    excess_before, excess = np.sqrt(np.nanmean(np.concatenate(innovations) ** 2, axis=0))
    soc, innovation_V = (
        np.concatenate(of) for of in zip(*((one.soc, one.innovation_V) for one in scored), strict=True)
    )
    noise = with_factors(battery.noise, np.exp(log_factors))
    noise = replace(noise, model_std_V=_within(battery.noise, noise, soc.min(), soc.max()))
    tuned = replace(battery, noise=noise)
    over_last = _rms(innovation_V) / _step_V(logs)
    return Tuning(tuned, factors, voltages, float(excess_before), float(excess), over_last, after - before, innovations)


def _rms(values: np.ndarray) -> float:
    """Root mean square of those that are numbers."""
    return math.sqrt(float(np.nanmean(np.square(values))))


def _step_V(logs: Sequence[Log]) -> float:
    """Root mean square of the steps from one voltage to the next [V], not less than a step of the converter."""
    steps_V = np.concatenate([np.diff(log.voltage_V) for log in logs])
    return max(_rms(steps_V), *(voltage_step_V(log.voltage_V) for log in logs), 1e-9)


def _within(old: BatteryNoise, new: BatteryNoise, low: float, high: float) -> tuple[float, ...]:
    """The error of the model along SoC: the new one from low to high; beyond what the logs show never a smaller one."""
    grid = np.linspace(0.0, 1.0, max(len(old.model_std_V), _GRID))
    reached = (grid >= low - _MARGIN) & (grid <= high + _MARGIN)
    along = np.linspace(0.0, 1.0, len(old.model_std_V))
    before, after = (np.interp(grid, along, noise.model_std_V) for noise in (old, new))
    return tuple(map(float, np.where(reached, after, np.maximum(before, after))))


def _judged(k: int, found: Maximum, battery: Battery, logs: Sequence[Log]) -> TunedFactor:
    """The factor with its interval, or with the reason for which the logs do not tell it."""
    name, mean = FACTORS[k], float(found.log_factors[k])
    half = BAND_95 * math.sqrt(max(float(found.cov[k, k]), 0.0)) if np.isfinite(found.cov[k, k]) else math.nan
    factor = TunedFactor(name, math.exp(mean), math.exp(mean - half), math.exp(mean + half))
    if math.isnan(half):
        return factor._replace(refused="the logs are too short to tell its interval; six hours are needed")
    if abs(mean) > math.log(WIDEST) - 0.1:
        return factor._replace(refused=f"it is more than {WIDEST:g} times off: the file is not of this battery")
    if half > math.log(WIDEST_INTERVAL):
        return factor._replace(refused=f"its 95 % interval is wider than a factor {WIDEST_INTERVAL:g} to either side")
    if name == "voltage":
        return _resolved(factor, battery, logs)
    if (swept := swept_soc(battery, logs)) < LEAST_SWEEP:
        return factor._replace(
            refused=f"the charge moves by {100 * swept:.1f} % only; errors that come with current "
            f"and charge need at least {100 * LEAST_SWEEP:.0f} %"
        )
    return factor


def _resolved(factor: TunedFactor, battery: Battery, logs: Sequence[Log]) -> TunedFactor:
    """The factor of the white noise, unless it lies below what the steps of the converter can show."""
    step_V = max(voltage_step_V(log.voltage_V) for log in logs)
    least_V = step_V / math.sqrt(12.0)
    if factor.factor * battery.noise.voltage_std_V < least_V:
        return factor._replace(
            refused=f"the voltage has steps of {1e3 * step_V:.3g} mV: no noise below {1e3 * least_V:.2g} mV can be told"
        )
    return factor


def voltage_step_V(voltage_V: np.ndarray) -> float:
    """Step of the converter [V]: the least difference between two values, where most values come again; 0 without."""
    values = np.unique(np.round(voltage_V[np.isfinite(voltage_V)], 9))
    if values.size < 2 or values.size > 0.2 * np.isfinite(voltage_V).sum():
        return 0.0
    return float(np.diff(values).min())


def swept_soc(battery: Battery, logs: Sequence[Log]) -> float:
    """Range of SoC in the logs, by counting; the largest of all."""
    model = require_thevenin(battery)
    ranges = []
    for log in logs:
        current_A = np.where(np.isfinite(log.current_A), log.current_A, 0.0)
        charge_As = np.cumsum(current_A * np.diff(log.time_s, prepend=log.time_s[0]))
        ranges.append(float(np.ptp(charge_As)) / model.capacity_As)
    return max(ranges)
