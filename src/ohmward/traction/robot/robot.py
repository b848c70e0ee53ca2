"""A robot: body, wheels, motors and chassis, and its file.

The robot file is TOML that people read and edit. Units are part of the names; an unknown key is an error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike

import numpy as np

from ohmward.checks import require_each_not_negative, require_each_positive, require_length, require_positive
from ohmward.errors import InputError
from ohmward.rich_display import RichDisplay
from ohmward.toml_file import TomlFile
from ohmward.traction.robot.chassis import (
    Differential,
    Mecanum,
    Omni,
    Place,
    Rectangle,
    SkidSteer,
    Steered,
    TwoWheeled,
    load_matrix,
    rolling_matrix,
)
from ohmward.traction.robot.motor import Motor

GRAVITY = 9.80665

#: Largest yaw inertia over that of all mass at the farthest wheel.
MOST_YAW = 9.0
#: Largest relative difference between the sum of the weighed wheel loads and the weight.
_WEIGHING = 0.05

#: Largest wheel radius of any robot [m].
_LARGEST_WHEEL_M = 3.0


@dataclass(frozen=True)
class Wheel:
    """Dimensions of a wheel; all wheels of a robot are alike."""

    radius_m: float  #: effective rolling radius, > 0
    width_m: float  #: tyre width, > 0
    inertia_kg_m2: float  #: moment of inertia of one wheel about its axle, without the motor, > 0

    def __post_init__(self) -> None:
        require_each_positive("wheel.", self, "radius_m", "width_m", "inertia_kg_m2")
        if self.radius_m > _LARGEST_WHEEL_M:
            raise InputError(
                f"wheel.radius_m must be at most {_LARGEST_WHEEL_M:g}, got {self.radius_m:g}; in millimetres? then it "
                f"is {1e-3 * self.radius_m:g}, and other lengths too are in metres"
            )


@dataclass(frozen=True)
class Robot(RichDisplay):
    """A robot, without the ground.

    >>> robot = ow.load_robot("turtlebot4")
    >>> robot.wheel.radius_m, robot.driven
    (0.03575, 2)

    Attributes:
        name: name for people.
        mass_kg: mass with wheels and load, > 0.
        yaw_inertia_kg_m2: moment of inertia about the vertical through the centre of gravity, > 0.
        chassis: arrangement of the wheels.
        wheel: properties of each wheel.
        motor: motor and gear of each driven wheel.
        height_m: height of the centre of gravity, >= 0; with 0 no load shifts between the wheels.
        idle_W: power of the electronics, >= 0.
        wheel_load_N: (wheels,) weighed load of each wheel, > 0, adding up to the weight; empty: from the geometry.
    """

    name: str
    mass_kg: float
    yaw_inertia_kg_m2: float
    chassis: Differential | SkidSteer | TwoWheeled | Steered | Omni | Mecanum
    wheel: Wheel
    motor: Motor
    height_m: float = 0.0
    idle_W: float = 0.0
    wheel_load_N: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        require_each_positive("robot.", self, "mass_kg", "yaw_inertia_kg_m2")
        require_each_not_negative("robot.", self, "height_m", "idle_W")
        self._check_room_for_wheels()
        self._check_sizes()
        if self.wheel_load_N:
            self._check_wheel_loads()

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """The wheels, driven ones first."""
        return self.chassis.places

    @cached_property
    def driven(self) -> int:
        """Number of driven wheels."""
        return sum(p.driven for p in self.places)

    @property
    def driven_wheels(self) -> list[str]:
        """Names of the driven wheels."""
        return [place.name for place in self.places[: self.driven]]

    @property
    def freedoms(self) -> int:
        """Number of motions of the body: 2 or 3."""
        return len(self.chassis.freedoms)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state, in order: motions of the body, then the speed of each driven wheel."""
        return (*self.chassis.freedoms, *(f"{p.name}_rad_s" for p in self.places if p.driven))

    @cached_property
    def rolling(self) -> np.ndarray:
        """G (wheels, freedoms), see `chassis`."""
        return rolling_matrix(self.chassis)

    @cached_property
    def motion_by_rims(self) -> np.ndarray:
        """G_d^+ (freedoms, driven): motion of the body from the speeds of its driven rims, assuming no slip."""
        return np.linalg.pinv(self.rolling[: self.driven])

    @cached_property
    def sideways(self) -> np.ndarray:
        """(wheels, freedoms): travel speed of each wheel to its left, for each motion of the body."""
        return rolling_matrix(self.chassis, math.pi / 2)

    @cached_property
    def loads(self) -> np.ndarray:
        """(wheels, 3), see `chassis`; the first column is each wheel's share of the weight."""
        matrix = load_matrix(self.places)
        if self.wheel_load_N:
            matrix[:, 0] = np.array(self.wheel_load_N) / sum(self.wheel_load_N)
        return matrix

    @cached_property
    def inertia(self) -> np.ndarray:
        """Inertia of each state (n,): kg for speeds, kg m2 for rotations.

        A wheel that is not driven rolls without slip: its rotation is part of the body's motion.
        """
        planar = {"v_m_s": self.mass_kg, "v_left_m_s": self.mass_kg, "yaw_rate_rad_s": self.yaw_inertia_kg_m2}
        free = self.rolling[self.driven :]
        rolling = self.wheel.inertia_kg_m2 / self.wheel.radius_m**2 * np.sum(free * free, axis=0)
        body = np.array([planar[name] for name in self.chassis.freedoms]) + rolling
        wheels = np.full(self.driven, self.wheel.inertia_kg_m2 + self.motor.inertia_at_wheel_kg_m2)
        return np.concatenate([body, wheels])

    def _check_room_for_wheels(self) -> None:
        for i, a in enumerate(self.places):
            for b in self.places[:i]:
                gap = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
                if gap < self.wheel.width_m:
                    raise InputError(
                        f"chassis: wheels {b.name} and {a.name} stand {gap:g} m apart, less than wheel.width_m = "
                        f"{self.wheel.width_m:g}; correct the geometry (metres, not millimetres?)"
                    )
        if isinstance(self.chassis, Rectangle) and 2 * self.wheel.radius_m >= self.chassis.wheelbase_m:
            raise InputError(
                f"wheel.radius_m must be below half the wheelbase of {self.chassis.wheelbase_m:g} m, or front and rear "
                f"wheels overlap; got {self.wheel.radius_m:g}"
            )

    def _check_wheel_loads(self) -> None:
        require_positive("robot.wheel_load_N", self.wheel_load_N)
        require_length("robot.wheel_load_N", self.wheel_load_N, len(self.places), "one for each wheel")
        weight, found = self.mass_kg * GRAVITY, sum(self.wheel_load_N)
        if abs(found - weight) > _WEIGHING * weight:
            raise InputError(
                f"robot.wheel_load_N must add up to the weight of robot.mass_kg, {weight:.4g} N within "
                f"{100 * _WEIGHING:.0f} %, got {found:.4g} N; correct the mass or the loads (newtons, not kilograms?)"
            )

    def _check_sizes(self) -> None:
        """Refuse sizes that no robot has beside each other, as where one is in millimetres or grams."""
        farthest_m = max(math.hypot(p.x_m, p.y_m) for p in self.places)
        radius_m, mass_kg = self.wheel.radius_m, self.mass_kg
        of_farthest, of_rim = "all mass at the farthest wheel", "all mass at the rim of one wheel"
        cube_kg, of_cube = 7850.0 * (2.0 * farthest_m) ** 3, "a cube of steel about the wheels"
        for name, value, usual, what, least, most in (
            ("robot.mass_kg", mass_kg, cube_kg, of_cube, 0.0, 1.0),
            ("wheel.radius_m", radius_m, farthest_m, "the distance of the farthest wheel", 1 / 200, 5.0),
            ("wheel.width_m", self.wheel.width_m, radius_m, "wheel.radius_m", 1 / 100, 100.0),
            ("robot.height_m", self.height_m, farthest_m, "the distance of the farthest wheel", 0.0, 10.0),
            ("robot.yaw_inertia_kg_m2", self.yaw_inertia_kg_m2, mass_kg * farthest_m**2, of_farthest, 1e-3, MOST_YAW),
            ("wheel.inertia_kg_m2", self.wheel.inertia_kg_m2, mass_kg * radius_m**2, of_rim, 0.0, 1.0),
        ):
            if not least * usual <= value <= most * usual:
                raise InputError(
                    f"{name} must be between {least * usual:.3g} and {most * usual:.3g} ({least:g} to {most:g} times "
                    f"{what}, {usual:.3g}), got {value:g}; correct one of them (metres and kilograms?)"
                )


