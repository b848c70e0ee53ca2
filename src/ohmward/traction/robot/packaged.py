"""Packaged robots, robots by file or name, and a generic robot from a few dimensions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from ohmward.checks import require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.traction.robot.chassis import Differential, Mecanum, Omni, SkidSteer, Steered, TwoWheeled
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.robot import GRAVITY, ROBOT_FILE, Robot, Wheel, disc_yaw_inertia, solid_box_yaw_inertia

#: Layouts of the wheels of a generic robot.
LAYOUTS = ("two-wheel", "skid-steer", "car", "tricycle", "mecanum", "omni")

#: Assumed for a robot: wheel width over wheel radius, wheel mass over robot mass, and distance of a two-wheeled robot's
#: driven axle from the centre of gravity over the wheelbase.
WIDTH, WHEEL_MASS, AXLE = 0.4, 0.02, 0.25

#: Assumed for its motors: voltage [V], no-load speed [m/s], and pull at standstill over the weight.
_MOTOR_V, _FREE_M_S, _PULL = 24.0, 2.5, 1.0


def generic_robot(
    mass_kg: float,
    wheel_radius_m: float,
    track_m: float,
    wheelbase_m: float | None = None,
    gear_ratio: float = 1.0,
    layout: str = "two-wheel",
    name: str = "robot",
) -> Robot:
    """Robot from its dimensions alone, as a start: body, wheels and motors are typical; `calibrate` identifies them.

    The body is a uniform box as long as the wheelbase and as wide as the track; motors are those of `generic_motor`.

    mass_kg, wheel_radius_m, track_m: > 0; the track is the distance between left and right wheels, for "omni" the
        diameter of the circle of its wheels.
    wheelbase_m: between the axles, or from the driven axle to the caster, > 0; None for the track.
    gear_ratio: turns of the motor for one of the wheel, > 0.
    layout: of `LAYOUTS`: two driven wheels and a caster behind, four driven, a driven rear axle and a steered one, a
        steered driven wheel in front of an axle, four with rollers, three on a circle.

    Raises:
        InputError: a size is impossible, or the layout is unknown.
    """
    base_m = track_m if wheelbase_m is None else wheelbase_m
    for size, value in (("mass_kg", mass_kg), ("wheel_radius_m", wheel_radius_m), ("track_m", track_m)):
        require_positive(size, value)
    require_positive("wheelbase_m", base_m)
    require_positive("gear_ratio", gear_ratio)
    require_one_of("layout", layout, LAYOUTS)
    chassis: TwoWheeled | SkidSteer | Steered | Mecanum | Omni
    match layout:
        case "two-wheel":
            chassis = TwoWheeled(AXLE * base_m, track_m, (-(1.0 - AXLE) * base_m,))
        case "skid-steer":
            chassis = SkidSteer(base_m / 2, base_m / 2, track_m)
        case "car" | "tricycle":
            chassis = Steered(base_m / 2, base_m, track_m, "rear" if layout == "car" else "front")
        case "mecanum":
            chassis = Mecanum(base_m / 2, base_m / 2, track_m)
        case _:
            chassis = Omni(track_m / 2)
    rolling_radius_m = wheel_radius_m / math.sqrt(2.0) if layout == "mecanum" else wheel_radius_m
    wheel_kg, driven = WHEEL_MASS * mass_kg, sum(place.driven for place in chassis.places)
    return Robot(
        name=name,
        mass_kg=mass_kg,
        yaw_inertia_kg_m2=solid_box_yaw_inertia(mass_kg, base_m, track_m),
        chassis=chassis,
        wheel=Wheel(rolling_radius_m, WIDTH * wheel_radius_m, wheel_kg * wheel_radius_m**2 / 2),
        motor=generic_motor(mass_kg, rolling_radius_m, driven, gear_ratio),
    )


def generic_motor(mass_kg: float, wheel_radius_m: float, driven: int, gear_ratio: float = 1.0) -> Motor:
    """Typical motor of each driven wheel, for robots whose motors are unknown.

    The robot reaches 2.5 m/s without load at 24 V, and all motors together pull its weight at standstill. Motor
    currents give forces only once the real motors are known.
    """
    constant = _MOTOR_V * wheel_radius_m / (_FREE_M_S * gear_ratio)
    stall_A = _PULL * mass_kg * GRAVITY * wheel_radius_m / (driven * gear_ratio * constant)
    return Motor(constant, _MOTOR_V / stall_A, gear_ratio)


_RLMA_WHEEL_KG = 1.5
_RLMA_WHEEL = Wheel(radius_m=0.12, width_m=0.05, inertia_kg_m2=_RLMA_WHEEL_KG * 0.12**2 / 2)

#: The robot of [T]. Mass, axles, track, radius and box (0.68 x 0.38 x 0.20 m) are given there. Assumed, as [T] does not
#: describe them: wheels as uniform discs of 1.5 kg, the box as uniform and 8 cm clear of the ground, and 6.5-inch hub
#: motors (16 rpm/V, 0.179 ohm).
RLMA = Robot(
    name="RLMA",
    mass_kg=42.0,
    yaw_inertia_kg_m2=solid_box_yaw_inertia(42.0 - 4 * _RLMA_WHEEL_KG, 0.68, 0.38)
    + 4 * disc_yaw_inertia(_RLMA_WHEEL_KG, _RLMA_WHEEL, math.hypot(0.314, 0.15)),
    chassis=Differential(front_m=0.314, rear_m=0.314, track_m=0.30),
    wheel=_RLMA_WHEEL,
    motor=Motor(torque_constant_Nm_per_A=0.517, resistance_ohm=0.179),
    height_m=0.17,
)

#: Festo's Robotino as measured at Tomsk Polytechnic University (mass from the wheel loads); inertias and efficiency are
#: estimates.
ROBOTINO = Robot(
    name="Robotino",
    mass_kg=11.3,
    yaw_inertia_kg_m2=11.3 * 0.18**2 / 2,
    chassis=Omni(arm_m=0.125),
    wheel=Wheel(radius_m=0.04, width_m=0.036, inertia_kg_m2=0.2 * 0.04**2 / 2),
    motor=Motor(
        torque_constant_Nm_per_A=0.0514,
        resistance_ohm=5.95,
        gear_ratio=16.0,
        gear_efficiency=0.8,
        rotor_inertia_kg_m2=7e-6,
    ),
)

_SEEDER_WHEEL = Wheel(radius_m=0.15, width_m=0.06, inertia_kg_m2=1.5 * 0.15**2 / 2)
#: [P] 4, for each of the two motors. A motor delivers at most V^2 / (4 R), at half its no-load speed.
_SEEDER_MOTOR_V, _SEEDER_MOTOR_PEAK_W = 12.0, 514.0
#: Not given in [P]: no-load speed [rad/s], typical of a brushed motor of this size, 5,600 rpm.
_SEEDER_MOTOR_FREE_RAD_S = 5600.0 * math.pi / 30.0

#: The seeder robot of [P], which states a differential drive, two motors of 12 V and at most 514 W, and their type,
#: whose G16 is read as a gear of 16 to 1. All else is an estimate: [P] gives no mass, no dimensions and nothing about
#: wheels, casters and gears. The idle power is that of the Raspberry Pi 4 and the boards that it lists.
SEEDER = Robot(
    name="Seeder",
    mass_kg=25.0,
    yaw_inertia_kg_m2=solid_box_yaw_inertia(25.0, 0.70, 0.50),
    chassis=TwoWheeled(axle_m=0.15, track_m=0.50, casters_m=(-0.35,)),
    wheel=_SEEDER_WHEEL,
    motor=Motor(
        torque_constant_Nm_per_A=_SEEDER_MOTOR_V / _SEEDER_MOTOR_FREE_RAD_S,
        resistance_ohm=_SEEDER_MOTOR_V**2 / (4.0 * _SEEDER_MOTOR_PEAK_W),
        gear_ratio=16.0,
        gear_efficiency=0.8,
        rotor_inertia_kg_m2=5e-5,
    ),
    height_m=0.20,
    idle_W=8.0,
)

#: Robots as published by their makers: masses from the data sheets, dimensions from `turtlebot3_description`,
#: `create3_description`, `kobuki_description`, `husky_description` and `jackal_description`. Where nothing is
#: published, motors are those of `generic_motor`, and centres of gravity and yaw inertias those of a uniform box.
_BY_SIZES = {
    "turtlebot2": generic_robot(6.3, 0.035, 0.230, 0.23, name="TurtleBot 2 (Kobuki)"),
    "turtlebot3-burger": generic_robot(1.0, 0.033, 0.160, 0.081, name="TurtleBot 3 Burger"),
    "turtlebot3-waffle-pi": generic_robot(1.8, 0.033, 0.287, 0.177, name="TurtleBot 3 Waffle Pi"),
    "turtlebot4": generic_robot(3.9, 0.03575, 0.233, 0.125, name="TurtleBot 4 (Create 3)"),
    "jackal": generic_robot(17.0, 0.098, 0.37559, 0.262, layout="skid-steer", name="Jackal"),
    "husky": generic_robot(50.0, 0.1651, 0.5708, 0.512, layout="skid-steer", name="Husky A200"),
}

#: Robots that need no file.
PACKAGED: Mapping[str, Robot] = {"rlma": RLMA, "robotino": ROBOTINO, "seeder": SEEDER, **_BY_SIZES}


def load_robot(path: str | PathLike[str]) -> Robot:
    """Load a robot from its file, or a packaged one by its name, see `PACKAGED`.

    >>> ow.load_robot("husky").mass_kg
    50.0

    Raises:
        InputError: the file cannot be read, or describes an impossible robot; names file, key, rule and fix.
    """
    if not isinstance(path, str | PathLike):
        raise InputError(f"a robot must be a Robot, or the path or name of one, got {type(path).__name__}")
    if robot := PACKAGED.get(str(path).lower()):
        return robot
    if not Path(path).suffix and not Path(path).exists():
        raise InputError(f"robot must be a robot file or one of {', '.join(PACKAGED)}, got {str(path)!r}")
    return ROBOT_FILE.load(path)
