"""Fit of friction laws to measured forces, and selection of the best.

    F = F_law(contact) - c N,    c: resistance ratio, of rolling and of the soil that is compacted and bulldozed

Least squares from every start of a family. Confidence intervals are those of the linearised fit (Student's t, on the
scale of the search), clipped to the limits of the parameters: that of an unidentified one reaches from limit to limit.
They are valid as far as the law is: see `lack_of_fit`. A law is judged, and chosen, by its errors on data that it was
not fitted to: whole groups (slips, runs, days) are left out, because repetitions of a measurement are not independent.

With hardly more slips than parameters, least squares alone drives resistance and stiffness to any value, and the error
at a slip that was left out is as large as the force. A fit with a prior minimises

    sum(errors^2) / sigma^2 + sum(departures^2)

with the residual variance sigma^2 of least squares, and the departures from published grounds (`departures`): data with
little scatter or many slips overrule the prior. `select_law` fits this way; intervals leave the prior out.

The prior is weak, meant for few slips, and describes the usual traction of grounds.

The curves of Burckhardt's roads and of Wong's soils, at some slip ratios of a driven wheel, are taken as samples of one
lognormal distribution, in which roads and soils have the same weight:

    m = mean of log(F/N),   C = covariance of log(F/N) + e^2 I

A law has the departure L^-1 (log(F/N) - m), L L' = C, which is standard normal if the law is an ordinary one. So the
prior is the same for laws of all forms, whatever their parameters mean.

A family of friction laws for a fit to measured forces has free parameters, their limits and starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_finite
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.traction.friction.law import (
    SPEED_FLOOR,
    Brush,
    Burckhardt,
    Contact,
    CoulombCreep,
    SoftGround,
    Soil,
    TractionLaw,
    WardIagnemma,
    contact,
    direction_and_size,
)
from ohmward.traction.friction.terrain import ROADS


class Free(NamedTuple):
    """A parameter of a fit."""

    name: str  #: with its unit
    #: limits; a positive `low` means that it is searched on a logarithmic scale
    low: float
    high: float
    starts: tuple[float, ...]  #: values to start from


@dataclass(frozen=True)
class Family:
    """All laws of one form.

    Raises:
        InputError: limits or starts that contradict each other.
    """

    name: str  #: of the form
    free: tuple[Free, ...]  #: its parameters
    make: Callable[..., TractionLaw]  #: the law with these values of the parameters, in their order

    def __post_init__(self) -> None:
        for f in self.free:
            require_finite(f"{self.name}: {f.name}", (f.low, f.high, *f.starts))
            if not f.starts or not all(f.low <= start <= f.high for start in f.starts):
                raise InputError(f"{self.name}: {f.name} needs starts within {f.low:g} to {f.high:g}, got {f.starts}")


ADHESION = Free("adhesion", 1e-3, 5.0, (0.5,))
#: Share of the load that it takes to pull a free wheel; soil in front of a locked wheel weighs more than the wheel.
RESISTANCE = Free("resistance_coefficient", -1.0, 3.0, (0.05,))


def ward_iagnemma() -> Family:
    """C1 and C2, with C3 = 0."""
    return Family("Ward-Iagnemma", (ADHESION, _by_decades("c2_s_per_m", 0.1, 1e5)), WardIagnemma)


def ward_iagnemma_with_slope() -> Family:
    """C1, C2 and C3, the last over C1 C2, the slope without slip."""

    def make(c1: float, c2: float, end_slope: float) -> WardIagnemma:
        return WardIagnemma(c1, c2, end_slope * c1 * c2)

    end_slope = Free("c3 / (c1 c2)", -0.9, 0.9, (0.0,))
    return Family("Ward-Iagnemma with C3", (ADHESION, _by_decades("c2_s_per_m", 0.1, 1e5), end_slope), make)


def burckhardt(speed_floor_m_s: float = SPEED_FLOOR) -> Family:
    """c1, c2, and the share of c1 (1 - e^(-c2)) that c3 takes away at a slip ratio of 1."""

    def make(c1: float, c2: float, lost: float) -> Burckhardt:
        return Burckhardt(c1, c2, -lost * c1 * math.expm1(-c2), speed_floor_m_s)

    return Family("Burckhardt", (ADHESION, _by_decades("c2", 0.1, 1e4), Free("lost_share", 0.0, 1.0, (0.1,))), make)


def brush(patch_length_m: float = 0.05, speed_floor_m_s: float = SPEED_FLOOR) -> Family:
    """Adhesion and stiffness k for this patch length l: without lead the force identifies only k l^2."""

    def make(adhesion: float, stiffness: float) -> Brush:
        return Brush(adhesion, patch_length_m, stiffness, speed_floor_m_s=speed_floor_m_s)

    return Family("brush", (ADHESION, _by_decades("tread_stiffness_N_per_m2", 1e2, 1e8)), make)


def coulomb_creep() -> Family:
    """Adhesion and slope."""
    return Family("Coulomb with creep", (ADHESION, _by_decades("slope_s_per_m", 1e-2, 1e5)), CoulombCreep)


def soft_ground(soil: Soil, radius_m: float, width_m: float, speed_floor_m_s: float = SPEED_FLOOR) -> Family:
    """Angle phi and length K of Janosi and Hanamoto's shear; cohesion and Bekker's moduli are those of `soil`."""

    def make(friction_deg: float, shear_length_m: float) -> SoftGround:
        moduli = soil.frictional_modulus, soil.cohesive_modulus, soil.exponent, soil.cohesion_Pa
        return SoftGround(Soil(soil.name, *moduli, friction_deg, shear_length_m), radius_m, width_m, speed_floor_m_s)

    friction = Free("friction_deg", 0.1, 60.0, (25.0,))
    return Family("soft ground", (friction, _by_decades("shear_length_m", 1e-5, 1.0)), make)


def _by_decades(name: str, low: float, high: float) -> Free:
    """A parameter whose order of magnitude is unknown: a start in each decade."""
    starts = np.geomspace(low, high, round(math.log10(high / low)) + 1)[1:-1]
    return Free(name, low, high, tuple(starts.tolist()))


#: Lengths K [m] of Wong's section on shear: compacted clay; firm to loose sand, used for loams too; fresh snow.
#: Project Chrono uses 0.012 for LETE sand and 0.025 for loose sand.
_CLAY_M, _SAND_M, _SNOW_M = (0.006,), (0.01, 0.025), (0.025, 0.05)
#: J. Y. Wong, Theory of Ground Vehicles, table of terrain values: k_phi [kN/m^(n+2)], k_c [kN/m^(n+1)], n, c [kPa],
#: phi [deg]; water content in per cent.
SOILS: tuple[tuple[str, float, float, float, float, float, Sequence[float]], ...] = (
    ("dry sand", 1528.43, 0.99, 1.1, 1.04, 28.0, _SAND_M),
    ("sandy loam 15", 1515.04, 5.27, 0.7, 1.72, 29.0, _SAND_M),
    ("sandy loam 22", 43.12, 2.56, 0.2, 1.38, 38.0, _SAND_M),
    ("sandy loam 11", 1127.97, 52.53, 0.9, 4.83, 20.0, _SAND_M),
    ("sandy loam 23", 808.96, 11.42, 0.4, 9.65, 35.0, _SAND_M),
    ("sandy loam 26", 141.11, 2.79, 0.3, 13.79, 22.0, _SAND_M),
    ("sandy loam 32", 51.91, 0.77, 0.5, 5.17, 11.0, _SAND_M),
    ("clayey soil 38", 692.15, 13.19, 0.5, 4.14, 13.0, _SAND_M),
    ("clayey soil 55", 1262.53, 16.03, 0.7, 2.07, 10.0, _SAND_M),
    ("heavy clay 25", 1555.95, 12.7, 0.13, 68.95, 34.0, _CLAY_M),
    ("heavy clay 40", 103.27, 1.84, 0.11, 20.69, 6.0, _SAND_M),
    ("lean clay 22", 1724.69, 16.43, 0.2, 68.95, 20.0, _CLAY_M),
    ("lean clay 32", 119.61, 1.52, 0.15, 13.79, 11.0, _SAND_M),
    ("LETE sand", 5301.0, 102.0, 0.79, 1.3, 31.1, _SAND_M),
    ("upland sandy loam 51", 2080.0, 74.6, 1.1, 3.3, 33.7, _SAND_M),
    ("Rubicon sandy loam 43", 752.0, 6.9, 0.66, 3.7, 29.8, _SAND_M),
    ("North Gower clayey loam 46", 2471.0, 41.6, 0.73, 6.1, 26.6, _SAND_M),
    ("Grenville loam 24", 5880.0, 0.06, 1.01, 3.1, 29.8, _SAND_M),
    ("snow, U.S.", 196.72, 4.37, 1.6, 1.03, 19.7, _SNOW_M),
    ("snow, Harrison", 245.9, 2.49, 1.6, 0.62, 23.2, _SNOW_M),
    ("snow, Sweden", 66.08, 10.55, 1.44, 6.0, 20.7, _SNOW_M),
)
#: Radius and width [m] of wheels of small robots: the radii are those of Robotino's and Husky's.
_WHEELS = ((0.06, 0.05), (0.165, 0.05))
#: Slip ratios at which curves are compared: from grip to spinning on the spot, half a decade apart.
_SLIP_RATIOS = np.array([0.03, 0.1, 0.3, 1.0])
#: Relative error with which a law of any form follows a measured curve.
_FORM_STD = 0.05
#: Smallest traction over load that is distinguished from zero.
_LEAST_TRACTION = 1e-3
#: Handbooks give resistances over load from 0.01 (tyres on concrete) to 0.4 (tyres in loose sand); the prior has the
#: mean and standard deviation of a log-uniform distribution between these ends.
_RESISTANCES = 0.01, 0.4


class UsualTraction(NamedTuple):
    """Distribution of log(F/N) at the slip ratios, at one load."""

    mean: np.ndarray  #: (K,)
    whitening: np.ndarray  #: (K, K) L^-1


def departures(law: TractionLaw, resistance_coefficient: float, typical: Contact) -> np.ndarray:
    """Departures (K + 1,) of a law and of the resistance over load from usual ones, in standard deviations.

    typical: speed of the rim and load of the wheel to compare at; the other two are not used.
    """
    usual = usual_traction(float(typical.load_N))
    rim_m_s = np.full(len(_SLIP_RATIOS), float(typical.rim_speed_m_s))
    load_N = np.full(len(_SLIP_RATIOS), float(typical.load_N))
    share = law.force_N(contact(rim_m_s, rim_m_s * (1 - _SLIP_RATIOS), load_N)) / load_N
    traction = usual.whitening @ (np.log(np.maximum(share, _LEAST_TRACTION)) - usual.mean)
    mean, std = _resistance_moments()
    return np.append(traction, (resistance_coefficient - mean) / std)


@lru_cache(maxsize=16)
def usual_traction(load_N: float) -> UsualTraction:
    """Distribution over roads and soils at a load of a wheel."""
    at = contact(np.ones(len(_SLIP_RATIOS)), 1 - _SLIP_RATIOS, np.full(len(_SLIP_RATIOS), load_N))
    roads, soils = (np.array([np.log(law.force_N(at) / load_N) for law in laws]) for laws in (ROADS.values(), _soils()))
    mean = (roads.mean(axis=0) + soils.mean(axis=0)) / 2
    cov = sum((curves - mean).T @ (curves - mean) / (2 * len(curves)) for curves in (roads, soils))
    L = np.linalg.cholesky(cov + _FORM_STD**2 * np.eye(len(mean)))
    return UsualTraction(mean, np.linalg.inv(L))


@cache
def _soils() -> tuple[SoftGround, ...]:
    """Each soil with each of its shear lengths under each wheel."""
    return tuple(
        SoftGround(Soil(name, 1e3 * k_phi, 1e3 * k_c, n, 1e3 * cohesion, phi, K), radius_m, width_m)
        for name, k_phi, k_c, n, cohesion, phi, lengths in SOILS
        for K in lengths
        for radius_m, width_m in _WHEELS
    )


def _resistance_moments() -> tuple[float, float]:
    """Mean and standard deviation of a value whose logarithm is uniformly distributed between the two ends."""
    low, high = _RESISTANCES
    decades = np.log(high / low)
    mean = (high - low) / decades
    return mean, float(np.sqrt((high**2 - low**2) / (2 * decades) - mean**2))


#: Number of the most promising starts from which a fit with a prior is run.
_FOLLOWED = 2
#: Speed [m/s] with which a wheel at rest counts in the mean.
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
    """Intervals from the n measurements alone, without the prior, about the values found."""
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
