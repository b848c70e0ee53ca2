"""A rigid wheel on soil: Bekker's sinkage, the shear of Janosi and Hanamoto (Wong, Theory of Ground Vehicles, ch. 2).

    pressure under a plate       p = (k_c/b + k_phi) z^n
    sinkage of a wheel           z_0 = [3 W / ((3 - n) (k_c + b k_phi) sqrt(D))]^(2/(2n + 1))
    compaction resistance        R_c = (k_c + b k_phi) z_0^(n + 1) / (n + 1)
    contact length               l = sqrt(z_0 (D - z_0))
    traction                     F = (b l c + W tan phi) [1 - K/(i l) (1 - e^(-i l/K))],  i = s / |r omega|

The pressure is taken as even along the contact. A spinning wheel digs in deeper (slip sinkage); that is not here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_each_not_negative, require_each_positive
from ohmward.errors import InputError
from ohmward.trace import exp, maximum, minimum, where
from ohmward.traction.friction.law import SPEED_FLOOR, Contact, creepage, direction_and_size

_LEAST_LOAD_N = 1e-6
_SERIES_BELOW = 1e-3


@dataclass(frozen=True)
class Soil:
    """Properties of a soil."""

    name: str  #: in words
    frictional_modulus: float  #: k_phi [N/m^(n + 2)], > 0
    cohesive_modulus: float  #: k_c [N/m^(n + 1)], >= 0
    exponent: float  #: n, in (0, 3)
    cohesion_Pa: float  #: c, >= 0
    friction_deg: float  #: phi, in (0, 60]
    shear_length_m: float  #: K, > 0

    def __post_init__(self) -> None:
        require_each_positive("soil.", self, "frictional_modulus", "exponent", "friction_deg", "shear_length_m")
        require_each_not_negative("soil.", self, "cohesive_modulus", "cohesion_Pa")
        require_between("soil.friction_deg", self.friction_deg, 0.0, 60.0)
        if self.exponent >= 3:
            raise InputError(f"soil.exponent must be < 3 for Bekker's wheel, got {self.exponent:g}")


class Footprint(NamedTuple):
    """Sinkage [m] and length [m] of the contact of a wheel under a load."""

    sinkage_m: Any
    length_m: Any


@dataclass(frozen=True)
class SoftGround:
    """Soil under one size of wheel."""

    soil: Soil  #: what is rolled on
    #: of the wheel, > 0
    radius_m: float
    width_m: float
    speed_floor_m_s: float = SPEED_FLOOR  #: below this rim speed the creepage is taken against it, > 0

    def __post_init__(self) -> None:
        require_each_positive("soft_ground.", self, "radius_m", "width_m", "speed_floor_m_s")

    def footprint(self, load_N: Any) -> Footprint:
        """Sinkage, at most the radius, and length of the contact."""
        n, diameter_m = self.soil.exponent, 2 * self.radius_m
        weight = 3 * maximum(load_N, _LEAST_LOAD_N) / ((3 - n) * self._modulus * math.sqrt(diameter_m))
        sinkage_m = minimum(weight ** (2 / (2 * n + 1)), self.radius_m)
        return Footprint(sinkage_m, (sinkage_m * (diameter_m - sinkage_m)) ** 0.5)

    def compaction_N(self, load_N: Any) -> Any:
        """Force [N] that it takes to press the rut."""
        n = self.soil.exponent
        return self._modulus * self.footprint(load_N).sinkage_m ** (n + 1) / (n + 1)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel, without the compaction resistance."""
        direction, i = direction_and_size(creepage(contact, self.speed_floor_m_s))
        length_m = self.footprint(contact.load_N).length_m
        cohesive_N = self.width_m * length_m * self.soil.cohesion_Pa
        strongest_N = cohesive_N + contact.load_N * math.tan(math.radians(self.soil.friction_deg))
        return direction * strongest_N * mean_shear(i * length_m / self.soil.shear_length_m)

    @property
    def _modulus(self) -> float:
        return self.soil.cohesive_modulus + self.width_m * self.soil.frictional_modulus


def mean_shear(x: Any) -> Any:
    """1 - (1 - e^(-x))/x for x >= 0: mean of 1 - e^(-j/K) while the shear j grows evenly from 0 to x K."""
    series = x * (1 / 2 - x * (1 / 6 - x / 24))
    safe = maximum(x, _SERIES_BELOW)
    return where(x < _SERIES_BELOW, series, 1 - (1 - exp(-safe)) / safe)
