"""A robot of four wheels on patches of ground in MuJoCo, with its energy balance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ohmward.errors import InputError
from ohmward.traction.dynamics.forces import EnergyBalance, kinetic_energy
from ohmward.traction.friction.terrain import RollingResistance
from ohmward.traction.robot.chassis import Mecanum, Omni, Steered, TwoWheeled
from ohmward.traction.robot.motor import copper_loss, friction_torque
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward_lab.simulate.ground import Grade, GroundSurface, Patch, surface
from ohmward_lab.simulate.mujoco_plant import RlmaParameters, RlmaPlant
from ohmward_lab.simulate.robot_sensors import RobotTruth

#: Height of the centre of gravity [m] of a robot whose description has none.
HEIGHT_M = 0.17


class MujocoRobot:
    """Plant with the interface of `TractionPlant` on MuJoCo's contacts and rigid bodies.

    Args:
        robot: on four wheels, all fixed to the body.
        drag_N_s2_per_m2: drag over the square of the speed; it counts as a drawbar's pull.
        patches, grade: of the ground. Rolling resistance is that of the ground that lies under all others.

    Raises:
        InputError: MuJoCo is not installed, or it cannot simulate this robot or this ground.
    """

    def __init__(
        self,
        robot: Robot,
        patches: Sequence[Patch] = (),
        grade: Grade | None = None,
        drag_N_s2_per_m2: float = 0.0,
    ) -> None:
        self.robot, wheels = robot, [p.name for p in robot.places]
        under = surface(patches, wheels)
        rolling = _rolling(under, robot)
        self._rolling = np.full(len(robot.places), rolling)
        p = replace(parameters(robot, under.patches[-1], rolling), drag_N_s2_per_m2=drag_N_s2_per_m2)
        self._plant, self._drag = RlmaPlant(p, patches, grade, wheels=wheels), drag_N_s2_per_m2
        self.reset()

    def reset(self, speed_m_s: float = 0.0, heading_rad: float = 0.0) -> RobotTruth:
        """Put the robot back to the origin; return the truth there."""
        self._before = self._plant.reset(speed_m_s, heading_rad)
        self.energy = EnergyBalance()
        return self._before

    def step(self, torque_N_m: Any, dt_s: float) -> RobotTruth:
        """Hold the torque for `dt_s`; return the truth at the end. `energy` is the balance [J] of this step."""
        after = self._plant.step(torque_N_m, dt_s)
        self.energy = energy_step(self._before, after, self.robot, self._rolling, self._drag)
        self._before = after
        return after


def parameters(robot: Robot, patch: Patch, rolling: float) -> RlmaParameters:
    """The robot as MuJoCo needs it; the wheels are solid discs, the body is a box with the robot's yaw inertia.

    Raises:
        InputError: a chassis without four wheels on two axles, or a drive with losses, which MuJoCo does not have.
    """
    motor, chassis = robot.motor, robot.chassis
    if isinstance(chassis, Omni | Mecanum | TwoWheeled | Steered):
        other = {TwoWheeled: "casters", Steered: "a steered one"}.get(type(chassis), "omni-wheels")
        raise InputError(f'plant = "mujoco" has four wheels on two axles, not {other}; take plant = "own"')
    if motor.gear_efficiency < 1 or motor.friction_Nm or motor.damping_Nms_per_rad:
        raise InputError('plant = "mujoco" has no losses in the drive; take plant = "own", or drop them from the robot')
    driven = tuple(k for k, p in enumerate(robot.places) if p.driven)
    wheel_mass = 2 * robot.wheel.inertia_kg_m2 / robot.wheel.radius_m**2
    length = chassis.wheelbase_m
    width = max(chassis.track_m - robot.wheel.width_m, 0.1)
    return RlmaParameters(
        mass_kg=robot.mass_kg,
        wheel_mass_kg=wheel_mass,
        rotor_inertia_kg_m2=motor.inertia_at_wheel_kg_m2,
        wheel_radius_m=robot.wheel.radius_m,
        wheel_width_m=robot.wheel.width_m,
        front_m=chassis.front_m,
        rear_m=chassis.rear_m,
        track_m=chassis.track_m,
        body_m=_box(robot, wheel_mass, length, width),
        centre_height_m=robot.height_m or HEIGHT_M,
        driven=driven,
        rolling_resistance=rolling,
        slip_stiffness_s_per_m=patch.slip_stiffness_s_per_m,
    )


def _box(robot: Robot, wheel_mass_kg: float, length_m: float, width_m: float) -> tuple[float, float, float]:
    """Length, width and height [m] of a homogeneous body that gives the robot its yaw inertia, wheels included."""
    arms = np.array([[p.x_m, p.y_m] for p in robot.places])
    across = robot.wheel.inertia_kg_m2 / 2 + wheel_mass_kg * robot.wheel.width_m**2 / 12
    wheels = wheel_mass_kg * float(np.sum(arms * arms)) + len(arms) * across
    body_kg = robot.mass_kg - len(arms) * wheel_mass_kg
    wanted = 12 * max(robot.yaw_inertia_kg_m2 - wheels, 0.01 * robot.yaw_inertia_kg_m2) / body_kg
    scale = float(np.sqrt(wanted / (length_m**2 + width_m**2)))
    return scale * length_m, scale * width_m, 0.2


def _rolling(under: GroundSurface, robot: Robot) -> float:
    """Resistance over load of the ground that lies under all others.

    Raises:
        InputError: a patch with another resistance.
    """
    laws = [patch.ground(robot).rolling for patch in under.patches]
    if not all(isinstance(law, RollingResistance) and law == laws[-1] for law in laws):
        raise InputError(
            'plant = "mujoco" knows one rolling resistance; leave ground.rolling out of the patches and soils out of '
            'the ground, or take plant = "own"'
        )
    return laws[-1].a1  # type: ignore[attr-defined]


def energy_step(
    before: RobotTruth, after: RobotTruth, robot: Robot, rolling: np.ndarray, drag_N_s2_per_m2: float = 0.0
) -> EnergyBalance:
    """Energy balance [J] of the motors between two truths, by the trapezoidal rule; forces are those of `after`.

    `numerical` is the remainder of the balance.

    rolling: (wheels,) resistance over load, against the wheel's rotation.
    """
    dt_s, n = after.time_s - before.time_s, robot.driven
    omega = 0.5 * (before.wheel_speed_rad_s + after.wheel_speed_rad_s)
    centre = 0.5 * (before.wheel_centre_speed_m_s + after.wheel_centre_speed_m_s)
    torque = after.torque_N_m[:n]
    current_A = torque / robot.motor.wheel_constant_Nm_per_A
    rim = robot.wheel.radius_m * omega
    to_left = after.lateral_speed_m_s + np.array([p.x_m for p in robot.places]) * after.yaw_rate_rad_s
    moved_m = after.position_m[:2] - before.position_m[:2]

    copper = float(np.sum(copper_loss(robot.motor, current_A))) * dt_s
    electrical = copper + float(torque @ omega[:n]) * dt_s
    drive = float(sum(friction_torque(robot.motor, current_A[k], omega[k]) * omega[k] for k in range(n))) * dt_s
    slip = float(after.traction_N @ (rim - centre) - after.lateral_N @ to_left) * dt_s
    resisted = float(np.sum(rolling * after.normal_N * np.abs(rim))) * dt_s
    drawbar = drag_N_s2_per_m2 * np.hypot(before.speed_m_s, before.lateral_speed_m_s) * before.speed_m_s * moved_m[0]
    climb = robot.mass_kg * GRAVITY * float(np.sin(after.grade_rad)) * float(moved_m[0])
    kinetic = _kinetic_energy(after, robot) - _kinetic_energy(before, robot)
    return EnergyBalance(
        battery=electrical,
        electrical=electrical,
        copper=copper,
        drive=drive,
        slip=slip,
        rolling=resisted,
        climb=climb,
        drawbar=float(drawbar),
        kinetic=kinetic,
        numerical=electrical - copper - drive - slip - resisted - climb - float(drawbar) - kinetic,
    )


def _kinetic_energy(truth: RobotTruth, robot: Robot) -> float:
    """Kinetic energy [J] of body and wheels, all of which may turn at their own speed."""
    motion = [truth.speed_m_s, truth.lateral_speed_m_s, truth.yaw_rate_rad_s]
    body = [robot.mass_kg, robot.mass_kg, robot.yaw_inertia_kg_m2]
    rotors = np.where([p.driven for p in robot.places], robot.motor.inertia_at_wheel_kg_m2, 0.0)
    inertia = np.concatenate([body, robot.wheel.inertia_kg_m2 + rotors])
    return float(kinetic_energy(np.concatenate([motion, truth.wheel_speed_rad_s]), inertia))
