"""Update of a battery file by one log, and capacity and resistance estimated from a part of it alone.

With the posterior N(m, C) of the corrections, their prior N(0, P) and the information L = C^-1 - P^-1 of the part, its
own likelihood along a direction d, all other corrections at their most likely values, is normal about

    m + d (d' P^-1 m) / (d' L d),        with the variance 1 / (d' L d).

A trend over months is fitted to these: estimates carried from log to log would count the same data again and again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.fold import ageing_direction, pulse_ohm
from ohmward.battery.learning.parameters import TITLES
from ohmward.battery.learning.solve import Solution
from ohmward.battery.learning.voltage_model import VoltageModel
from ohmward.battery.posterior import Unknowns
from ohmward.battery.soc.anchors import Anchor
from ohmward.filters.belief import Belief
from ohmward.json_values import plain

#: Smallest share of the capacity drawn from full, for its logarithm.
_LEAST_GIVEN = 1e-3
#: Smallest information about a logarithm: with a standard deviation above 1 nothing is known about the quantity.
_LEAST_INFORMATION = 1.0
_UNINFORMATIVE = Normal(float("nan"), float("inf"))


class LogEstimates(NamedTuple):
    """Estimates from a part of a log alone."""

    #: with std inf where it shows nothing
    capacity_Ah: Normal
    resistance_ohm: Normal
    lowest_soc: float  #: of the part
    given_Ah: Normal  #: charge D = Q (1 - s) from full down to it, in which errors of Q and s cancel


def log_estimates(model: VoltageModel, prior: Belief, found: Solution, after: Battery) -> LogEstimates:
    """Estimates from a part alone; after: the battery with its corrections."""
    p = model.parameters
    K = p.size
    precision = np.linalg.inv(prior.cov[:K, :K])
    information = np.linalg.inv(found.covariance[:K, :K]) - precision
    pull = precision @ found.x[:K]
    all_resistances = np.zeros(K)
    all_resistances[p.places("ohmic", "pair")] = 1.0
    capacity_Ah = _UNINFORMATIVE
    if found.capacity_known:
        capacity_Ah = log_estimate(after.capacity_Ah, ageing_direction(model.battery, p), pull, information)
    resistance_ohm = log_estimate(pulse_ohm(after.thevenin), all_resistances, pull, information)
    return LogEstimates(capacity_Ah, resistance_ohm, *_given(model, found, after))


def combined(shares: Sequence[Normal]) -> Normal:
    """Combine the normal distributions of one positive quantity from several parts."""
    known = [share for share in shares if np.isfinite(share.std)]
    if not known:
        return _UNINFORMATIVE
    weights = np.array([(share.mean / share.std) ** 2 for share in known])
    mean = float(np.exp(weights @ np.log([share.mean for share in known]) / weights.sum()))
    return Normal(mean, mean * float(weights.sum() ** -0.5))


def log_estimate(now: float, d: np.ndarray, pull: np.ndarray, information: np.ndarray) -> Normal:
    """Estimate of a quantity that is `now` in the corrected file, and whose logarithm grows along d."""
    of_part = float(d @ information @ d)
    if not of_part > _LEAST_INFORMATION:
        return _UNINFORMATIVE
    mean = now * float(np.exp(d @ pull / of_part))
    return Normal(mean, mean * of_part**-0.5)


def _given(model: VoltageModel, found: Solution, after: Battery) -> tuple[float, Normal]:
    """Lowest SoC s of a part, and D = Q (1 - s): d ln D = d ln Q - ds / (1 - s)."""
    soc = found.charge.soc
    lowest = int(np.argmin(soc))
    given = max(1.0 - float(soc[lowest]), _LEAST_GIVEN)
    columns = -found.charge.soc_columns(np.array([lowest]))[0] / given
    columns[model.parameters.group("capacity")] += 1.0
    given_Ah = after.capacity_Ah * given
    return float(soc[lowest]), Normal(given_Ah, given_Ah * float(np.sqrt(columns @ found.covariance @ columns)))


class LogUpdate(NamedTuple):
    """Update by one log."""

    log: str  #: its name
    verdict: str  #: "learnt", "set aside" or "seen"
    reason: str  #: why it was set aside, or what was learnt from it, in a sentence
    hours: float  #: its length
    #: estimates after this log, see `KnownBattery`
    capacity_Ah: Normal
    resistance_ohm: Normal
    offset_A: Normal
    #: range of SoC in it
    soc_min: float = math.nan
    soc_max: float = math.nan
    #: factor by which the standard deviation of each group of parameters narrowed, by its name
    information: Mapping[str, float] = MappingProxyType({})
    residual_rms_V: float = math.nan  #: measured minus expected voltage
    #: factor by which the squares of these errors exceed the variance that the file expects, at least 1
    misfit: float = math.nan
    #: SoC at the first and the last sample that was used
    soc_start: Normal = Normal(math.nan, math.nan)
    soc_end: Normal = Normal(math.nan, math.nan)
    #: estimates from this log alone, with all other parameters as known after it; the standard deviation is inf where
    #: it shows nothing
    own_capacity_Ah: Normal = _UNINFORMATIVE
    own_resistance_ohm: Normal = _UNINFORMATIVE
    given_Ah: Normal = _UNINFORMATIVE  #: charge from full down to the lowest SoC of the log
    anchors: tuple[Anchor, ...] = ()  #: events that gave SoC besides the voltage
    left_out: tuple[str, ...] = ()  #: stretches and samples of the log that were not used, and why

    def as_dict(self) -> dict[str, Any]:
        """The update for JSON; a number that is not known is None."""
        return dict(plain(self))


def narrowed(p: Unknowns, before: np.ndarray, after: np.ndarray) -> dict[str, float]:
    """Factor by which the standard deviation of each group became smaller, the mean of its parameters."""
    factors = {}
    for name, size in p.sizes.items():
        if size:
            k = p.group(name)
            ratio = np.diag(before)[k] / np.maximum(np.diag(after)[k], 1e-300)
            factors[name] = float(np.exp(0.5 * np.mean(np.log(ratio))))
    return factors


def what_narrowed(information: Mapping[str, float]) -> str:
    """The groups that narrowed most, in a line."""
    most = sorted(information.items(), key=lambda item: -item[1])[:3]
    parts = [f"{TITLES[name]} {factor:.2g} times narrower" for name, factor in most if factor >= 1.05]
    return ", ".join(parts) if parts else "nothing new"
