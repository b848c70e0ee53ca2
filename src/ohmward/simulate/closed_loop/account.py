"""Where the energy of the battery goes, so that nothing is lost between the rows.

battery = copper + drive + slip + rolling + climb + kinetic + idle + resistor + numerical
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.simulate.robot_truth import RobotTruth
from ohmward.traction.robot.motor import copper_loss, friction_torque
from ohmward.traction.robot.robot import GRAVITY, Robot


class Work(NamedTuple):
    """Joules of one step of a plant: electrical = the losses + climb + kinetic + numerical.

    electrical: into the motors; < 0 where braking gives back.
    copper: heats the windings.
    drive: lost in gears and bearings.
    slip: lost between wheels and ground, along and across.
    rolling: lost to rolling resistance.
    climb: lifts the robot; < 0 downhill.
    kinetic: gained by body and wheels.
    numerical: taken by the method of integration, or missing in the account of a plant that is not ours.
    """

    electrical: Any
    copper: Any
    drive: Any
    slip: Any
    rolling: Any
    climb: Any
    kinetic: Any
    numerical: Any


class Account(NamedTuple):
    """Joules since the start; a drive's is (T,) each. See the module for the balance."""

    battery: Any = 0.0
    copper: Any = 0.0
    drive: Any = 0.0
    slip: Any = 0.0
    rolling: Any = 0.0
    climb: Any = 0.0
    kinetic: Any = 0.0
    idle: Any = 0.0
    resistor: Any = 0.0
    numerical: Any = 0.0

    @property
    def residual_J(self) -> Any:
        """What the balance lacks."""
        return self.battery - sum(self[1:])


def booked(account: Account, work: Work, idle_J: float, battery_J: float) -> Account:
    """The account after a step in which the battery gave `battery_J`; what it did not take, the resistor burned."""
    surplus = battery_J - work.electrical - idle_J
    return Account(
        account.battery + battery_J,
        account.copper + work.copper,
        account.drive + work.drive,
        account.slip + work.slip,
        account.rolling + work.rolling,
        account.climb + work.climb,
        account.kinetic + work.kinetic,
        account.idle + idle_J,
        account.resistor + surplus,
        account.numerical + work.numerical,
    )


def work_between(before: RobotTruth, after: RobotTruth, robot: Robot, rolling: np.ndarray) -> Work:
    """The account of a plant that shows only its truth, by the trapezoidal rule; forces are those of `after`.

    rolling: (wheels,) resistance over load, against the wheel's rotation.
    """
    dt_s, n = after.time_s - before.time_s, robot.driven
    omega = 0.5 * (before.wheel_speed_rad_s + after.wheel_speed_rad_s)
    centre = 0.5 * (before.wheel_centre_speed_m_s + after.wheel_centre_speed_m_s)
    torque = after.torque_N_m[:n]
    current_A = torque / robot.motor.wheel_constant_Nm_per_A
    copper = float(np.sum(copper_loss(robot.motor, current_A))) * dt_s
    electrical = copper + float(torque @ omega[:n]) * dt_s
    slip_speed = robot.wheel.radius_m * omega - centre
    sideways = _sideways(after, robot)
    slip = float(after.traction_N @ slip_speed - after.lateral_N @ sideways) * dt_s
    resisted = float(np.sum(rolling * after.normal_N * np.abs(robot.wheel.radius_m * omega))) * dt_s
    drive = float(sum(friction_torque(robot.motor, current_A[k], omega[k]) * omega[k] for k in range(n))) * dt_s
    moved = after.position_m[:2] - before.position_m[:2]
    climb = robot.mass_kg * GRAVITY * float(np.sin(after.grade_rad)) * float(moved[0])
    kinetic = kinetic_energy(after, robot) - kinetic_energy(before, robot)
    left = electrical - copper - drive - slip - resisted - climb - kinetic
    return Work(electrical, copper, drive, slip, resisted, climb, kinetic, left)


def kinetic_energy(truth: RobotTruth, robot: Robot) -> float:
    """Energy [J] of body and wheels, all of which may turn at their own speed."""
    body = robot.mass_kg * (truth.speed_m_s**2 + truth.lateral_speed_m_s**2)
    rotors = np.where([p.driven for p in robot.places], robot.motor.inertia_at_wheel_kg_m2, 0.0)
    wheels = (robot.wheel.inertia_kg_m2 + rotors) @ truth.wheel_speed_rad_s**2
    return 0.5 * float(body + robot.yaw_inertia_kg_m2 * truth.yaw_rate_rad_s**2 + wheels)


def _sideways(truth: RobotTruth, robot: Robot) -> np.ndarray:
    """(wheels,) travel speed of the wheels' centres to their left [m/s]."""
    x = np.array([p.x_m for p in robot.places])
    return truth.lateral_speed_m_s + x * truth.yaw_rate_rad_s
