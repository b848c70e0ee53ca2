"""Brush theory (Wong): the tread is a row of bristles that shear through the patch until they slide.

With load W, patch length l, stiffness k of the tread, deformation lambda_a ahead of the patch (a length, not the slip),
K' = k l lambda_a and the creepage i = s / |r omega|:

    i <= i_c = mu W / (l k (l + lambda_a))   all bristles stick      F = k i (l lambda_a + l^2/2)
    i_c < i < mu W / K'                      the rear ones slide     F = mu W - lambda_a (mu W - K' i)^2 / (2 l K' i)
    mu W / K' <= i                           all slide               F = mu W

lambda_a / K' = 1 / (k l), so the second line holds at lambda_a = 0 too, where nothing but an infinite creepage makes
all bristles slide. Braking with the skid i_s is the same with i = i_s / (1 - i_s); [T] (4.2) mixes the cases
lambda_a = 0 and > 0 and lacks the third line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ohmward.checks import require_between, require_each_positive
from ohmward.trace import maximum, where
from ohmward.traction.friction.law import SPEED_FLOOR, Contact, creepage, direction_and_size

_LEAST_SLIP = 1e-12


@dataclass(frozen=True)
class Brush:
    """A tyre with uniform pressure on its patch; it has one coefficient of friction and so no falling branch."""

    adhesion: float  #: mu, of a bristle on the ground, > 0
    patch_length_m: float  #: l, > 0
    tread_stiffness_N_per_m2: float  #: k, force on a metre of patch for a metre of deformation, > 0
    lead_length_m: float = 0.0  #: lambda_a, >= 0
    speed_floor_m_s: float = SPEED_FLOOR  #: below this rim speed the creepage is taken against it, > 0

    def __post_init__(self) -> None:
        require_each_positive(
            "brush.", self, "adhesion", "patch_length_m", "tread_stiffness_N_per_m2", "speed_floor_m_s"
        )
        require_between("brush.lead_length_m", self.lead_length_m, 0.0, math.inf)

    @property
    def slip_stiffness_N(self) -> float:
        """Slope of the force at no slip, C_i = k l^2/2 without lead [N per unit of creepage]."""
        l, lead = self.patch_length_m, self.lead_length_m  # noqa: E741
        return self.tread_stiffness_N_per_m2 * (l * lead + l * l / 2)

    def critical_creepage(self, load_N: Any) -> Any:
        """i_c, at which the last bristle begins to slide."""
        l, lead = self.patch_length_m, self.lead_length_m  # noqa: E741
        return self.adhesion * load_N / (l * self.tread_stiffness_N_per_m2 * (l + lead))

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        direction, i = direction_and_size(creepage(contact, self.speed_floor_m_s))
        l, k = self.patch_length_m, self.tread_stiffness_N_per_m2  # noqa: E741
        full = self.adhesion * contact.load_N
        i_c = self.critical_creepage(contact.load_N)
        short = maximum(full - k * l * self.lead_length_m * i, 0.0)
        sliding = full - short * short / (2 * k * l * l * maximum(maximum(i, i_c), _LEAST_SLIP))
        return direction * where(i <= i_c, self.slip_stiffness_N * i, sliding)
