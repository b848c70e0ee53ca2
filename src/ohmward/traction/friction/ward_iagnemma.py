"""Differentiable traction in the slip speed (Ward and Iagnemma, [T] 4.3): no division, so no singularity at rest.

F = N sign(s) [C1 (1 - e^(-C2 |s|)) + C3 |s|]

C3 < 0 gives a peak at |s| = ln(C1 C2 / -C3) / C2; beyond it the falling line would end in a force that pulls the wrong
way, so the adhesion stays at the sliding value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.checks import require_between, require_each_positive, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.trace import maximum, where
from ohmward.traction.friction.law import Contact, direction_and_size

#: C2 times the slip speed at the peak: 4.0 and 4.1 on Burckhardt's dry roads, 4.4 on wet asphalt.
SHARPNESS = 4.0


@dataclass(frozen=True)
class WardIagnemma:
    """Adhesion as a function of slip speed."""

    c1: float  #: adhesion to which the exponential rises, > 0
    c2_s_per_m: float  #: rate of it, > 0
    c3_s_per_m: float = 0.0  #: slope at high slip; < 0 for ground with a peak, and then > -c1 * c2
    #: adhesion that remains beyond the peak, from 0 to the peak; without meaning where there is no peak
    sliding: float = 0.0

    def __post_init__(self) -> None:
        require_each_positive("ward_iagnemma.", self, "c1", "c2_s_per_m")
        require_finite("ward_iagnemma.c3_s_per_m", self.c3_s_per_m)
        if self.c3_s_per_m <= -self.c1 * self.c2_s_per_m:
            raise InputError(
                f"ward_iagnemma.c3_s_per_m must be > -c1 * c2 = {-self.c1 * self.c2_s_per_m:g}, or the traction falls "
                f"from the start; got {self.c3_s_per_m:g}"
            )
        require_between("ward_iagnemma.sliding", self.sliding, 0.0, self.peak_adhesion)

    @classmethod
    def with_peak(cls, peak: float, sliding: float, slip_speed_m_s: float) -> WardIagnemma:
        """The law with this peak adhesion at this slip speed and this sliding adhesion."""
        require_positive("slip_speed_m_s", slip_speed_m_s)
        fading = math.exp(-SHARPNESS)
        c1 = peak / (1 - fading - SHARPNESS * fading)
        c2_s_per_m = SHARPNESS / slip_speed_m_s
        return cls(c1, c2_s_per_m, -c1 * c2_s_per_m * fading, sliding)

    @property
    def peak_slip_speed_m_s(self) -> float:
        """Slip speed of the largest adhesion; inf if it never falls."""
        if self.c3_s_per_m >= 0:
            return math.inf
        return math.log(self.c1 * self.c2_s_per_m / -self.c3_s_per_m) / self.c2_s_per_m

    @property
    def peak_adhesion(self) -> float:
        """The largest adhesion; inf if it never stops growing."""
        if self.c3_s_per_m >= 0:
            return math.inf if self.c3_s_per_m > 0 else self.c1
        return self.c1 + self.c3_s_per_m * (self.peak_slip_speed_m_s + 1 / self.c2_s_per_m)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        mu = adhesion(contact.slip_speed_m_s, self.c1, self.c2_s_per_m, self.c3_s_per_m)
        if self.c3_s_per_m < 0:
            direction, size = direction_and_size(contact.slip_speed_m_s)
            mu = where(size > self.peak_slip_speed_m_s, direction * maximum(direction * mu, self.sliding), mu)
        return contact.load_N * mu


def adhesion(slip_speed_m_s: Any, c1: Any, c2_s_per_m: Any, c3_s_per_m: Any = 0.0) -> Any:
    """Force over load, [T] 4.3, of the sign of the slip; the parameters may be states of a filter.

    The sign stands in the constants: traced, force and slope are then shortest.
    """
    forward = slip_speed_m_s >= 0
    fade = where(forward, -c2_s_per_m, c2_s_per_m)
    return where(forward, -c1, c1) * np.expm1(fade * slip_speed_m_s) + c3_s_per_m * slip_speed_m_s
