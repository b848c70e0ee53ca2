"""Fit of friction laws to measured forces, and selection of the best.

    F = F_law(contact) - c N,    c: resistance ratio, of rolling and of the soil that is compacted and bulldozed

Least squares from every start of a family. Confidence intervals are those of the linearised fit (Student's t, on the
scale of the search), clipped to the limits of the parameters: that of an unidentified one reaches from limit to limit.
They are valid as far as the law is: see `lack_of_fit`. A law is judged, and chosen, by its errors on data that it was
not fitted to: whole groups (slips, runs, days) are left out, because repetitions of a measurement are not independent.

A family of friction laws for a fit to measured forces has free parameters, their limits and starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
    direction_and_size,
)


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


def fit_law(data: ForceSlip, family: Family) -> LawFit:
    """The law of the family that fits best, by least squares.

    Raises:
        InputError: fewer measurements than parameters, or one that is not finite.
    """
    scale = [_Scale(f) for f in (*family.free, RESISTANCE)]
    _check(data, family, len(scale))
    search = _LawSearch(data, family, scale)
    best = search.least_squares()
    law, share = search.law(best.x)
    errors_N = search.errors_N(best.x)
    return LawFit(family.name, law, share, _intervals(scale, best), float(np.sqrt(np.mean(errors_N**2))))


def select_law(data: ForceSlip, families: Sequence[Family], groups: np.ndarray) -> LawFit:
    """Fit of the family that predicts a left-out group best; groups: (n,) labels."""
    if not families:
        raise InputError("families must hold at least one family")

    def left_out_N(family: Family) -> float:
        return float(np.sum(left_out_errors_N(data, groups, lambda seen, _: fit_law(seen, family)) ** 2))

    return fit_law(data, min(families, key=left_out_N))


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
        solve = require("scipy.optimize", "a fit of slip laws").least_squares
        return min((solve(self.errors_N, start, bounds=self.limits) for start in self.starts), key=lambda fit: fit.cost)


def _intervals(scale: Sequence[_Scale], best) -> tuple[Interval, ...]:
    """Intervals about the values found."""
    t = require("scipy.stats", "a fit of slip laws").t

    n, p = best.jac.shape
    variance = float(np.sum(best.fun**2)) / (n - p)
    half = t.ppf(0.975, n - p) * np.sqrt(variance * _inverse_diagonal(best.jac))
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