def free_sideways(robot: Robot) -> Robot:
    """Robot for observers: a skid-steered one as a differential drive of its effective track, all wheels driven."""
    chassis = robot.chassis
    if not isinstance(chassis, SkidSteer):
        return robot
    return replace(robot, chassis=Differential(chassis.front_m, chassis.rear_m, chassis.turning_track_m, driven="all"))


def solid_box_yaw_inertia(mass_kg: float, length_m: float, width_m: float) -> float:
    """Yaw inertia [kg m2] of a uniform box, where nothing better is known."""
    return mass_kg * (length_m**2 + width_m**2) / 12


def disc_yaw_inertia(mass_kg: float, wheel: Wheel, distance_m: float) -> float:
    """Yaw inertia [kg m2] of a wheel, a uniform disc at this distance from the centre of gravity."""
    return mass_kg * ((3 * wheel.radius_m**2 + wheel.width_m**2) / 12 + distance_m**2)


def motion_from_wheels(robot: Robot, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Motion (..., freedoms) that fits the driven wheels' speeds (..., driven) best, assuming no slip."""
    return robot.wheel.radius_m * np.asarray(wheel_speed_rad_s) @ robot.motion_by_rims.T


#: Values of `kind` in the table [chassis].
CHASSIS: Mapping[type, str] = {
    Differential: "differential",
    SkidSteer: "skid-steer",
    TwoWheeled: "two-wheel",
    Steered: "steered",
    Omni: "omni",
    Mecanum: "mecanum",
}
_HEADER = """\
# A robot as ohmward knows it. Edit what you know better; every key carries its unit.
# x points forward, y to the left, both from the centre of gravity. [chassis] kind is one of:
#   differential (front_m, rear_m, track_m, driven = "front" or "all"), skid-steer (front_m, rear_m, track_m, and
#   effective_track_m once it is calibrated), two-wheel (axle_m, track_m, casters_m), steered (rear_m, wheelbase_m,
#   track_m, measured = "rear" or "front", the axle whose speed is measured, steering_zero_rad), omni (arm_m,
#   bearings_deg), mecanum (front_m, rear_m, track_m; radius_m is that of its wheels over the square root of 2).
# [motor] is each of the motors: constant, resistance and rotor of the bare motor, friction and damping at the wheel.
"""
#: Format of the robot file; `dump` writes and `parse` reads its text.
ROBOT_FILE = TomlFile(Robot, "ohmward-robot/1", _HEADER, digits=9, kinds=CHASSIS, made_by="`ohmward robot`")


def save_robot(robot: Robot, path: str | PathLike[str]) -> None:
    """Write the robot file; it is either complete or absent.

    >>> ow.save_robot(ow.load_robot("husky"), "robot.toml")

    Raises:
        OhmwardError: the file cannot be written.
    """
    ROBOT_FILE.save(robot, path)
