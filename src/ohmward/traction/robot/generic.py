"""Robot of a few sizes, for one that nobody has calibrated: what `generic_battery` is for a battery."""

from __future__ import annotations

import math

from ohmward.checks import require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.traction.robot.chassis import Mecanum, Omni, SkidSteer, TwoWheeled
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.robot import GRAVITY, Robot, Wheel, solid_box_yaw_inertia

#: Layouts of the wheels of a generic robot.
LAYOUTS = ("two-wheel", "skid-steer", "mecanum", "omni")

#: No robot has larger wheels [m].
_LARGEST_WHEEL_M = 3.0
#: Assumed of a robot: width of a wheel over its radius, mass of one over that of the robot, share of the wheelbase
#: that the driven axle of two stands from the centre of gravity.
WIDTH, WHEEL_MASS, AXLE = 0.4, 0.02, 0.25

#: Assumed of its motors: their voltage [V], the speed without load [m/s], and the pull at standstill over the weight.
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
    """Robot of its sizes alone, to start with: body, wheels and motors as usual; `calibrate` finds what they are.

    The body is an even box as long as the wheelbase and as wide as the track. The motors are those of `generic_motor`.

    mass_kg, wheel_radius_m, track_m: > 0; the track is the distance between left and right wheels, for "omni" the
        diameter of the circle of its wheels.
    wheelbase_m: between the axles, or from the driven axle to the caster, > 0; as the track where it is None.
    gear_ratio: turns of the motor for one of the wheel, > 0.
    layout: of `LAYOUTS`: two driven wheels before a caster, four driven ones, four with rollers, three on a circle.

    Raises:
        InputError: a size that cannot be, or no such layout.
    """
    base_m = track_m if wheelbase_m is None else wheelbase_m
    for size, value in (("mass_kg", mass_kg), ("wheel_radius_m", wheel_radius_m), ("track_m", track_m)):
        require_positive(size, value)
    if wheel_radius_m > _LARGEST_WHEEL_M:
        raise InputError(
            f"wheel_radius_m must be at most {_LARGEST_WHEEL_M:g}, got {wheel_radius_m:g}; in millimetres? then it is "
            f"{1e-3 * wheel_radius_m:g}"
        )
    require_positive("wheelbase_m", base_m)
    require_positive("gear_ratio", gear_ratio)
    require_one_of("layout", layout, LAYOUTS)
    chassis: TwoWheeled | SkidSteer | Mecanum | Omni
    match layout:
        case "two-wheel":
            chassis = TwoWheeled(AXLE * base_m, track_m, (-(1.0 - AXLE) * base_m,))
        case "skid-steer":
            chassis = SkidSteer(base_m / 2, base_m / 2, track_m)
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
    """Motor of each of the driven wheels where nothing is known of it.

    It is such that the robot reaches 2.5 m/s without load at 24 V, and that all of them pull its weight at standstill:
    currents of motors tell forces only once the motors are known.
    """
    constant = _MOTOR_V * wheel_radius_m / (_FREE_M_S * gear_ratio)
    stall_A = _PULL * mass_kg * GRAVITY * wheel_radius_m / (driven * gear_ratio * constant)
    return Motor(constant, _MOTOR_V / stall_A, gear_ratio)
