"""Families of friction laws for a fit to measured forces: free parameters, their limits and starts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_finite
from ohmward.errors import InputError
from ohmward.traction.friction.brush import Brush
from ohmward.traction.friction.burckhardt import Burckhardt
from ohmward.traction.friction.coulomb_creep import CoulombCreep
from ohmward.traction.friction.law import SPEED_FLOOR, TractionLaw
from ohmward.traction.friction.soft_ground import SoftGround, Soil
from ohmward.traction.friction.ward_iagnemma import WardIagnemma


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
#: Share of the load that a free wheel takes to pull; soil in front of a locked wheel weighs more than the wheel.
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
    """Adhesion and stiffness k for this length of the patch: without lead the force shows no more than k l^2."""

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
