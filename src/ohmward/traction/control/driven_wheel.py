"""Parameters of a driven wheel: radius, inertia, load and its share of the robot's mass."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ohmward.checks import require_each_positive
from ohmward.traction.robot.robot import GRAVITY, Robot


@dataclass(frozen=True)
class DrivenWheel:
    """A wheel, its motor's rotor and its share of the robot."""

    radius_m: float  #: effective rolling radius, > 0
    inertia_kg_m2: float  #: about the axle, with the rotor as felt at the wheel, > 0
    load_N: float  #: normal load, > 0
    mass_kg: float  #: the part of the robot's mass that this wheel has to accelerate, > 0

    def __post_init__(self) -> None:
        require_each_positive("driven_wheel.", self, "radius_m", "inertia_kg_m2", "load_N", "mass_kg")


def driven_wheel(robot: Robot) -> DrivenWheel:
    """A driven wheel of the robot on level ground: mean load, equal shares of the mass."""
    n = robot.driven
    load_N = sum(robot.loads[:n, 0]) / n * robot.mass_kg * GRAVITY
    along = float(math.fsum(robot.inertia[: robot.freedoms - 1])) / (robot.freedoms - 1)
    inertia = robot.wheel.inertia_kg_m2 + robot.motor.inertia_at_wheel_kg_m2
    return DrivenWheel(robot.wheel.radius_m, inertia, float(load_N), along / n)
