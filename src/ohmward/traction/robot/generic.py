"""Robot of a few sizes, for one that nobody has calibrated: what `generic_battery` is for a battery."""

from __future__ import annotations

from ohmward.checks import require_positive
from ohmward.traction.robot.chassis import SkidSteer, TwoWheeled
from ohmward.traction.robot.motor import Motor
from ohmward.traction.robot.robot import GRAVITY, Robot, Wheel, solid_box_yaw_inertia

#: Assumed of a robot: width of a wheel over its radius, mass of one over that of the robot, share of the wheelbase
#: that the driven axle of two stands from the centre of gravity.
_WIDTH, _WHEEL_MASS, _AXLE = 0.4, 0.02, 0.25

#: Assumed of its motors: their voltage [V], the speed without load [m/s], and the pull at standstill over the weight.
_MOTOR_V, _FREE_M_S, _PULL = 24.0, 2.5, 1.0


def generic_robot(
    mass_kg: float,
    wheel_radius_m: float,
    track_m: float,
    wheelbase_m: float | None = None,
    gear_ratio: float = 1.0,
    wheels: int = 2,
    name: str = "robot",
) -> Robot:
    """Robot of its sizes alone, to start with: body, wheels and motors as usual; `calibrate` finds what they are.

    The body is an even box as long as the wheelbase and as wide as the track. The motors are assumed such that they
    reach 2.5 m/s without load at 24 V, and pull the robot's weight at standstill: currents of motors tell forces only
    once the motors are known.

    mass_kg, wheel_radius_m, track_m: > 0; the track is the distance between left and right wheels.
    wheelbase_m: between the axles, or from the driven axle to the caster, > 0; as the track where it is None.
    gear_ratio: turns of the motor for one of the wheel, > 0.  wheels: 2 with a caster, or 4 that are driven.

    Raises:
        InputError: a size that cannot be.
    """
    base_m = track_m if wheelbase_m is None else wheelbase_m
    for size, value in (("mass_kg", mass_kg), ("wheel_radius_m", wheel_radius_m), ("track_m", track_m)):
        require_positive(size, value)
    require_positive("wheelbase_m", base_m)
    require_positive("gear_ratio", gear_ratio)
    driven = 4 if wheels > 2 else 2
    two_wheeled = TwoWheeled(_AXLE * base_m, track_m, (-(1.0 - _AXLE) * base_m,))
    wheel_kg = _WHEEL_MASS * mass_kg
    constant = _MOTOR_V * wheel_radius_m / (_FREE_M_S * gear_ratio)
    stall_A = _PULL * mass_kg * GRAVITY * wheel_radius_m / (driven * gear_ratio * constant)
    return Robot(
        name=name,
        mass_kg=mass_kg,
        yaw_inertia_kg_m2=solid_box_yaw_inertia(mass_kg, base_m, track_m),
        chassis=two_wheeled if driven == 2 else SkidSteer(base_m / 2, base_m / 2, track_m),
        wheel=Wheel(wheel_radius_m, _WIDTH * wheel_radius_m, wheel_kg * wheel_radius_m**2 / 2),
        motor=Motor(constant, _MOTOR_V / stall_A, gear_ratio),
    )
