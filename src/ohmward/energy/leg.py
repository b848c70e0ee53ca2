"""Legs of a plan, and stretches of ground, driven or planned, as the consumption model uses them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ohmward.checks import require_between, require_each_not_negative, require_positive
from ohmward.errors import InputError
from ohmward.quantities import FASTEST_M_S

#: Steepest slope [rad] that a wheeled robot may meet: 45 degrees.
STEEPEST_RAD = math.pi / 4
#: Longest stretch [s] that a drive is cut into; its peak of power and its mean load are those of a stretch.
STRETCH_S = 180.0


class Stretch(NamedTuple):
    """A stretch of one terrain, driven or planned."""

    terrain: str  #: its name; "" where the robot only stands
    time_s: float  #: duration, stops included
    distance_m: float = 0.0  #: along the ground, >= 0, forward or backward
    speed_distance_m2_s: float = 0.0  #: integral of speed over distance; speed times distance at constant speed
    #: height gained and height lost, both >= 0
    climb_m: float = 0.0
    descent_m: float = 0.0
    payload_kg: float = 0.0  #: on top of the robot's mass
    kinetic_m2_s2: float = 0.0  #: kinetic energy gained per kg: half the last speed squared minus half the first
    standing_s: float = 0.0  #: part of `time_s` spent standing, in stops that are not a stretch of their own
    task_J: float = 0.0  #: energy of planned tasks beside driving: a tool, an arm


#: Fields that double when a stretch is twice as long.
_MEASURES = tuple(name for name in Stretch._fields if name not in ("terrain", "payload_kg"))


@dataclass(frozen=True)
class Leg:
    """One leg of a plan, driven at constant speed.

    >>> ow.Leg(distance_m=120.0, terrain="grass", speed_m_s=0.5, grade_rad=0.05, stop_s=20.0).distance_m
    120.0
    """

    distance_m: float  #: length, >= 0; 0 with `stop_s` is a stop
    terrain: str  #: name of the terrain, as in the consumption table
    speed_m_s: float  #: constant speed, > 0, at most 50
    grade_rad: float = 0.0  #: mean slope, > 0 uphill
    stop_s: float = 0.0  #: standing time at the end of the leg
    payload_kg: float = 0.0  #: in addition to the robot's mass
    task_J: float = 0.0  #: energy from the battery of tasks on the way: a tool, an arm; 1 Wh is 3600 J

    def __post_init__(self) -> None:
        if not self.terrain:
            raise InputError("leg.terrain must be a name, got an empty text")
        require_positive("leg.speed_m_s", self.speed_m_s)
        require_between("leg.speed_m_s", self.speed_m_s, 0.0, FASTEST_M_S)
        require_between("leg.grade_rad", self.grade_rad, -STEEPEST_RAD, STEEPEST_RAD)
        require_each_not_negative("leg.", self, "distance_m", "stop_s", "payload_kg", "task_J")


def stretch_of(leg: Leg) -> Stretch:
    """The stretch of a planned leg."""
    rise_m = leg.distance_m * math.sin(leg.grade_rad)
    return Stretch(
        leg.terrain,
        leg.distance_m / leg.speed_m_s + leg.stop_s,
        leg.distance_m,
        leg.distance_m * leg.speed_m_s,
        max(rise_m, 0.0),
        max(-rise_m, 0.0),
        leg.payload_kg,
        standing_s=leg.stop_s,
        task_J=leg.task_J,
    )


def part_of(stretch: Stretch, share: float) -> Stretch:
    """A share of a stretch, by distance and time alike."""
    scaled = {name: share * getattr(stretch, name) for name in _MEASURES}
    return stretch._replace(**scaled)


def joined(first: Stretch, second: Stretch) -> Stretch:
    """Join two stretches with the same terrain and payload."""
    sums = {name: getattr(first, name) + getattr(second, name) for name in _MEASURES}
    return first._replace(**sums)


def way_back(stretch: Stretch) -> Stretch:
    """The same stretch in the opposite direction, without its tasks, which are done by then."""
    back = stretch._replace(climb_m=stretch.descent_m, descent_m=stretch.climb_m, kinetic_m2_s2=-stretch.kinetic_m2_s2)
    return back._replace(task_J=0.0)


def total_distance_m(stretches: Sequence[Stretch]) -> float:
    """Length [m] of all stretches together."""
    return sum(s.distance_m for s in stretches)


def total_time_s(stretches: Sequence[Stretch]) -> float:
    """Time [s] of all stretches together."""
    return sum(s.time_s for s in stretches)
