"""State of charge before the first step: from a value, from the first voltage, or from both.

On a grid of SoC the first voltage is weighed with all that can be wrong about it; mean and standard deviation of the
result start the filter. A value that the voltage contradicts is overruled: the prior keeps a small share for "the value
is wrong". Without a value the prior is flat. This is a Bayesian update without linearisation, where it matters most:
an OCV curve is flat here and steep there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.models.noise import HYSTERESIS_UNKNOWN_STD, BatteryNoise
from ohmward.battery.models.sensor import CurrentSensor
from ohmward.battery.models.temperature import coldness_per_K
from ohmward.battery.models.thevenin import CircuitInput, Thevenin, ohmic_drop, pair_resistances
from ohmward.battery.soc.clean_sample import finite_or
from ohmward.checks import require_between, require_positive

#: Share of the prior for a wrong value: then nothing is known.
WRONG_SHARE = 0.02

#: Extent of the grid beyond empty and full. A value at an end is a claim about the end, not about the middle: cut
#: off there, "full" would come out as full minus 0.8 sigma.
MARGIN = 0.2

#: Share by which a first voltage may lie beyond the curve before it is taken for a fault of its sensor.
BEYOND = 0.25


#: RC voltages before the first sample, as a share of those of a steady current of its size: anything from 0 to 1.
PAST_SHARE = 0.5

#: Smallest standard deviation of the start: no first voltage tells SoC better.
LEAST_STD = 1e-3


class InitialSoc(NamedTuple):
    """State of charge and its standard deviation, before the first step.

    model_error, model_error_std: of the model's voltage where it stays with SoC, in its own standard deviations.
    covariance: of SoC with it. The first voltage tells their sum: a curve that is too low comes with a SoC that is too
        high, and the same voltage once more is no news.
    """

    soc: float
    std: float
    model_error: float = 0.0
    model_error_std: float = 1.0
    covariance: float = 0.0


class FirstVoltage(NamedTuple):
    """The first voltage on the grid of SoC, (G,) each.

    likelihood: up to a factor.
    model_error_std_V: standard deviation of the model's error that stays with SoC.
    error_V, error_std_V: of that error, given the voltage and SoC.
    """

    likelihood: np.ndarray
    model_error_std_V: np.ndarray
    error_V: np.ndarray
    error_std_V: np.ndarray


class Hypothesis(NamedTuple):
    """A part of the density before the first step: its mass, up to a factor that all parts share, and its moments."""

    weight: float
    start: InitialSoc


def initial_soc(
    voltage_V: float,
    u: CircuitInput,
    p: Thevenin,
    noise: BatteryNoise,
    sensor: CurrentSensor,
    soc: float | None = None,
    soc_std: float = 0.03,
) -> InitialSoc:
    """Mean and standard deviation of SoC given the first voltage and, where there is one, a value.

    voltage_V: first terminal voltage; nan when there is none.
    u: current and temperature at that sample.
    soc: value in [0, 1] from the user, from a full charge, from storage; None when unknown.
    soc_std: standard deviation of that value.
    """
    (whole,) = hypotheses(voltage_V, u, p, noise, sensor, soc, soc_std, count=1)
    return whole.start


def hypotheses(
    voltage_V: float,
    u: CircuitInput,
    p: Thevenin,
    noise: BatteryNoise,
    sensor: CurrentSensor,
    soc: float | None,
    soc_std: float,
    count: int,
) -> tuple[Hypothesis, ...]:
    """The density of SoC in `count` parts: "the value is right", and cells of equal mass of "nothing is known".

    Arguments as those of `initial_soc`. One part is the whole density.
    """
    if soc is not None:
        require_between("initial_soc", soc, 0.0, 1.0)
        require_positive("initial_soc_std", soc_std)
    grid = _grid_through(0.5 if soc is None else soc)
    first = _first_voltage(grid, voltage_V, u, p, noise, sensor)
    *told, anywhere = _priors(grid, soc, soc_std)
    if count == 1:
        priors = [sum(told) + anywhere]
    else:
        cells = _cells_of_equal_mass(anywhere * first.likelihood, count - len(told))
        priors = [*told, *(anywhere * cell for cell in cells)]
    # beside a value that is told the voltage counts once more as it goes on: that is what finds a wrong one
    return tuple(_moments(grid, prior, first, joint=soc is None) for prior in priors)


def _moments(grid: np.ndarray, prior: np.ndarray, first: FirstVoltage, joint: bool) -> Hypothesis:
    """Mass, mean and standard deviation of a part, `joint` with the error of the model; if ruled out, of its prior."""
    density = prior * first.likelihood
    mass = float(density.sum())
    density = density / mass if mass > 0.0 else prior / prior.sum()
    mean = float(density @ grid)
    std = float(np.sqrt(density @ (grid - mean) ** 2))
    start = InitialSoc(min(max(mean, 0.0), 1.0), max(std, LEAST_STD))
    unit_V = float(np.interp(mean, grid, first.model_error_std_V))
    if not joint or unit_V == 0.0:
        return Hypothesis(mass, start)
    error, error_std = first.error_V / unit_V, first.error_std_V / unit_V
    model_error = float(density @ error)
    variance = float(density @ (error_std**2 + (error - model_error) ** 2))
    covariance = float(density @ ((grid - mean) * (error - model_error)))
    return Hypothesis(mass, InitialSoc(start.soc, start.std, model_error, float(np.sqrt(variance)), covariance))


def _cells_of_equal_mass(density: np.ndarray, count: int) -> np.ndarray:
    """(count, G) shares of each point of the grid in cells of equal mass, one after the other along it."""
    above = np.cumsum(density) / density.sum() * count
    below = np.concatenate([[0.0], above[:-1]])
    first = np.arange(count)[:, None]
    inside = np.clip(above, first, first + 1) - np.clip(below, first, first + 1)
    return np.where(above > below, inside / np.maximum(above - below, np.finfo(float).tiny), 1.0 / count)


def _grid_through(soc: float) -> np.ndarray:
    """Steps of 0.25 %, one of them on the value: a peak narrower than a step would fall between two."""
    grid = np.linspace(-MARGIN, 1.0 + MARGIN, 561)
    return grid + (soc - grid[np.argmin(np.abs(grid - soc))])


def _priors(grid: np.ndarray, soc: float | None, soc_std: float) -> tuple[np.ndarray, ...]:
    """Densities on the grid, up to a factor: around the value where there is one, and flat for "nothing is known"."""
    possible = ((grid >= 0.0) & (grid <= 1.0)) / np.count_nonzero((grid >= 0.0) & (grid <= 1.0))
    if soc is None:
        return (possible,)
    peak = np.exp(-0.5 * ((grid - soc) / soc_std) ** 2)
    return (1 - WRONG_SHARE) * peak / peak.sum(), WRONG_SHARE * possible


def _first_voltage(
    grid: np.ndarray, voltage_V: float, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor
) -> FirstVoltage:
    """Likelihood of the voltage at each SoC and the model's error that goes with it; flat without a credible voltage.

    A voltage a little beyond the curve, as after charging or under load, is that of full or empty.
    """
    model_std = model_error_std_V(grid, u, p, noise)
    unknown = FirstVoltage(np.ones_like(grid), model_std, np.zeros_like(grid), model_std)
    if not np.isfinite(voltage_V):
        return unknown
    u = CircuitInput(finite_or(u.current_A, 0.0), u.temperature_degC)
    expected = p.ocv.mean_V(grid, u.temperature_degC) + ohmic_drop(grid, u, p)
    lowest_V, highest_V = np.interp((0.0, 1.0), grid, expected)
    if not (1 - BEYOND) * lowest_V < voltage_V < (1 + BEYOND) * highest_V:
        return unknown
    excess_V = np.clip(voltage_V, lowest_V, highest_V) - expected
    std = first_voltage_std(grid, u, p, noise, sensor)
    share = (model_std / std) ** 2
    with np.errstate(under="ignore"):
        scaled = 0.5 * (excess_V / std) ** 2 + np.log(std)
        likelihood = np.exp(-(scaled - scaled.min()))
    return FirstVoltage(likelihood, model_std, share * excess_V, model_std * np.sqrt(1 - share))


def model_error_std_V(soc: np.ndarray, u: CircuitInput, p: Thevenin, noise: BatteryNoise) -> np.ndarray:
    """Standard deviation [V] of the model at rest where it stays with SoC: of the curve, its axis, its temperature."""
    slope = np.gradient(p.ocv.mean_V(soc, u.temperature_degC), soc)
    model = np.interp(soc, np.linspace(0.0, 1.0, len(noise.model_std_V)), noise.model_std_V)
    thermal = noise.ocv_std_V_per_K * (u.temperature_degC - p.ocv.reference_degC)
    return np.sqrt(model**2 + (noise.soc_axis_std * slope) ** 2 + thermal**2)


def first_voltage_std(
    soc: np.ndarray, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor
) -> np.ndarray:
    """Standard deviation [V] of the first voltage about OCV + R_0 i: sensor, model, OCV, drop, hysteresis, past."""
    past = sum(pair_resistances(soc, u, p)) * (abs(u.current_A) + sensor.offset_std_A)
    resistance_std = np.sqrt(noise.resistance_variance(coldness_per_K(u.temperature_degC, p.reference_degC)))
    drop = resistance_std * abs(ohmic_drop(soc, u, p))
    hysteresis = HYSTERESIS_UNKNOWN_STD * np.exp(noise.hysteresis_std**2) * p.hysteresis_V_at(soc, u.temperature_degC)
    terms = (
        noise.voltage_std_V,
        model_error_std_V(soc, u, p, noise),
        hysteresis,
        drop,
        PAST_SHARE * np.exp(resistance_std**2) * past,
    )
    return np.sqrt(sum(np.square(t) for t in terms))
