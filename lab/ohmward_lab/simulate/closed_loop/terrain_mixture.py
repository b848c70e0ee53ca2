"""Several terrains as one, weighted by their shares, so that one compiled step serves a wheel on any ground.

F = sum_k w_k F_k,   w_k the share of the contact that lies on terrain k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ohmward.traction.friction.law import Contact, TractionLaw
from ohmward.traction.friction.rolling import RollingLaw
from ohmward.traction.friction.terrain import Terrain


@dataclass(frozen=True)
class MixedTraction:
    """Weighted mean of traction laws."""

    laws: tuple[TractionLaw, ...]  #: (K,) of them
    shares: np.ndarray  #: (K,) weights, adding up to 1; may be traced

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        return sum(w * law.force_N(contact) for w, law in zip(self.shares, self.laws, strict=True))


@dataclass(frozen=True)
class MixedRolling:
    """Weighted mean of laws of rolling resistance; attributes as of `MixedTraction`."""

    laws: tuple[RollingLaw, ...]
    shares: np.ndarray

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        return sum(w * law.force_N(travel_speed_m_s, load_N) for w, law in zip(self.shares, self.laws, strict=True))


def terrain_mixture(terrains: Sequence[Terrain], shares: np.ndarray) -> Terrain:
    """Mixture of terrains with these shares (K,); a law that they have in common is evaluated once."""
    traction = [t.traction for t in terrains]
    rolling = [t.rolling for t in terrains]
    return Terrain(
        "terrain_mixture",
        traction[0] if _all_equal(traction) else MixedTraction(tuple(traction), shares),
        rolling[0] if _all_equal(rolling) else MixedRolling(tuple(rolling), shares),
        "scenario",
    )


def _all_equal(laws: Sequence[Any]) -> bool:
    return all(law == laws[0] for law in laws)
