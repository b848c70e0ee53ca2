"""Rehearsal of a remedy: the band that the filter will show after a rest or a full charge, computed beforehand.

The truth is placed at two points of the belief along SoC, one standard deviation below and above the mean, with every
other state moved along as it is correlated. From each of them the model gives the voltage that the remedy would show,
and the filter itself runs on it from its present state. The mean of the two variances is what to expect.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.sample import SocEstimate, SocSample
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter
from ohmward.filters.belief import Belief, unpack
from ohmward.trace import Kernel

#: Time between two samples of a rehearsal [s], that of slow telemetry.
REHEARSAL_STEP_S = 30.0
#: Current of a full charge, in multiples of the capacity per hour: a usual charger of a robot.
CHARGE_C = 0.25
#: Rest after a full charge [s], in which the charger still holds the battery.
AFTER_CHARGE_S = 1800.0
#: The truth stands here, in standard deviations from the belief: the two-point Gauss-Hermite rule, equal weights.
POINTS = (-1.0, 1.0)


def std_along_rest(settings: TheveninFilter, kernel: Kernel, state: FilterState, duration_s: float) -> np.ndarray:
    """(T,) standard deviation of SoC to expect along a rest, every `REHEARSAL_STEP_S`.

    kernel: the filter's step, compiled.
    """
    variance = 0.0
    for point in POINTS:
        x = truth_at(settings, unpack(state.belief), point)
        samples = _steady(state, _measured_A(settings, x, settings.idle_current_A or 0.0), duration_s)
        variance = variance + filtered(settings, kernel, state, x, samples).soc_std ** 2 / len(POINTS)
    return np.sqrt(variance)


def std_after_full_charge(settings: TheveninFilter, kernel: Kernel, state: FilterState) -> float:
    """Standard deviation of SoC to expect some time after a full charge."""
    charge_A, idle_A = CHARGE_C * settings.model.capacity_Ah, settings.idle_current_A or 0.0
    variance = 0.0
    for point in POINTS:
        x = truth_at(settings, unpack(state.belief), point)
        stored_A = charge_A * settings.model.coulombic_efficiency * settings.system.split(x).charge_gain
        missing_s = (1.0 - float(x[SOC])) * settings.model.capacity_As / float(stored_A)
        steady = _steady(state, 0.0, missing_s + AFTER_CHARGE_S)
        true_A = np.where(np.cumsum(steady.dt_s) <= missing_s, charge_A, idle_A)
        samples = steady._replace(current_A=_measured_A(settings, x, true_A))
        variance += float(filtered(settings, kernel, state, x, samples).soc_std[-1]) ** 2 / len(POINTS)
    return float(np.sqrt(variance))


def filtered(
    settings: TheveninFilter, kernel: Kernel, state: FilterState, x: np.ndarray, samples: SocSample
) -> SocEstimate:
    """Estimates (T,) of the filter from a state on, where the battery is in the true state x."""
    voltage_V = true_voltage(settings, state, x, samples)
    _, estimates = kernel.scan(state, samples._replace(voltage_V=voltage_V))
    return estimates


def truth_at(settings: TheveninFilter, belief: Belief, point: float) -> np.ndarray:
    """State whose SoC is `point` standard deviations from the believed one, the others as they are correlated."""
    direction = belief.cov[:, SOC] / np.sqrt(max(belief.cov[SOC, SOC], 1e-12))
    x = belief.mean + point * direction
    hysteresis = settings.system.hysteresis_index
    x[SOC] = min(max(x[SOC], 0.0), 1.0)
    x[hysteresis] = min(max(x[hysteresis], -1.0), 1.0)
    return x


def true_voltage(settings: TheveninFilter, state: FilterState, x: np.ndarray, samples: SocSample) -> np.ndarray:
    """(T,) voltage [V] of the model along the samples, from its state x on."""
    before_A = np.concatenate([[state.current_A], samples.current_A[:-1]])
    no_variance = np.zeros((len(x), len(x)))

    def step(x: np.ndarray, inputs: tuple[SocSample, float]) -> tuple[np.ndarray, float]:
        sample, current_A = inputs
        clean = settings.sanitize(state._replace(current_A=current_A), sample)
        x = settings.system.next_state(x, clean)
        error = settings.system.voltage_error(Belief(x, no_variance), clean)
        return x, settings.system.voltage(x, clean, error)[0]

    nothing = SocSample(0.0, 0.0, 0.0, 0.0)
    _, voltage_V = Kernel(step, x, (nothing, 0.0), lowering="python").scan(x, (samples, before_A))
    return voltage_V


def _measured_A(settings: TheveninFilter, x: np.ndarray, true_A: Any) -> Any:
    """Current that the sensor shows of a true one, where the true state is x."""
    return true_A + float(x[settings.system.offset_index])


def _steady(state: FilterState, current_A: float, duration_s: float) -> SocSample:
    """Samples (T,) of a steady current at the present temperature, without a voltage."""
    count = int(np.ceil(duration_s / REHEARSAL_STEP_S))
    temperature_degC = np.full(count, float(state.temperature_degC))
    return SocSample(
        np.full(count, REHEARSAL_STEP_S), np.full(count, current_A), np.full(count, np.nan), temperature_degC
    )
