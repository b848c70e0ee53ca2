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
    """State of charge and its standard deviation, before the first step."""

    soc: float
    std: float


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
    likelihood = _likelihood(grid, voltage_V, u, p, noise, sensor)
    *told, anywhere = _priors(grid, soc, soc_std)
    if count == 1:
        return (_moments(grid, sum(told) + anywhere, likelihood),)
    cells = _cells_of_equal_mass(anywhere * likelihood, count - len(told))
    return tuple(_moments(grid, prior, likelihood) for prior in (*told, *(anywhere * cell for cell in cells)))


def _moments(grid: np.ndarray, prior: np.ndarray, likelihood: np.ndarray) -> Hypothesis:
    """Mass, mean and standard deviation of a part; where the voltage rules it out, those of its prior."""
    density = prior * likelihood
    mass = float(density.sum())
    density = density / mass if mass > 0.0 else prior / prior.sum()
    mean = float(density @ grid)
    std = float(np.sqrt(density @ (grid - mean) ** 2))
    return Hypothesis(mass, InitialSoc(min(max(mean, 0.0), 1.0), max(std, LEAST_STD)))


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


def _likelihood(
    grid: np.ndarray, voltage_V: float, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor
) -> np.ndarray:
    """Likelihood of the voltage at each SoC, up to a factor; flat without a credible voltage.

    A voltage a little beyond the curve, as after charging or under load, is that of full or empty.
    """
    if not np.isfinite(voltage_V):
        return np.ones_like(grid)
    u = CircuitInput(finite_or(u.current_A, 0.0), u.temperature_degC)
    expected = p.ocv.mean_V(grid, u.temperature_degC) + ohmic_drop(grid, u, p)
    lowest_V, highest_V = np.interp((0.0, 1.0), grid, expected)
    if not (1 - BEYOND) * lowest_V < voltage_V < (1 + BEYOND) * highest_V:
        return np.ones_like(grid)
    voltage_V = np.clip(voltage_V, lowest_V, highest_V)
    std = first_voltage_std(grid, u, p, noise, sensor)
    with np.errstate(under="ignore"):
        scaled = 0.5 * ((voltage_V - expected) / std) ** 2 + np.log(std)
        return np.exp(-(scaled - scaled.min()))


def first_voltage_std(
    soc: np.ndarray, u: CircuitInput, p: Thevenin, noise: BatteryNoise, sensor: CurrentSensor
) -> np.ndarray:
    """Standard deviation [V] of the first voltage about OCV + R_0 i: sensor, model, OCV, drop, hysteresis, past."""
    slope = np.gradient(p.ocv.mean_V(soc, u.temperature_degC), soc)
    model = np.interp(soc, np.linspace(0.0, 1.0, len(noise.model_std_V)), noise.model_std_V)
    past = sum(pair_resistances(soc, u, p)) * (abs(u.current_A) + sensor.offset_std_A)
    resistance_std = np.sqrt(noise.resistance_variance(coldness_per_K(u.temperature_degC, p.reference_degC)))
    drop = resistance_std * abs(ohmic_drop(soc, u, p))
    hysteresis = HYSTERESIS_UNKNOWN_STD * np.exp(noise.hysteresis_std**2) * p.ocv.hysteresis_at(soc)
    thermal = noise.ocv_std_V_per_K * (u.temperature_degC - p.ocv.reference_degC)
    terms = (
        noise.voltage_std_V,
        model,
        noise.soc_axis_std * slope,
        hysteresis,
        thermal,
        drop,
        PAST_SHARE * np.exp(resistance_std**2) * past,
    )
    return np.sqrt(sum(np.square(t) for t in terms))
