"""Dynamics of a robot on the ground: forces at every wheel, rates of body and wheels, and the energy balance.

m (dv_x/dt - yaw_rate v_y) = sum of the wheels' forces along x - m g sin(grade) - drawbar pull
J dyaw_rate/dt             = sum of their moments
J_w domega/dt              = tau - r F_tr(own wheel)

State x (n,): motions of the body (2 or 3), then the speeds of the driven wheels, named by `Robot.state_names`. A wheel
that is not driven rolls without slip and gives rolling resistance only. Where the chassis scrubs, each wheel's force
points along its slip vector (r omega - v, -v_sideways) and is the law's at the length of that vector.

Energy balance, in power or energy:

battery    = electrical + idle + resistor
electrical = copper + drive + slip + rolling + climb + drawbar + kinetic + numerical

The second line follows from tau omega = d/dt (kinetic energy) + F_tr s + |F_rr| |v_f| + grade, with the motor in front.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.trace import cos, maximum, sin, sqrt, where
from ohmward.traction.friction.law import Contact, TractionLaw, contact, direction_and_size
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.robot.motor import copper_loss, friction_torque, ideal_torque
from ohmward.traction.robot.robot import GRAVITY, Robot

#: Passes over the loop of force and load; each leaves about height/wheelbase * mu of the error.
LOAD_PASSES = 4
#: Slip speed [m/s] below which the direction of a slip vector fades; it keeps the derivative at rest finite.
_STILL = 1e-6


class Scene(NamedTuple):
    """Robot and ground, which do not change from step to step."""

    robot: Robot  #:    the robot
    terrains: tuple[Terrain, ...]  #: one for each wheel, in the order of `Robot.places`, see `scene`


class RobotInput(NamedTuple):
    """Input of the robot during a step."""

    current_A: Any  #:      (driven,) of each motor, > 0 drives forward
    grade_rad: Any = 0.0  #:      > 0 uphill along x
    bank_rad: Any = 0.0  #:       > 0 where the ground rises to the left
    drawbar_N: Any = 0.0  #:      pull of a load behind the robot, > 0 backward
    adhesion_share: Any = 1.0  #: (wheels,) or one for all: factor on the traction of the terrain


class Forces(NamedTuple):
    """Forces at the wheels, each (wheels,) except the torques, which are (driven,)."""

    load_N: np.ndarray  #:         normal load
    slip_speed_m_s: np.ndarray  #: r omega - v along the wheel, 0 where it is not driven
    sideways_m_s: np.ndarray  #:   travel speed of the wheel's centre to its left, 0 where the chassis does not scrub
    traction_N: np.ndarray  #:     of the ground along the wheel, without rolling resistance
    scrub_N: np.ndarray  #:        of the ground to the left of the wheel
    rolling_N: np.ndarray  #:      rolling resistance along the wheel
    torque_Nm: np.ndarray  #:      of the motor at the wheel, without losses
    friction_Nm: np.ndarray  #:    friction of the drive


def scene(robot: Robot, *terrains: Terrain) -> Scene:
    """The robot with one terrain under all wheels, or one for each wheel."""
    wheels = len(robot.places)
    if len(terrains) not in (1, wheels):
        raise InputError(f"terrains must be one, or one for each of the {wheels} wheels; got {len(terrains)}")
    return Scene(robot, terrains * wheels if len(terrains) == 1 else terrains)


def forces(x: np.ndarray, u: RobotInput, p: Scene) -> Forces:
    """Loads, slip and forces in state x; loads and ground forces depend on each other where the robot has a height."""
    ground = np.zeros(2)
    for _ in range(LOAD_PASSES if p.robot.height_m else 1):
        result = forces_at(x, u, p, normal_loads(u, p.robot, ground))
        ground = force_on_plane(result, p.robot)
    return result


class WheelMotion(NamedTuple):
    """Motion of each wheel over the ground, each (wheels,) in m/s: its rim, its centre along and to the left of it."""

    rim: np.ndarray
    travel: np.ndarray
    sideways: np.ndarray


def wheel_motion(x: np.ndarray, robot: Robot) -> WheelMotion:
    """Motion of the wheels in state x; undriven wheels do not slip, and wheels free sideways are not dragged."""
    motion, omega = x[: robot.freedoms], x[robot.freedoms :]
    travel = robot.rolling @ motion
    sideways = robot.sideways @ motion if robot.chassis.scrubs else np.zeros(len(travel))
    return WheelMotion(np.concatenate([robot.wheel.radius_m * omega, travel[robot.driven :]]), travel, sideways)


def forces_at(x: np.ndarray, u: RobotInput, p: Scene, load_N: np.ndarray, grip: np.ndarray | None = None) -> Forces:
    """Slip and forces in state x under these loads (wheels,).

    grip: (driven,) [N s/m] force per slip speed; None for that of x, see `grips`.
    """
    robot, n = p.robot, p.robot.driven
    rim, travel, sideways = wheel_motion(x, robot)
    omega = x[robot.freedoms :]
    grip = grips(x, u, p, load_N) if grip is None else grip
    idle = np.zeros(len(travel) - n)
    return Forces(
        load_N,
        rim - travel,
        sideways,
        np.concatenate([grip * (rim - travel)[:n], idle]),
        np.concatenate([-grip * sideways[:n], idle]),
        np.array([t.rolling.force_N(v, N) for t, v, N in zip(p.terrains, travel, load_N, strict=True)]),
        np.array([ideal_torque(robot.motor, u.current_A[k]) for k in range(n)]),
        np.array([friction_torque(robot.motor, u.current_A[k], omega[k]) for k in range(n)]),
    )


def grips(x: np.ndarray, u: RobotInput, p: Scene, load_N: np.ndarray) -> np.ndarray:
    """Force per slip speed (driven,) [N s/m] of each driven wheel in state x."""
    wheels = wheel_motion(x, p.robot)
    share = np.broadcast_to(np.asarray(u.adhesion_share), load_N.shape)
    find = vector_grip if p.robot.chassis.scrubs else grip_along
    found = [
        find(wheels.rim[k], wheels.travel[k], wheels.sideways[k], load_N[k], p.terrains[k].traction)
        for k in range(p.robot.driven)
    ]
    return share[: p.robot.driven] * np.array(found)


def grip_along(rim: Any, travel: Any, sideways: Any, load_N: Any, law: TractionLaw) -> Any:
    """Force per slip speed of a wheel that is free sideways."""
    _, size = direction_and_size(rim - travel)
    slip = where(size < _STILL, _STILL, rim - travel)
    return law.force_N(contact(travel + slip, travel, load_N)) / slip


def vector_grip(rim: Any, travel: Any, sideways: Any, load_N: Any, law: TractionLaw) -> Any:
    """Force per slip speed along the slip vector (r omega - v, -v_sideways)."""
    slip = sqrt((rim - travel) ** 2 + sideways**2 + _STILL**2)
    return law.force_N(Contact(slip, rim, sqrt(travel**2 + sideways**2 + _STILL**2), load_N)) / slip


def normal_loads(u: RobotInput, robot: Robot, ground_N: np.ndarray) -> np.ndarray:
    """Load of each wheel (wheels,) from its share of the weight and the shift by the forces along the ground.

    ground_N: (2,) all forces of the ground along x and y; they act robot.height_m below the centre of gravity. A
    negative load, of a robot about to tip over, is set to zero.
    """
    weight = robot.mass_kg * GRAVITY * cos(u.grade_rad) * cos(u.bank_rad)
    moments = np.array([weight, -robot.height_m * ground_N[0], -robot.height_m * ground_N[1]])
    return maximum(robot.loads @ moments, 0.0)


def force_on_plane(f: Forces, robot: Robot) -> np.ndarray:
    """(2,) sum of the wheels' forces along x and y of the body."""
    along, across = f.traction_N + f.rolling_N, f.scrub_N
    c = np.array([math.cos(p.heading_rad) for p in robot.places])
    s = np.array([math.sin(p.heading_rad) for p in robot.places])
    return np.array([c @ along - s @ across, s @ along + c @ across])


