"""Ground of a simulation: patches of terrain along x or over time, and a profile of the grade."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.traction.friction.law import CoulombCreep
from ohmward.traction.friction.terrain import (
    ADHESION,
    DEFAULT_TERRAIN,
    ROADS,
    SOILS,
    RollingResistance,
    Terrain,
    hard_terrain,
    soft_terrain,
)
from ohmward.traction.robot.robot import Robot

#: Steepest grade of a simulation: 40 degrees, beyond which a wheeled robot slides.
STEEPEST_GRADE_RAD = 0.7
#: Largest adhesion of a simulation, above that of any tyre.
ROUGHEST = 3.0
#: Rubber on a hard floor, as in `mujoco_plant`.
SLIP_STIFFNESS_S_PER_M = 6.25
_EDGES = ("from_m", "to_m", "from_s", "to_s")


@dataclass(frozen=True)
class Patch:
    """A piece of ground: a terrain by name, or a friction that builds up with slip speed (`CoulombCreep`).

    Raises:
        InputError: a value out of its range, both terrain and friction, an unknown terrain, edges that do not ascend.
    """

    terrain: str | None = None  #: a name; "dry asphalt" where no friction is given either
    friction: float | None = None  #: adhesion, in (0, 3]
    #: with friction: adhesion per slip speed while a wheel grips, > 0
    slip_stiffness_s_per_m: float = SLIP_STIFFNESS_S_PER_M
    rolling: float | None = None  #: rolling resistance over load, in place of the terrain's, >= 0
    #: range along x, from_m included; without an end where None
    from_m: float | None = None
    to_m: float | None = None
    #: range in time, likewise
    from_s: float | None = None
    to_s: float | None = None
    wheels: tuple[str, ...] = ()  #: names of the wheels on it; all where empty

    def __post_init__(self) -> None:
        if self.terrain is not None and self.friction is not None:
            raise InputError("ground: give terrain or friction, not both; remove one of them")
        if self.friction is not None and not 0 < self.friction <= ROUGHEST:
            raise InputError(f"ground.friction must be > 0 and at most {ROUGHEST:g}, got {self.friction:g}")
        if self.friction is None and self.name not in {*ADHESION, *ROADS, *SOILS}:
            known = ", ".join([*ADHESION, *ROADS, *SOILS])
            raise InputError(f"ground.terrain must be one of {known}; got {self.terrain!r}; or give friction")
        require_positive("ground.slip_stiffness_s_per_m", self.slip_stiffness_s_per_m)
        if self.rolling is not None:
            require_between("ground.rolling", self.rolling, 0.0, 1.0)
        self._check_edges()

    @property
    def name(self) -> str:
        """Name of the terrain, or its friction."""
        return f"friction {self.friction:g}" if self.friction is not None else self.terrain or DEFAULT_TERRAIN

    @cached_property
    def bounded(self) -> bool:
        """True where it has an edge; a patch without one lies under all others."""
        return any(getattr(self, edge) is not None for edge in _EDGES) or bool(self.wheels)

    @property
    def span_m(self) -> tuple[float, float]:
        """Range along x [m]."""
        return -math.inf if self.from_m is None else self.from_m, math.inf if self.to_m is None else self.to_m

    @property
    def span_s(self) -> tuple[float, float]:
        """Range in time [s]."""
        return -math.inf if self.from_s is None else self.from_s, math.inf if self.to_s is None else self.to_s

    def covers(self, wheel: str, x_m: float, time_s: float) -> bool:
        """True where it is under this wheel now."""
        from_m, to_m = self.span_m
        from_s, to_s = self.span_s
        return from_m <= x_m < to_m and from_s <= time_s < to_s and (not self.wheels or wheel in self.wheels)

    def ground(self, robot: Robot) -> Terrain:
        """The terrain under this robot's wheels."""
        resistance = None if self.rolling is None else RollingResistance(a1=self.rolling, a3_s_per_m=0.0)
        if self.friction is not None:
            law = CoulombCreep(self.friction, self.slip_stiffness_s_per_m)
            return Terrain(self.name, law, resistance or RollingResistance(a3_s_per_m=0.0), "scenario")
        if self.name in SOILS:
            soil = soft_terrain(self.name, robot.wheel.radius_m, robot.wheel.width_m)
            return soil._replace(rolling=resistance or soil.rolling)
        return hard_terrain(self.name, resistance)

    def _check_edges(self) -> None:
        for low, high in (("from_m", "to_m"), ("from_s", "to_s")):
            ends = [end for end in (getattr(self, low), getattr(self, high)) if end is not None]
            require_finite(f"ground.{low}, {high}", ends)
            if len(ends) == 2 and not ends[0] < ends[1]:
                raise InputError(f"ground.{low} must be below {high}, got {ends[0]:g} and {ends[1]:g}; exchange them")


