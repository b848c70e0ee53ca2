"""Grounds by name: tables of adhesion, each with its source, the laws made from them, and rolling resistance.

The resistance acts on the body at the contact; the moment that belongs to it cancels it in the wheel's equation. (With
the force in the wheel's equation, as in [T] (4.18)-(4.19), a rolling wheel would create energy.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.traction.friction.law import (
    Burckhardt,
    SoftGround,
    Soil,
    TractionLaw,
    WardIagnemma,
    adhesion,
    direction_and_size,
)


class RollingLaw(Protocol):
    """A law of rolling resistance: against the motion, zero at rest, continuous."""

    def force_N(self, travel_speed_m_s: Any, load_N: Any) -> Any:
        """Force [N] of the ground on the body along x."""
        ...


@dataclass(frozen=True)
class RollingResistance:
    """Rolling resistance on hard ground ([T] 4.5); the values are the published ones of Ward and Iagnemma.

    F_rr = -sign(v) N (A1 (1 - e^(-A2 |v|)) + A3 |v|), the form of their traction.
    """

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


#: Slip speed [m/s] at which hard floors of table 4.1 are given their peak: slip ratio 0.2 at 0.5 m/s. An assumption:
#: the table has no slip.
PEAK_SLIP_SPEED = 0.1


class Terrain(NamedTuple):
    """A ground: its friction law, its rolling resistance, and the source of the numbers."""

    name: str
    traction: TractionLaw
    rolling: RollingLaw
    source: str


class _Wheel(Protocol):
    """Dimensions of a wheel that a soil needs."""

    @property
    def radius_m(self) -> float: ...
    @property
    def width_m(self) -> float: ...


class Adhesion(NamedTuple):
    """Least and largest published coefficient, at the peak and sliding."""

    peak: tuple[float, float]
    sliding: tuple[float, float]


#: Ground that is assumed where none is given.
DEFAULT_TERRAIN = "dry asphalt"

#: [T] table 4.1.
ADHESION: Mapping[str, Adhesion] = {
    "dry asphalt": Adhesion((0.8, 0.9), (0.75, 0.75)),
    "wet asphalt": Adhesion((0.5, 0.7), (0.45, 0.6)),
    "gravel": Adhesion((0.6, 0.6), (0.55, 0.55)),
    "ice": Adhesion((0.1, 0.1), (0.07, 0.07)),
}

#: Burckhardt's roads for car tyres, as copied in many public sources.
ROADS: Mapping[str, Burckhardt] = {
    "dry asphalt road": Burckhardt(1.2801, 23.99, 0.52),
    "wet asphalt road": Burckhardt(0.857, 33.822, 0.347),
    "dry concrete road": Burckhardt(1.1973, 25.168, 0.5373),
    "dry cobbles road": Burckhardt(1.3713, 6.4565, 0.6691),
    "wet cobbles road": Burckhardt(0.4004, 33.708, 0.1204),
    "snow road": Burckhardt(0.1946, 94.129, 0.0646),
    "ice road": Burckhardt(0.05, 306.39, 0.0),
}

#: Parameters of the deformable terrains (SCM) in the public demonstrations of Project Chrono.
SOILS: Mapping[str, Soil] = {
    "soft soil": Soil("soft soil", 0.2e6, 0.0, 1.1, 0.0, 30.0, 0.01),
    "firm soil": Soil("firm soil (Viper)", 2e6, 0.0, 1.1, 0.0, 30.0, 0.01),
    "regolith": Soil("regolith (Curiosity)", 0.82e6, 1.4e3, 1.0, 170.0, 35.0, 0.0178),
    "LETE sand": Soil("LETE sand", 5301e3, 102e3, 0.793, 1.3e3, 31.1, 0.012),
}


def hard_terrain(name: str, rolling: RollingLaw | None = None) -> Terrain:
    """A hard ground by name, from table 4.1 (middle of its ranges) or Burckhardt's roads."""
    rolling = rolling or RollingResistance()
    if name in ROADS:
        return Terrain(name, ROADS[name], rolling, "Burckhardt; resistance: Ward and Iagnemma")
    if name in ADHESION:
        peak, sliding = (sum(pair) / 2 for pair in ADHESION[name])
        law = WardIagnemma.with_peak(peak, sliding, PEAK_SLIP_SPEED)
        return Terrain(name, law, rolling, "[T] table 4.1; resistance: Ward and Iagnemma")
    raise _unknown(name, [*ADHESION, *ROADS])


def soft_terrain(name: str, radius_m: float, width_m: float) -> Terrain:
    """A soil by name, under wheels of this size."""
    if name not in SOILS:
        raise _unknown(name, list(SOILS))
    ground = SoftGround(SOILS[name], radius_m, width_m)
    return Terrain(name, ground, CompactionResistance(ground), "Project Chrono, SCM demonstrations")


def terrain_named(name: str, wheel: _Wheel) -> Terrain:
    """A ground by name, hard or soft, under wheels of this size.

    Raises:
        InputError: an unknown name; lists all.
    """
    if name in SOILS:
        return soft_terrain(name, wheel.radius_m, wheel.width_m)
    if name in ADHESION or name in ROADS:
        return hard_terrain(name)
    raise _unknown(name, [*ADHESION, *ROADS, *SOILS])


def _unknown(name: Any, known: list[str]) -> InputError:
    return InputError(f"terrain must be one of {', '.join(known)}; got {name!r}")
