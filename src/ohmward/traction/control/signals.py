"""Inputs and outputs of the controllers: measurement, commands, report and flags.

Every field is a number, or (n,) for n driven wheels: the controllers work element by element. x points forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple

from ohmward.checks import require_each_positive
from ohmward.trace import clip
from ohmward.traction.robot.motor import Motor
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


#: Difference [N m] below which two torques are the same.
SAME_TORQUE = 1e-9


@dataclass(frozen=True)
class Limits:
    """Limits of the torque at the wheel."""

    torque_Nm: float  #: largest magnitude, > 0
    rate_Nm_per_s: float = 5000.0  #: largest rate of change, > 0

    def __post_init__(self) -> None:
        require_each_positive("limits.", self, "torque_Nm", "rate_Nm_per_s")

    @classmethod
    def of_current(cls, motor: Motor, current_A: float, rate_A_per_s: float) -> Limits:
        """The limits of a drive that limits current and its change."""
        constant = motor.wheel_constant_Nm_per_A
        return cls(constant * current_A, constant * rate_A_per_s)

    def apply(self, demanded_Nm: Any, before_Nm: Any, dt_s: Any) -> Any:
        """The torque nearest to the demanded one that may follow `before_Nm`, which is within the limits."""
        change = self.rate_Nm_per_s * dt_s
        return clip(clip(demanded_Nm, before_Nm - change, before_Nm + change), -self.torque_Nm, self.torque_Nm)


def limited(demanded_Nm: Any, torque_Nm: Any) -> Any:
    """True where the torque differs from the demanded one."""
    return abs(demanded_Nm - torque_Nm) > SAME_TORQUE


class ControlFlag(IntFlag):
    """Conditions of a step of a controller; `Report.flags` is their sum."""

    STALE = 1  #: the measurement is too old, too uncertain or not a number: torque goes to zero
    STOPPED = 2  #: too slow for slip to be meaningful: a slip controller gives no torque, the speed controller holds
    TORQUE_LIMITED = 4  #: the demanded torque exceeds its limit, or changes faster than its limit
    SLIP_BOUND = 8  #: the speed controller gives less torque than the speed needs, to stay within the slip bound
    UNREACHABLE = 16  #: the commanded slip is not reached although the torque has been at its limit for a while
    BAD_COMMAND = 32  #: the command is not a number or out of its range: torque goes to zero


class Measurement(NamedTuple):
    """Measured or estimated motion of a driven wheel."""

    wheel_speed_rad_s: Any  #:    of the wheel, > 0 forward
    travel_speed_m_s: Any  #:     of the wheel's centre along the wheel, measured or estimated
    age_s: Any = 0.0  #:                of the travel speed, >= 0
    travel_speed_std_m_s: Any = 0.0  #: its standard deviation
    force_N: Any = math.nan  #:              of the ground on the wheel, from an estimator; nan without one
    acceleration_m_s2: Any = math.nan  #:    of the wheel's centre, likewise


class SlipCommand(NamedTuple):
    """A slip to hold."""

    slip_ratio: Any  #: in (-1, 1), > 0 drives and < 0 brakes, in either direction of travel
    direction: Any = 1.0  #:  >= 0 forward, < 0 reverse


class SpeedCommand(NamedTuple):
    """A speed to hold, within slip bounds."""

    speed_m_s: Any  #:  of the wheel's centre, < 0 in reverse
    slip_bound: Any = 0.12  #: largest slip ratio in magnitude, driving and braking, at least 0.001 and below 1


class Report(NamedTuple):
    """Slip, force and torque of a step, with flags."""

    slip_ratio: Any  #:  driving > 0 and braking < 0; nan below a floor of speed
    slip_target: Any  #: slip ratio that is held now, or the bound
    surface_m_s: Any  #: distance from the target as a slip speed, > 0 if slip is too large
    force_N: Any  #:     of the ground on the wheel, along x, as estimated
    demanded_Nm: Any  #: torque without limits
    flags: Any  #:       sum of `ControlFlag` values
