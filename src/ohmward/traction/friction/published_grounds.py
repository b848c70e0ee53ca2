"""Traction that is usual on grounds: a weak prior of laws that are fitted to few slips.

The curves of Burckhardt's roads and of Wong's soils, at some slip ratios of a driven wheel, are taken as draws from one
lognormal distribution, in which roads and soils weigh the same:

    m = mean of log(F/N),   C = covariance of log(F/N) + e^2 I

A law has the departure L^-1 (log(F/N) - m), L L' = C, which is standard normal if the law is an ordinary one. So the
prior is the same for laws of all forms, whatever their parameters mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from ohmward.traction.friction.law import Contact, TractionLaw, contact
from ohmward.traction.friction.soft_ground import SoftGround, Soil
from ohmward.traction.friction.terrain import ROADS

#: Lengths K [m] of Wong's section on shear: compacted clay; firm to loose sand, taken for loams too; fresh snow.
#: Project Chrono takes 0.012 for LETE sand and 0.025 for loose sand.
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
#: Least traction over load that is told from none.
_LEAST_TRACTION = 1e-3
#: Handbooks give resistances over load from 0.01 (tyres on concrete) to 0.4 (tyres in loose sand), as far apart on a
#: logarithmic scale as they can be: mean and standard deviation of such an even spread.
_RESISTANCES = 0.01, 0.4


class UsualTraction(NamedTuple):
    """Distribution of log(F/N) at the slip ratios, at one load."""

    mean: np.ndarray  #: (K,)
    whitening: np.ndarray  #: (K, K) L^-1


def departures(law: TractionLaw, resistance_coefficient: float, typical: Contact) -> np.ndarray:
    """Departures (K + 1,) of a law and of the resistance over load from what is usual, in standard deviations.

    typical: speed of the rim and load of the wheel to compare at; the other two are not read.
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
    """Each soil with each of its lengths under each wheel."""
    return tuple(
        SoftGround(Soil(name, 1e3 * k_phi, 1e3 * k_c, n, 1e3 * cohesion, phi, K), radius_m, width_m)
        for name, k_phi, k_c, n, cohesion, phi, lengths in SOILS
        for K in lengths
        for radius_m, width_m in _WHEELS
    )


def _resistance_moments() -> tuple[float, float]:
    """Mean and standard deviation of a value whose logarithm is evenly spread between the two ends."""
    low, high = _RESISTANCES
    decades = np.log(high / low)
    mean = (high - low) / decades
    return mean, float(np.sqrt((high**2 - low**2) / (2 * decades) - mean**2))
