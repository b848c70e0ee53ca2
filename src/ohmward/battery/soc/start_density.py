"""Density of the state of charge before the first step, on a grid: from a value, from the first voltage, or from both.

It needs NumPy alone: an exported Python file has this very text.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Prior probability that a given value is wrong: then nothing is known.
WRONG_SHARE = 0.02

#: Step of the grid of SoC, small enough for a peak around a value not to fall between two points.
GRID_STEP = 0.0025

#: Extent of the grid beyond empty and full. A value at an end is a statement about that end: with the grid cut off
#: there, "full" would come out as full minus 0.8 sigma.
MARGIN = 0.2

#: Share by which a first voltage may lie beyond the curve before it counts as a fault of its sensor.
BEYOND = 0.25

#: Smallest standard deviation of the start: no first voltage determines SoC better.
LEAST_STD = 1e-3


class ExpectedVoltage(NamedTuple):
    """First voltage expected at each SoC, and its errors; numbers or arrays (G,) along the grid."""

    mean_V: np.ndarray  #: expected voltage
    std_V: np.ndarray  #: standard deviation of the measured voltage about it
    model_error_std_V: np.ndarray  #: standard deviation of the part that stays with SoC
    unit_V: np.ndarray  #: standard deviation of that part in the filter, which takes it in this unit


class FirstVoltage(NamedTuple):
    """The first voltage on the grid of SoC, (G,) each."""

    likelihood: np.ndarray  #: up to a factor
    unit_V: np.ndarray  #: standard deviation of the model's error that stays with SoC, in the filter
    #: mean and standard deviation of that error, given the voltage and SoC
    error_V: np.ndarray
    error_std_V: np.ndarray


class InitialSoc(NamedTuple):
    """State of charge and its standard deviation, before the first step."""

    soc: float
    std: float
    model_error: float = 0.0  #: error of the model's voltage that stays with SoC, in its own standard deviations
    model_error_std: float = 1.0  #: its standard deviation
    #: of SoC with that error. The first voltage only shows their sum: a curve that is too low goes with a SoC that is
    #: too high, and the same voltage again adds no information.
    covariance: float = 0.0


class Hypothesis(NamedTuple):
    """A part of the density before the first step: its mass, up to a factor that all parts share, and its moments."""

    weight: float
    start: InitialSoc


def soc_grid(soc: float | None) -> np.ndarray:
    """Grid of SoC with one point on the value, where there is one: else a narrow peak would fall between two."""
    around = 0.5 if soc is None else soc
    grid = np.linspace(-MARGIN, 1.0 + MARGIN, round((1.0 + 2.0 * MARGIN) / GRID_STEP) + 1)
    return grid + (around - grid[np.argmin(np.abs(grid - around))])


def start_hypotheses(
    grid: np.ndarray,
    voltage_V: float,
    expected: ExpectedVoltage,
    soc: float | None,
    soc_std: float,
    count: int,
    wrong_share: float = WRONG_SHARE,
) -> tuple[Hypothesis, ...]:
    """The density of SoC in `count` parts: "the value is right", and cells of equal mass of "nothing is known".

    grid: as of `soc_grid`.  voltage_V: first one, nan when there is none.  soc, soc_std: value, None when unknown.
    wrong_share: prior probability that the value is wrong.
    One part is the whole density.
    """
    first = _first_voltage(grid, voltage_V, expected)
    *given, anywhere = _priors(grid, soc, soc_std, wrong_share)
    if count == 1:
        priors = [sum(given) + anywhere]
    else:
        cells = _cells_of_equal_mass(anywhere * first.likelihood, count - len(given))
        priors = [*given, *(anywhere * cell for cell in cells)]
    # beside a given value the voltage counts again in the filter: that is what exposes a wrong value
    return tuple(_moments(grid, prior, first, joint=soc is None) for prior in priors)


def _first_voltage(grid: np.ndarray, voltage_V: float, expected: ExpectedVoltage) -> FirstVoltage:
    """Likelihood of the voltage at each SoC and the model's error that goes with it; flat without a credible voltage.

    A voltage a little beyond the curve, as after charging or under load, counts as that of full or empty.
    The curve rises: where it is too low for the voltage at one SoC, it is too low at every lower SoC, however uncertain
    the curve is there, as at the knee near empty; and vice versa.
    """
    mean_V, std_V, model_std_V, unit_V = expected
    unknown = FirstVoltage(np.ones_like(grid), unit_V, np.zeros_like(grid), unit_V)
    lowest_V, highest_V = np.interp((0.0, 1.0), grid, mean_V)
    if not (1 - BEYOND) * lowest_V < voltage_V < (1 + BEYOND) * highest_V:
        return unknown
    excess_V = np.clip(voltage_V, lowest_V, highest_V) - mean_V
    share = (model_std_V / std_V) ** 2
    with np.errstate(under="ignore"):
        errors = excess_V / std_V
        too_low = np.maximum.accumulate(np.maximum(errors, 0.0)[::-1])[::-1]
        too_high = np.maximum.accumulate(np.maximum(-errors, 0.0))
        scaled = 0.5 * (too_low**2 + too_high**2) + np.log(std_V)
        likelihood = np.exp(-(scaled - scaled.min()))
    return FirstVoltage(likelihood, unit_V, share * excess_V, model_std_V * np.sqrt(1 - share))


def _moments(grid: np.ndarray, prior: np.ndarray, first: FirstVoltage, joint: bool) -> Hypothesis:
    """Mass and moments of a part, `joint` with the error of the model; those of its prior if it is ruled out."""
    density = prior * first.likelihood
    mass = float(density.sum())
    density = density / mass if mass > 0.0 else prior / prior.sum()
    mean = float(density @ grid)
    std = float(np.sqrt(density @ (grid - mean) ** 2))
    start = InitialSoc(min(max(mean, 0.0), 1.0), max(std, LEAST_STD))
    unit_V = float(np.interp(mean, grid, first.unit_V))
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


def _priors(grid: np.ndarray, soc: float | None, soc_std: float, wrong_share: float) -> tuple[np.ndarray, ...]:
    """Densities on the grid, up to a factor: around the value where there is one, and flat for "nothing is known"."""
    possible = ((grid >= 0.0) & (grid <= 1.0)) / np.count_nonzero((grid >= 0.0) & (grid <= 1.0))
    if soc is None:
        return (possible,)
    peak = np.exp(-0.5 * ((grid - soc) / soc_std) ** 2)
    return (1 - wrong_share) * peak / peak.sum(), wrong_share * possible