@dataclass(frozen=True)
class Grade:
    """Slope of the ground along x: linear between the points, constant beyond both ends."""

    position_m: tuple[float, ...] = (0.0,)  #: (K,) [m], increasing
    grade_rad: tuple[float, ...] = (0.0,)  #: (K,) > 0 where x leads uphill, within +-0.7

    def __post_init__(self) -> None:
        require_finite("grade.position_m", self.position_m)
        require_between("grade.grade_rad", self.grade_rad, -STEEPEST_GRADE_RAD, STEEPEST_GRADE_RAD)
        if not self.position_m or len(self.position_m) != len(self.grade_rad):
            raise InputError(
                "grade.position_m and grade.grade_rad must be equally long and not empty, got "
                f"{len(self.position_m)} and {len(self.grade_rad)} values"
            )
        if any(b <= a for a, b in pairwise(self.position_m)):
            raise InputError(f"grade.position_m must increase, got {list(self.position_m)}; sort the points")

    def at(self, x_m: float) -> float:
        """The slope [rad] at this place."""
        return float(np.interp(x_m, self.position_m, self.grade_rad))


class GroundSurface(NamedTuple):
    """All patches under a robot."""

    patches: tuple[Patch, ...]  #: the one that lies under all others last
    wheels: tuple[str, ...]  #: names of the robot's wheels

    def under(self, x_m: Sequence[float], time_s: float) -> tuple[int, ...]:
        """Number of the patch under each wheel, whose places along x are (wheels,)."""
        if len(self.patches) == 1:
            return (0,) * len(self.wheels)
        return tuple(
            next(k for k, patch in enumerate(self.patches) if not patch.bounded or patch.covers(wheel, x, time_s))
            for wheel, x in zip(self.wheels, x_m, strict=True)
        )


def surface(patches: Sequence[Patch], wheels: Sequence[str]) -> GroundSurface:
    """The patches in order, the one without an edge last: dry asphalt where none is given.

    Raises:
        InputError: two patches at one place and time, two without an edge, a wheel that the robot does not have.
    """
    bounded = [p for p in patches if p.bounded]
    base = [p for p in patches if not p.bounded]
    if len(base) > 1:
        raise InputError(
            f"ground: {len(base)} patches have no edge; only one can lie under all others, give the others from_m, "
            "to_m, from_s or to_s"
        )
    for patch in bounded:
        if unknown := set(patch.wheels) - set(wheels):
            raise InputError(f"ground.wheels must be out of {', '.join(wheels)}; got {', '.join(sorted(unknown))}")
    for k, patch in enumerate(bounded):
        for other in bounded[:k]:
            _refuse_overlap(other, patch)
    return GroundSurface((*bounded, *(base or [Patch()])), tuple(wheels))


def adhesion(terrain: Terrain) -> float:
    """Largest traction of a terrain over the load; nan where its law has no such number."""
    law: Any = terrain.traction
    return float(getattr(law, "adhesion", getattr(law, "peak_adhesion", math.nan)))


def _refuse_overlap(a: Patch, b: Patch) -> None:
    apart = bool(a.wheels) and bool(b.wheels) and not set(a.wheels) & set(b.wheels)
    if not apart and _meet(a.span_m, b.span_m) and _meet(a.span_s, b.span_s):
        where = [f"{p.name} ({_span(p)})" for p in (a, b)]
        raise InputError(f"ground: patches overlap: {where[0]} and {where[1]}; end one where the other begins")


def _meet(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] < b[1] and b[0] < a[1]


def _span(p: Patch) -> str:
    edges = [f"{edge} = {getattr(p, edge):g}" for edge in _EDGES if getattr(p, edge) is not None]
    return ", ".join(edges) or f"wheels = {list(p.wheels)}"
