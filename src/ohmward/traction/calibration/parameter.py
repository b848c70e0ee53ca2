"""A calibrated parameter with its uncertainty, or the reason why the drives do not tell it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from ohmward.traction.robot.robot import Robot


class Parameter(NamedTuple):
    """A number of the robot file.

    name: its path in the robot, with its unit: "motor.friction_Nm".
    value: as calibrated, or the robot's own where it was not.
    std: standard deviation of that.
    reason: cause why it could not be identified; empty where it was.
    """

    name: str
    value: float
    std: float
    reason: str = ""

    @property
    def identified(self) -> bool:
        """True where the drives tell it."""
        return not self.reason


def with_parameters(robot: Robot, parameters: Iterable[Parameter]) -> Robot:
    """The robot with those numbers that were identified."""
    for p in parameters:
        if p.identified:
            part, _, name = p.name.partition(".")
            changed: Any = replace(getattr(robot, part), **{name: p.value})
            robot = replace(robot, **{part: changed})
    return robot
