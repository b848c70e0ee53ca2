"""State vector of the speed observer.

    v, (v_left,) yaw_rate, omega_1 ... omega_n      of the robot, `Robot.state_names`
    log_friction                                    of the largest traction over the terrain's
    log_stiffness                                   of the slope of traction over slip, over the terrain's
    grade_rad                                       of the ground, with every other disturbance that acts like a slope
    rolling_excess                                  rolling resistance over the terrain's, less one
    radius_ratio                                    effective radius of the wheels over the robot's

Ratios of the ground are logarithms: they stay positive, and their sigma is relative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import clip
from ohmward.traction.robot.robot import Robot

#: Bounds of the mean of a state: nothing real lies beyond, whatever a filter makes of its measurements. Ground gives
#: between a hundredth and a hundred times the assumed value (wet ice to rubber is 30 times), rolling resistance never
#: pushes, a slope of 0.5 rad is beyond what wheels climb, no tyre has half or twice its size. Sigma points may lie
#: beyond: otherwise the mean over them would be biased.
BOUNDS: dict[str, tuple[float, float]] = {
    "log_friction": (-math.log(100.0), math.log(100.0)),
    "log_stiffness": (-math.log(100.0), math.log(100.0)),
    "grade_rad": (-0.5, 0.5),
    "rolling_excess": (-1.0, 100.0),
    "radius_ratio": (0.5, 2.0),
}


@dataclass(frozen=True)
class States:
    """Optional states."""

    friction: bool = True  #: the largest traction, of all driven wheels alike, is a state; without it, it is known
    stiffness: bool = True  #: the slope of traction over slip is a state
    grade: bool = True  #: the slope of the ground is a state; without it, it is the measured pitch, or level
    rolling: bool = True  #: the rolling resistance is a state
    radius: bool = True  #: the effective radius is a state


#: The four states of [T] 4.5 on a robot with two driven wheels: the ground is known.
KNOWN_GROUND = States(friction=False, stiffness=False, grade=False, rolling=False, radius=False)


class Parts(NamedTuple):
    """Parts of the state vector; a quantity that is not a state has the value that the model assumes."""

    motion: np.ndarray  #: (freedoms,) of the body
    omega: np.ndarray  #: (driven,) [rad/s]
    #: over the terrain's, friction (driven,)
    friction: np.ndarray
    stiffness: Any
    grade_rad: Any  #: > 0 uphill; None where it is not a state
    rolling_ratio: Any  #: rolling resistance over the terrain's
    radius_ratio: Any  #: as its state


@dataclass(frozen=True)
class StateLayout:
    """Order of the state vector of a robot with these states."""

    robot: Robot
    states: States

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the elements, in order."""
        optional = {
            "log_friction": self.states.friction,
            "log_stiffness": self.states.stiffness,
            "grade_rad": self.states.grade,
            "rolling_excess": self.states.rolling,
            "radius_ratio": self.states.radius,
        }
        return (*self.robot.state_names, *(name for name, there in optional.items() if there))

    @property
    def robot_states(self) -> int:
        """Number of the robot's own states, which stand first."""
        return self.robot.freedoms + self.robot.driven

    def index(self, name: str) -> int:
        """Index of an element."""
        return self.names.index(name)

    def wheel(self, k: int) -> int:
        """Index of the speed of driven wheel k."""
        return self.robot.freedoms + k

    def bounded(self, x: np.ndarray) -> np.ndarray:
        """The state vector (n,) with the states of ground and sensors inside their bounds."""
        own = self.robot_states
        inside = [clip(value, *BOUNDS[name]) for name, value in zip(self.names[own:], x[own:], strict=True)]
        return np.array([*x[:own], *inside])

    def split(self, x: np.ndarray) -> Parts:
        """Parts of a state vector (n,)."""
        free, n = self.robot.freedoms, self.robot.driven
        friction = np.exp(x[self.index("log_friction")]) if self.states.friction else 1.0
        return Parts(
            motion=x[:free],
            omega=x[free : free + n],
            friction=np.array([friction] * n),
            stiffness=np.exp(x[self.index("log_stiffness")]) if self.states.stiffness else 1.0,
            grade_rad=x[self.index("grade_rad")] if self.states.grade else None,
            rolling_ratio=1.0 + x[self.index("rolling_excess")] if self.states.rolling else 1.0,
            radius_ratio=x[self.index("radius_ratio")] if self.states.radius else 1.0,
        )
