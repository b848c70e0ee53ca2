"""Prior of a robot's consumption from its data, before its first drive: broad, but of the right order of magnitude."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from ohmward.checks import require_between, require_each_not_negative, require_each_positive, require_positive
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward.traction.terrain.floor import STIFFNESS, STIFFNESS_STD

#: Rolling resistance over load, from vehicle handbooks, applied to the small wheels of robots.
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
#: Rolling resistance over load of any other ground.
ANY_RESISTANCE = 0.05
#: Relative standard deviation of these numbers.
GROUND_RESISTANCE_STD = 0.6
#: Growth of the resistance with speed over load [s/m]: A3 of [T] 4.5.
SPEED_RESISTANCE_S_PER_M = 0.02
#: Efficiency of motor controllers.
ELECTRONICS_EFFICIENCY = 0.9
#: Heat of the windings at a traction force equal to the robot's weight, over that weight [m/s], for unknown motors:
#: 0.5 for the Robotino's geared motors, 1.0 for those of a Husky, 2.0 for the hub motors of RLMA. Relative standard
#: deviation, and the smaller one of motors with a data sheet, whose windings warm up and whose supply is not ideal.
ANY_HEAT_M_S, ANY_HEAT_STD, HEAT_STD = 1.0, 0.7, 0.3
#: Speed [m/s] for the loss to wheel slip, which is also proportional to the force squared and added to that heat.
SLIP_SPEED_M_S = 1.0
#: Idle power [W] assumed for a robot without a given one.
ANY_IDLE_W = 10.0


@dataclass(frozen=True)
class ConsumptionPrior:
    """Prior of a robot before its first drive, and of a terrain before the first drive on it."""

    mass_kg: float  #: that `force_N` refers to, > 0
    #: of everything but the drives
    idle_W: float
    idle_std_W: float
    #: resistance of an unknown terrain, at the battery
    force_N: float
    force_std_N: float
    #: growth of the resistance with speed
    speed_N_s_per_m: float = 0.0
    speed_std_N_s_per_m: float = 0.0
    climb: float = 1.3  #: energy from the battery over the potential energy gained, about 1/efficiency
    climb_std: float = 0.25  #: its standard deviation
    regeneration: float = 0.4  #: regeneration efficiency, energy that comes back over the energy of braking
    regeneration_std: float = 0.3  #: its standard deviation
    #: heat of the windings, and loss to slip, over the square of the force
    heat_W_per_N2: float = 0.0
    heat_std_W_per_N2: float = 0.0
    scatter_m: float = 1.0  #: sigma^2 of `consumption`; 1 m is a fifth over 25 m
    day_std: float = 0.15  #: tau, standard deviation of the resistance from drive to drive, relative to it
    #: error that no drive reveals, relative to the energy: gains of the sensors, curves approximated by lines
    model_std: float = 0.02
    #: error on steep slopes that gentle ones do not reveal, relative to the energy that slopes add: with it the errors
    #: on slopes of 0.12 after drives on slopes of 0.03 have unit variance over 300 simulated robots whose slopes are
    #: measured with noise (their own tell 0.12; with the mass alone their mean is above, too)
    slope_std: float = 0.12
    drift_std: float = 0.05  #: drift of forces and idle power in a month, relative to those of the prior
    dof: float = 4.0  #: degrees of freedom of sigma^2 and tau^2, >= 3
    #: resistance of terrains with handbook values, by name
    terrain_force_N: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_each_positive("prior.", self, "mass_kg", "force_N", "force_std_N", "scatter_m", "day_std", "climb")
        numbers = (item.name for item in fields(self) if item.type == "float" and item.name != "dof")
        require_each_not_negative("prior.", self, *numbers)
        require_between("prior.dof", self.dof, 3.0, math.inf)
        for name, force_N in self.terrain_force_N.items():
            require_positive(f"prior.terrain_force_N.{name}", force_N)

    def force_of(self, terrain: str) -> float:
        """Expected resistance [N] of a terrain before the first drive on it."""
        return self.terrain_force_N.get(terrain, self.force_N)


def prior_from_robot(robot: Robot) -> ConsumptionPrior:
    """Prior from mass, wheels, motors and idle power of a robot."""
    efficiency = robot.motor.gear_efficiency * ELECTRONICS_EFFICIENCY
    friction_N = robot.driven * robot.motor.friction_Nm / robot.wheel.radius_m
    damping = robot.driven * robot.motor.damping_Nms_per_rad / robot.wheel.radius_m**2
    heat = heat_W_per_N2(robot)
    return _prior(robot.mass_kg, robot.idle_W, efficiency, friction_N, damping, heat, HEAT_STD * heat)


def heat_W_per_N2(robot: Robot) -> float:
    """Heat of all windings over the square of the robot's force, shared equally by all driven wheels."""
    ampere_per_newton = robot.wheel.radius_m / robot.driven / robot.motor.wheel_constant_Nm_per_A
    return robot.driven * robot.motor.resistance_ohm * ampere_per_newton**2


def prior_from_mass(mass_kg: float, idle_W: float = 0.0) -> ConsumptionPrior:
    """Prior from the mass alone; idle_W: 0 where it is not known."""
    require_positive("mass_kg", mass_kg)
    heat = ANY_HEAT_M_S / (mass_kg * GRAVITY)
    return _prior(mass_kg, idle_W, 0.8 * ELECTRONICS_EFFICIENCY, 0.0, 0.0, heat, ANY_HEAT_STD * heat)


def slip_W_per_N2(weight_N: float) -> tuple[float, float]:
    """Loss to slip over the square of the force on any floor, and its standard deviation.

    F v lambda with lambda = F/(C N): v/(C N), the stiffness C of a floor being lognormal (`terrain.floor`).
    """
    mean = SLIP_SPEED_M_S / weight_N * math.exp(STIFFNESS_STD**2 / 2) / STIFFNESS
    return mean, mean * math.sqrt(math.expm1(STIFFNESS_STD**2))


def _prior(
    mass_kg: float,
    idle_W: float,
    efficiency: float,
    friction_N: float,
    damping_N_s_per_m: float,
    heat: float,
    heat_std: float,
) -> ConsumptionPrior:
    weight_N = mass_kg * GRAVITY
    slip, slip_std = slip_W_per_N2(weight_N)
    force_N = (ANY_RESISTANCE * weight_N + friction_N) / efficiency
    drag = (SPEED_RESISTANCE_S_PER_M * weight_N + damping_N_s_per_m) / efficiency
    return ConsumptionPrior(
        mass_kg=mass_kg,
        idle_W=idle_W or ANY_IDLE_W,
        idle_std_W=0.3 * idle_W if idle_W else ANY_IDLE_W,
        force_N=force_N,
        force_std_N=GROUND_RESISTANCE_STD * force_N,
        speed_N_s_per_m=drag,
        speed_std_N_s_per_m=drag,
        climb=1.0 / efficiency,
        climb_std=0.2 / efficiency,
        heat_W_per_N2=heat + slip,
        heat_std_W_per_N2=math.hypot(heat_std, slip_std),
        terrain_force_N={name: (c * weight_N + friction_N) / efficiency for name, c in RESISTANCE.items()},
    )
