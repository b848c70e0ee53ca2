"""Several grounds as one law, so that one compiled step serves a wheel wherever it stands.

F = sum_k w_k F_k,   w_k the share of the contact that lies on ground k
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
class Mosaic:
    """The mean of laws of traction, or of rolling resistance, by their shares.

    Attributes:
        laws: (K,) each.
        shares: (K,) adding up to 1; may be traced.
    """

    laws: tuple[Any, ...]
    shares: np.ndarray


class MosaicTraction(Mosaic):
    """A law of traction."""

    laws: tuple[TractionLaw, ...]

    def force_N(self, contact: Contact) -> Any:
        """Force [N] of the ground on the wheel."""
        return sum(w * law.force_N(contact) for w, law in zip(self.shares, self.laws, strict=True))


class MosaicRolling(Mosaic):
    """A law of rolling resistance."""

    laws: tuple[RollingLaw, ...]

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        return sum(w * law.force_N(travel_speed_m_s, load_N) for w, law in zip(self.shares, self.laws, strict=True))


def terrain_mixture(terrains: Sequence[Terrain], shares: np.ndarray) -> Terrain:
    """The ground of which `terrains` have these shares (K,); a law that they have in common is taken once."""
    first = terrains[0]
    traction, rolling = [t.traction for t in terrains], [t.rolling for t in terrains]
    return Terrain(
        "terrain_mixture",
        first.traction if _all_alike(traction) else MosaicTraction(tuple(traction), shares),
        first.rolling if _all_alike(rolling) else MosaicRolling(tuple(rolling), shares),
        "scenario",
    )


def _all_alike(laws: Sequence[Any]) -> bool:
    return all(law == laws[0] for law in laws)
