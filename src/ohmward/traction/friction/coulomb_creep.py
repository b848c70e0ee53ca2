"""Coulomb friction with viscous creep: the family of rigid-body simulators (MuJoCo's `solreffriction`).

F = N clip(c s, -mu, mu)

In adhesion the slip speed is proportional to the force; the ground gives mu N at most, and has no peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ohmward.checks import require_each_positive
from ohmward.trace import clip
from ohmward.traction.friction.law import Contact


@dataclass(frozen=True)
class CoulombCreep:
    """Adhesion as a function of slip speed."""

    adhesion: float  #: mu, > 0
    slope_s_per_m: float  #: c, adhesion per slip speed while the wheel grips, > 0

    def __post_init__(self) -> None:
        require_each_positive("coulomb_creep.", self, "adhesion", "slope_s_per_m")

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        return contact.load_N * clip(self.slope_s_per_m * contact.slip_speed_m_s, -self.adhesion, self.adhesion)
