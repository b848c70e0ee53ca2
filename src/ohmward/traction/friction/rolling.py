"""Resistance of a wheel that rolls: on hard ground ([T] 4.5), and on soil that it compacts.

F_rr = -sign(v) N (A1 (1 - e^(-A2 |v|)) + A3 |v|), the form of Ward and Iagnemma's traction.

The force acts on the body at the contact; the moment that belongs to it cancels it in the wheel's equation. (With the
force in the wheel's equation, as in [T] (4.18)-(4.19), a rolling wheel would create energy.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.traction.friction.law import direction_and_size
from ohmward.traction.friction.soft_ground import SoftGround
from ohmward.traction.friction.ward_iagnemma import adhesion


class RollingLaw(Protocol):
    """A law of rolling resistance: against the motion, zero at rest, continuous."""

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        ...


@dataclass(frozen=True)
class RollingResistance:
    """Rolling resistance on hard ground; the values are the published ones of Ward and Iagnemma."""

    a1: float = 0.0075  #: share of the load, >= 0
    a2_s_per_m: float = 50.0  #: rate at which it sets in with speed, > 0
    a3_s_per_m: float = 0.02  #: growth with speed, >= 0

    def __post_init__(self) -> None:
        require_between("rolling.a1", self.a1, 0.0, math.inf)
        require_positive("rolling.a2_s_per_m", self.a2_s_per_m)
        require_between("rolling.a3_s_per_m", self.a3_s_per_m, 0.0, math.inf)

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        return -load_N * adhesion(travel_speed_m_s, self.a1, self.a2_s_per_m, self.a3_s_per_m)


@dataclass(frozen=True)
class CompactionResistance:
    """Force that presses a rut into soil; it sets in with speed like rolling resistance."""

    ground: SoftGround  #: soil and wheel
    a2_s_per_m: float = 50.0  #: rate at which it sets in with speed, > 0

    def __post_init__(self) -> None:
        require_positive("compaction.a2_s_per_m", self.a2_s_per_m)

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        direction, speed = direction_and_size(travel_speed_m_s)
        return direction * self.ground.compaction_N(load_N) * np.expm1(-self.a2_s_per_m * speed)
