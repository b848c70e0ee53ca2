"""Burckhardt's law: adhesion as a function of the slip ratio alone, as measured on roads.

mu = c1 (1 - e^(-c2 lambda)) - c3 lambda,  lambda = |s| / max(|r omega|, |v|) in [0, 1]
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.checks import require_between, require_each_positive, require_positive
from ohmward.errors import InputError
from ohmward.trace import minimum
from ohmward.traction.friction.law import SPEED_FLOOR, Contact, bounded_slip_ratio, direction_and_size
from ohmward.traction.friction.ward_iagnemma import WardIagnemma


@dataclass(frozen=True)
class Burckhardt:
    """Adhesion as a function of the slip ratio; beyond 1 (rim and travel opposed) it stays what it is at 1."""

    c1: float  #: adhesion to which the exponential rises, > 0
    c2: float  #: rate of it, > 0
    c3: float  #: adhesion that a sliding wheel has lost, >= 0, with the adhesion at slip ratio 1 not below 0
    speed_floor_m_s: float = SPEED_FLOOR  #: below this speed the slip ratio is taken against it, > 0

    def __post_init__(self) -> None:
        require_each_positive("burckhardt.", self, "c1", "c2", "speed_floor_m_s")
        require_between("burckhardt.c3", self.c3, 0.0, math.inf)
        if self.sliding < 0:
            raise InputError(
                f"burckhardt.c3 must be at most c1 (1 - exp(-c2)) = {self.sliding + self.c3:g}, or a sliding wheel is "
                f"pushed; got {self.c3:g}"
            )

    @property
    def peak_slip_ratio(self) -> float:
        """Slip ratio of the largest adhesion, in [0, 1]."""
        return 1.0 if self.c3 == 0 else min(1.0, math.log(self.c1 * self.c2 / self.c3) / self.c2)

    @property
    def peak_adhesion(self) -> float:
        """The largest adhesion."""
        return self._adhesion(self.peak_slip_ratio)

    @property
    def sliding(self) -> float:
        """Adhesion at slip ratio 1: a locked wheel, or one that spins on the spot."""
        return self._adhesion(1.0)

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        direction, size = direction_and_size(bounded_slip_ratio(contact, self.speed_floor_m_s))
        return contact.load_N * direction * self._adhesion(minimum(size, 1.0))

    def at_speed(self, speed_m_s: float) -> WardIagnemma:
        """The same law at one speed max(|r omega|, |v|), in the slip speed: C1 = c1, C2 = c2/V, C3 = -c3/V."""
        require_positive("speed_m_s", speed_m_s)
        return WardIagnemma(self.c1, self.c2 / speed_m_s, -self.c3 / speed_m_s, self.sliding)

    def _adhesion(self, slip_ratio: Any) -> Any:
        return -self.c1 * np.expm1(-self.c2 * slip_ratio) - self.c3 * slip_ratio
