"""What a robot's data say about its consumption before it has driven: broad, and right in its order of magnitude."""

from __future__ import annotations

from ohmward.checks import require_positive
from ohmward.energy.consumption import Prior
from ohmward.traction.robot import GRAVITY, Robot

#: Rolling resistance over load, as in handbooks of vehicles, taken for the small wheels of robots.
RESISTANCE = {
    "concrete": 0.02,
    "asphalt": 0.02,
    "floor": 0.02,
    "dry asphalt": 0.02,
    "wet asphalt": 0.025,
    "gravel": 0.05,
    "unpaved": 0.06,
    "grass": 0.08,
    "soil": 0.1,
    "field": 0.15,
    "sand": 0.2,
    "snow": 0.15,
}
#: Of a ground that nobody has named.
ANY_RESISTANCE = 0.05
#: How far such a number may be off, as a share of it.
RESISTANCE_STD = 0.6
#: Growth of the resistance with speed over load [s/m]: A3 of [T] 4.5.
SPEED_RESISTANCE_S_PER_M = 0.02
#: Of motor controllers.
ELECTRONICS_EFFICIENCY = 0.9
#: Idle power of a robot of which nothing is said [W].
ANY_IDLE_W = 10.0


def prior_from_robot(robot: Robot) -> Prior:
    """From mass, wheels, motors and idle power of a robot."""
    efficiency = robot.motor.gear_efficiency * ELECTRONICS_EFFICIENCY
    friction_N = robot.driven * robot.motor.friction_Nm / robot.wheel.radius_m
    damping = robot.driven * robot.motor.damping_Nms_per_rad / robot.wheel.radius_m**2
    return _prior(robot.mass_kg, robot.idle_W, efficiency, friction_N, damping, heat_W_per_N2(robot))


def heat_W_per_N2(robot: Robot) -> float:
    """Heat of all windings over the square of the robot's force, all driven wheels pulling alike."""
    ampere_per_newton = robot.wheel.radius_m / robot.driven / robot.motor.wheel_constant_Nm_per_A
    return robot.driven * robot.motor.resistance_ohm * ampere_per_newton**2


def prior_from_mass(mass_kg: float, idle_W: float = 0.0) -> Prior:
    """From the mass alone; idle_W: 0 where nobody said."""
    require_positive("mass_kg", mass_kg)
    return _prior(mass_kg, idle_W, 0.8 * ELECTRONICS_EFFICIENCY, 0.0, 0.0, 0.0)


def _prior(
    mass_kg: float, idle_W: float, efficiency: float, friction_N: float, damping_N_s_per_m: float, heat: float
) -> Prior:
    weight_N = mass_kg * GRAVITY
    force_N = (ANY_RESISTANCE * weight_N + friction_N) / efficiency
    drag = (SPEED_RESISTANCE_S_PER_M * weight_N + damping_N_s_per_m) / efficiency
    return Prior(
        mass_kg=mass_kg,
        idle_W=idle_W or ANY_IDLE_W,
        idle_std_W=0.3 * idle_W if idle_W else ANY_IDLE_W,
        force_N=force_N,
        force_std_N=RESISTANCE_STD * force_N,
        speed_N_s_per_m=drag,
        speed_std_N_s_per_m=drag,
        climb=1.0 / efficiency,
        climb_std=0.2 / efficiency,
        heat_W_per_N2=heat,
        heat_std_W_per_N2=0.3 * heat,
        terrain_force_N={name: (c * weight_N + friction_N) / efficiency for name, c in RESISTANCE.items()},
    )
