"""Fit of friction laws to measured forces, and selection of the best.

    F = F_law(contact) - c N,    c: resistance ratio, of rolling and of the soil that is pressed and bulldozed

Least squares from every start of a family. Confidence intervals are those of the linearised fit (Student's t, on the
scale of the search), cut at the limits of the parameters: that of an unidentified one reaches from limit to limit. They
hold as far as the law does: look at `lack_of_fit`. A law is judged, and chosen, by its errors on data that it was not
fitted to: whole groups (slips, runs, days) are left out, because repetitions of a measurement are not independent.

Where slips are about as few as parameters, least squares alone takes resistance and stiffness to any value, and a slip
that was left out is missed by the whole force. A fit with a prior minimises

    sum(errors^2) / sigma^2 + sum(departures^2)

with the variance sigma^2 that least squares leave, and the departures from published grounds (`published_grounds`):
data with little scatter or many slips overrule it. `select_law` fits so; intervals leave the prior out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.traction.friction.families import RESISTANCE, Family, Free
from ohmward.traction.friction.law import Contact, TractionLaw, direction_and_size
from ohmward.traction.friction.published_grounds import departures

#: Starts that a fit with a prior follows to their end, the most promising ones.
_FOLLOWED = 2
#: Speed [m/s] that a wheel at rest counts with in the mean.
_REST_SPEED_M_S = 1e-6
#: Load [N] at which a wheel that carries nothing is compared.
_COMPARED_LOAD_N = 1e-3


class ForceSlip(NamedTuple):
    """Measurements of one wheel; arrays (n,)."""

    contact: Contact  #: speeds [m/s] and loads [N]
    force_N: np.ndarray  #: drawbar pull: forward on the body, resistance included

    def pick(self, rows: np.ndarray) -> ForceSlip:
        """Measurements of a mask (n,)."""
        return ForceSlip(Contact(*(values[rows] for values in self.contact)), self.force_N[rows])


class Interval(NamedTuple):
    """A parameter with its 95 % confidence interval."""

    name: str
    value: float
    low: float
    high: float
    identified: bool  #: True where the interval lies within the limits of the search


class LawFit(NamedTuple):
    """A fitted law."""

    family: str  #: its name
    law: TractionLaw  #: with the best parameters
    resistance_coefficient: float  #: c
    intervals: tuple[Interval, ...]  #: of the family's parameters and of c
    rmse_N: float  #: of the measurements that it was fitted to

    def force_N(self, contact: Contact) -> np.ndarray:
        """Drawbar pull (n,) [N]."""
        return drawbar_N(self.law, self.resistance_coefficient, contact)


def drawbar_N(law: TractionLaw, resistance_coefficient: float, contact: Contact) -> np.ndarray:
    """Traction (n,) [N] less the resistance of the wheel itself."""
    direction, _ = direction_and_size(contact.travel_speed_m_s)
    return law.force_N(contact) - resistance_coefficient * direction * contact.load_N


def fit_law(data: ForceSlip, family: Family, *, prior: bool = False) -> LawFit:
    """The law of the family that fits best, by least squares.

    prior: True also weighs how far the law is from published grounds, which matters where slips are few.

    Raises:
        InputError: fewer measurements than parameters, or one that is not finite.
    """
    scale = [_Scale(f) for f in (*family.free, RESISTANCE)]
    _check(data, family, len(scale))
    search = _LawSearch(data, family, scale)
    best = search.with_prior() if prior else search.least_squares()
    law, share = search.law(best.x)
    errors_N = search.errors_N(best.x)
    return LawFit(family.name, law, share, _intervals(scale, best, len(errors_N)), float(np.sqrt(np.mean(errors_N**2))))


def select_law(data: ForceSlip, families: Sequence[Family], groups: np.ndarray) -> LawFit:
    """Fit, with a prior, of the family that predicts a left-out group best; groups: (n,) labels."""
    if not families:
        raise InputError("families must hold at least one family")

    def left_out_N(family: Family) -> float:
        return float(np.sum(left_out_errors_N(data, groups, lambda seen, _: fit_law(seen, family, prior=True)) ** 2))

    return fit_law(data, min(families, key=left_out_N), prior=True)


def left_out_errors_N(
    data: ForceSlip, groups: np.ndarray, fit: Callable[[ForceSlip, np.ndarray], LawFit]
) -> np.ndarray:
    """Errors (n,) [N] of forces that the fit has not seen: each group is predicted from all others.

    fit: from measurements and their groups. With `select_law` inside, the choice of the law is judged too.

    Raises:
        InputError: fewer than two groups.
    """
    labels = np.unique(groups)
    if len(labels) < 2:
        raise InputError(f"groups must name at least two groups, or nothing can be left out; got {len(labels)}")
    errors_N = np.empty(len(data.force_N))
    for label in labels:
        out = groups == label
        left = data.pick(out)
        errors_N[out] = fit(data.pick(~out), groups[~out]).force_N(left.contact) - left.force_N
    return errors_N


def lack_of_fit(fit: LawFit, data: ForceSlip, groups: np.ndarray) -> float:
    """Probability of residuals as large as these if the law holds; groups: (n,) labels of repetitions.

    F = [SS_lack / (G - p)] / [SS_pure / (n - G)]: scatter of the groups about the law over that within them.

    Raises:
        InputError: not more groups than parameters, or no group with two measurements.
    """
    f = require("scipy.stats", "a fit of slip laws").f

    labels, n, p = np.unique(groups), len(data.force_N), len(fit.intervals)
    if not p < len(labels) < n:
        raise InputError(
            f"groups must be more than the {p} parameters and fewer than the {n} values; got {len(labels)}"
        )
    errors_N = fit.force_N(data.contact) - data.force_N
    pure = sum(float(np.sum((errors_N[groups == g] - errors_N[groups == g].mean()) ** 2)) for g in labels)
    lack = float(np.sum(errors_N**2)) - pure
    return float(f.sf((lack / (len(labels) - p)) / (pure / (n - len(labels))), len(labels) - p, n - len(labels)))


class _Scale:
    """The scale on which a parameter is searched: logarithmic if it is positive."""

    def __init__(self, free: Free) -> None:
        self.free = free
        self.logarithmic = free.low > 0
        self.low, self.high = self.search(free.low), self.search(free.high)

    def search(self, value: float) -> float:
        return float(np.log(value)) if self.logarithmic else value

    def value(self, z: float) -> float:
        """Inverse of `search`; rounding never leaves the limits."""
        return float(np.clip(np.exp(z) if self.logarithmic else z, self.free.low, self.free.high))


class _LawSearch:
    """Search for the parameters of a law, on the scale of each."""

    def __init__(self, data: ForceSlip, family: Family, scale: Sequence[_Scale]) -> None:
        self.data, self.family, self.scale = data, family, scale
        self.limits = [s.low for s in scale], [s.high for s in scale]
        self.starts = [np.array(z) for z in product(*([s.search(start) for start in s.free.starts] for s in scale))]

    def law(self, z: np.ndarray) -> tuple[TractionLaw, float]:
        """Law and resistance coefficient."""
        *values, share = (s.value(x) for s, x in zip(self.scale, z, strict=True))
        return self.family.make(*values), share

    def errors_N(self, z: np.ndarray) -> np.ndarray:
        """Errors (n,) of the force."""
        return drawbar_N(*self.law(z), self.data.contact) - self.data.force_N

    def least_squares(self):
        """Best fit of all starts."""
        return self._best(self.errors_N, self.starts)

    def with_prior(self):
        """Best fit with the departures from published grounds, at the scatter that least squares leave."""
        closest = self.least_squares()
        sigma_N = math.sqrt(2 * closest.cost / (len(closest.fun) - len(self.scale)))
        typical = _typical_contact(self.data.contact)

        def costs(z: np.ndarray) -> np.ndarray:
            return np.concatenate([self.errors_N(z), sigma_N * departures(*self.law(z), typical)])

        ordered = sorted(self.starts, key=lambda z: float(np.sum(costs(z) ** 2)))
        return self._best(costs, [closest.x, *ordered[:_FOLLOWED]])

    def _best(self, costs: Callable[[np.ndarray], np.ndarray], starts: Sequence[np.ndarray]):
        solve = require("scipy.optimize", "a fit of slip laws").least_squares
        return min((solve(costs, start, bounds=self.limits) for start in starts), key=lambda fit: fit.cost)


def _typical_contact(at: Contact) -> Contact:
    """Geometric mean of the faster of rim and travel, without slip, at the mean load."""
    fastest_m_s = np.maximum(np.maximum(np.abs(at.rim_speed_m_s), np.abs(at.travel_speed_m_s)), _REST_SPEED_M_S)
    speed_m_s = float(np.exp(np.mean(np.log(fastest_m_s))))
    return Contact(0.0, speed_m_s, speed_m_s, max(float(np.mean(at.load_N)), _COMPARED_LOAD_N))


def _intervals(scale: Sequence[_Scale], best, n: int) -> tuple[Interval, ...]:
    """Of the n measurements alone, about the values found."""
    t = require("scipy.stats", "a fit of slip laws").t

    p, jac = len(scale), best.jac[:n]
    variance = float(np.sum(best.fun[:n] ** 2)) / (n - p)
    half = t.ppf(0.975, n - p) * np.sqrt(variance * _inverse_diagonal(jac))
    low = np.maximum(best.x - half, [s.low for s in scale])
    high = np.minimum(best.x + half, [s.high for s in scale])
    inside = (low > [s.low for s in scale]) & (high < [s.high for s in scale])
    return tuple(
        Interval(s.free.name, s.value(x), s.value(a), s.value(b), bool(known))
        for s, x, a, b, known in zip(scale, best.x, low, high, inside, strict=True)
    )


def _inverse_diagonal(jac: np.ndarray) -> np.ndarray:
    """Diagonal of (J'J)^-1, inf for a parameter that is not observable through J."""
    _, s, Vt = np.linalg.svd(jac, full_matrices=False)
    seen = s > 1e-9 * s[0]
    diagonal = np.sum((Vt[seen] / s[seen, None]) ** 2, axis=0)
    return np.where(np.any(np.abs(Vt[~seen]) > 1e-6, axis=0), np.inf, diagonal)


def _check(data: ForceSlip, family: Family, parameters: int) -> None:
    n = len(data.force_N)
    if n <= parameters:
        raise InputError(f"{family.name} has {parameters} parameters and needs more measurements, got {n}")
    for name, values in (*data.contact._asdict().items(), ("force_N", data.force_N)):
        if np.shape(values) != (n,) or not np.isfinite(values).all():
            raise InputError(f"{name} must hold {n} finite numbers; drop the measurements that failed")
