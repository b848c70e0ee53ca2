"""Tests of the claimed uncertainty: NEES, NIS and whiteness; Bar-Shalom, Li and Kirubarajan 2001, section 5.4.

Offline: the quantiles come from SciPy, which is imported when they are needed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.belief import Belief, require_shape
from ohmward.filters.linear_algebra import solve_spd
from ohmward.optional import require

#: Standard deviations to either side of the mean within which 95 % of a normal distribution lie.
BAND_95 = 1.959964
#: Half axis of the ellipse that holds 95 % of a normal distribution in the plane, in standard deviations.
ELLIPSE_95 = math.sqrt(-2.0 * math.log(0.05))


class Verdict(NamedTuple):
    """A mean chi-square statistic against its two-sided bounds; no units."""

    mean: float  #: of NEES or NIS over times or runs
    #: bounds that contain a consistent filter's mean with the given probability
    lower: float
    upper: float

    @property
    def consistent(self) -> bool:
        """True where the mean lies within the bounds."""
        return self.lower <= self.mean <= self.upper

    @property
    def advice(self) -> str:
        """Meaning of the verdict in one sentence."""
        if self.mean > self.upper:
            return "The filter claims less uncertainty than it has: raise Q or R, or look for an unmodelled bias."
        if self.mean < self.lower:
            return "The filter claims more uncertainty than it has: lower Q or R."
        if self.consistent:
            return "The claimed uncertainty agrees with the errors."
        return "The statistic is not a number: the filter has diverged or a measurement was missing."


class Whiteness(NamedTuple):
    """Test for correlation between successive innovations."""

    autocorrelation: np.ndarray  #: (max_lag, m), of each innovation at lags 1 ... max_lag, in [-1, 1].
    bound: float  #: |autocorrelation| of white noise stays below it with the given probability, lag by lag
    p_value: np.ndarray  #: (m,), Ljung-Box probability that white noise is at least as correlated over all lags


def nees(belief: Belief, truth: np.ndarray) -> float:
    """Normalised estimation error squared (x - x_hat)' P^-1 (x - x_hat); chi-square with n degrees of freedom.

    truth: (n,), the true state.
    """
    require_shape("truth", truth, np.shape(belief.mean))
    error = truth - belief.mean
    return error @ solve_spd(belief.cov, error)


def ensemble(statistic: np.ndarray, dof: int, probability: float = 0.95) -> list[Verdict]:
    """Verdict at each time over independent runs.

    statistic: (runs, T), NEES or NIS with `dof` degrees of freedom each.  Returns: T verdicts.
    """
    runs = len(statistic)
    lower, upper = mean_bounds(dof, runs, probability)
    return [Verdict(float(mean), lower, upper) for mean in np.mean(statistic, axis=0)]


def time_average(statistic: np.ndarray, dof: int, probability: float = 0.95) -> Verdict:
    """Verdict over time in one run.

    The bounds hold for samples that are independent: NIS of a consistent filter is, NEES is not (its mean is right but
    scatters more than the bounds say).

    statistic: (T,), with `dof` degrees of freedom each.
    """
    return Verdict(float(np.mean(statistic)), *mean_bounds(dof, len(statistic), probability))


def mean_bounds(dof: int, count: int, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided bounds on the mean of `count` independent chi-square variables with `dof` degrees of freedom each.

    Their sum is chi-square with count * dof degrees of freedom, exactly.
    """
    chi2 = require("scipy.stats", "a chi-square test").chi2

    _require_probability(probability)
    tail = (1 - probability) / 2
    lower, upper = chi2.ppf([tail, 1 - tail], count * dof) / count
    return float(lower), float(upper)


def gate_threshold(m: int, probability: float = 0.999) -> float:
    """NIS that a valid measurement of m elements stays below with this probability."""
    chi2 = require("scipy.stats", "a chi-square test").chi2

    _require_probability(probability)
    return float(chi2.ppf(probability, m))


def whiteness(innovations: np.ndarray, max_lag: int = 20, probability: float = 0.95) -> Whiteness:
    """Autocorrelation of the innovations about zero, with the Ljung-Box test over all lags.

    About zero, not about their mean: a constant bias is a correlation that must show up.

    innovations: (T, m), best divided by their standard deviations.

    Raises:
        InputError: `max_lag` is not in [1, T - 1].
    """
    stats = require("scipy.stats", "a chi-square test")

    _require_probability(probability)
    T = len(innovations)
    if not 1 <= max_lag < T:
        raise InputError(f"max_lag must be from 1 to {T - 1} (one less than the samples) but is {max_lag}")
    lags = np.arange(1, max_lag + 1)
    sums = np.array([(innovations[lag:] * innovations[:-lag]).sum(axis=0) for lag in lags])
    rho = sums / (innovations**2).sum(axis=0)
    ljung_box = T * (T + 2) * (rho**2 / (T - lags)[:, None]).sum(axis=0)
    bound = float(stats.norm.ppf(0.5 + probability / 2)) / np.sqrt(T)
    return Whiteness(rho, bound, stats.chi2.sf(ljung_box, max_lag))


def _require_probability(probability: float) -> None:
    if not 0 < probability < 1:
        raise InputError(f"probability must lie between 0 and 1 but is {probability}; 0.95 is customary")