def weight_along_ground(u: RobotInput, robot: Robot) -> np.ndarray:
    """(2,) part of the weight along x and y of the body."""
    weight = robot.mass_kg * GRAVITY
    return np.array([-weight * sin(u.grade_rad), -weight * cos(u.grade_rad) * sin(u.bank_rad)])


def momentum_rates(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> np.ndarray:
    """Force or moment on each state (n,): its inertia times its rate."""
    robot = p.robot
    body = robot.rolling.T @ (f.traction_N + f.rolling_N) + robot.sideways.T @ f.scrub_N
    pull = weight_along_ground(u, robot) - np.array([u.drawbar_N, 0.0])
    wheels = f.torque_Nm - f.friction_Nm - robot.wheel.radius_m * f.traction_N[: robot.driven]
    return np.concatenate([body + _external(x, pull, robot), wheels])


def rates(x: np.ndarray, u: RobotInput, p: Scene) -> np.ndarray:
    """Rate of change of the state (n,)."""
    return momentum_rates(x, u, p, forces(x, u, p)) / p.robot.inertia


def _external(x: np.ndarray, pull: np.ndarray, robot: Robot) -> np.ndarray:
    """Forces on the body (freedoms,) that do not come from the wheels, including those of the rotating frame."""
    if robot.freedoms == 2:
        return np.array([pull[0], 0.0])
    v_x, v_y, yaw_rate = x[:3]
    turning = robot.mass_kg * yaw_rate
    return np.array([pull[0] + turning * v_y, pull[1] - turning * v_x, 0.0])


class EnergyBalance(NamedTuple):
    """Terms of the energy balance: power [W], or energy [J] where integrated over time; numbers or (T,) arrays.

    battery = idle + resistor + copper + drive + slip + rolling + climb + drawbar + kinetic + numerical + residual
    """

    battery: Any = 0.0  #:    out of the battery; < 0 where it is charged
    electrical: Any = 0.0  #: into the motors, part of `battery`; < 0 where braking gives back
    idle: Any = 0.0  #:       electronics
    resistor: Any = 0.0  #:   braking power that the battery does not take, burned in a resistor
    copper: Any = 0.0  #:     heats the windings
    drive: Any = 0.0  #:      lost in gears and bearings
    slip: Any = 0.0  #:       lost between wheel and ground, along and across
    rolling: Any = 0.0  #:    lost to rolling resistance
    climb: Any = 0.0  #:      lifts the robot; < 0 downhill
    drawbar: Any = 0.0  #:    pulls the load behind it
    kinetic: Any = 0.0  #:    accelerates body and wheels; < 0 where they slow down
    numerical: Any = 0.0  #:  lost by the method of integration

    @property
    def losses(self) -> Any:
        """Part of `electrical` that becomes heat."""
        return self.copper + self.drive + self.slip + self.rolling

    @property
    def residual(self) -> Any:
        """Part of `battery` that no term explains, in the unit of the terms: 0 where the balance closes."""
        return self.battery - sum(getattr(self, name) for name in TERMS)

    def accumulate(self, step: EnergyBalance) -> EnergyBalance:
        """The balance after one more step."""
        return EnergyBalance(*(total + term for total, term in zip(self, step, strict=True)))


#: Terms that add up to `battery`.
TERMS = tuple(name for name in EnergyBalance._fields if name not in ("battery", "electrical"))


def power(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> EnergyBalance:
    """Energy balance [W] in state x with the forces `f`; every loss is >= 0 in every state."""
    robot = p.robot
    motion, omega = x[: robot.freedoms], x[robot.freedoms :]
    copper = sum(copper_loss(robot.motor, u.current_A[k]) for k in range(robot.driven))
    electrical = copper + f.torque_Nm @ omega
    weight = weight_along_ground(u, robot)
    leftward = motion[1] if robot.freedoms == 3 else 0.0
    return EnergyBalance(
        battery=electrical + robot.idle_W,
        electrical=electrical,
        idle=robot.idle_W,
        copper=copper,
        drive=f.friction_Nm @ omega,
        slip=f.traction_N @ f.slip_speed_m_s - f.scrub_N @ f.sideways_m_s,
        rolling=-(f.rolling_N @ (robot.rolling @ motion)),
        climb=-(weight[0] * motion[0] + weight[1] * leftward),
        drawbar=u.drawbar_N * motion[0],
        kinetic=momentum_rates(x, u, p, f) @ x,
    )


def kinetic_energy(x: np.ndarray, inertia: np.ndarray) -> Any:
    """Kinetic energy [J] of body and wheels.

    x: (n,) or (T, n) speeds [m/s, rad/s].  inertia: (n,) of each, as `Robot.inertia`.
    """
    return 0.5 * ((x * x) @ inertia)
