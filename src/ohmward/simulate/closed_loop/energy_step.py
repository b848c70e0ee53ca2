"""Energy balance of one step of a plant of which only the truth is known."""

from __future__ import annotations

import numpy as np

from ohmward.simulate.robot_truth import RobotTruth
from ohmward.traction.dynamics.energy_balance import EnergyBalance, kinetic_energy
from ohmward.traction.robot.motor import copper_loss, friction_torque
from ohmward.traction.robot.robot import GRAVITY, Robot


def energy_step(before: RobotTruth, after: RobotTruth, robot: Robot, rolling: np.ndarray) -> EnergyBalance:
    """Energy balance [J] of the motors between two truths, by the trapezoidal rule; forces are those of `after`.

    `numerical` is what the other terms leave.

    rolling: (wheels,) resistance over load, against the wheel's rotation.
    """
    dt_s, n = after.time_s - before.time_s, robot.driven
    omega = 0.5 * (before.wheel_speed_rad_s + after.wheel_speed_rad_s)
    centre = 0.5 * (before.wheel_centre_speed_m_s + after.wheel_centre_speed_m_s)
    torque = after.torque_N_m[:n]
    current_A = torque / robot.motor.wheel_constant_Nm_per_A
    rim = robot.wheel.radius_m * omega
    moved_m = after.position_m[:2] - before.position_m[:2]

    copper = float(np.sum(copper_loss(robot.motor, current_A))) * dt_s
    electrical = copper + float(torque @ omega[:n]) * dt_s
    drive = float(sum(friction_torque(robot.motor, current_A[k], omega[k]) * omega[k] for k in range(n))) * dt_s
    slip = float(after.traction_N @ (rim - centre) - after.lateral_N @ _sideways(after, robot)) * dt_s
    resisted = float(np.sum(rolling * after.normal_N * np.abs(rim))) * dt_s
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
        kinetic=kinetic,
        numerical=electrical - copper - drive - slip - resisted - climb - kinetic,
    )


def _kinetic_energy(truth: RobotTruth, robot: Robot) -> float:
    """Kinetic energy [J] of body and wheels, all of which may turn at their own speed."""
    motion = [truth.speed_m_s, truth.lateral_speed_m_s, truth.yaw_rate_rad_s]
    body = [robot.mass_kg, robot.mass_kg, robot.yaw_inertia_kg_m2]
    rotors = np.where([p.driven for p in robot.places], robot.motor.inertia_at_wheel_kg_m2, 0.0)
    inertia = np.concatenate([body, robot.wheel.inertia_kg_m2 + rotors])
    return float(kinetic_energy(np.concatenate([motion, truth.wheel_speed_rad_s]), inertia))


def _sideways(truth: RobotTruth, robot: Robot) -> np.ndarray:
    """(wheels,) travel speed of the wheels' centres to their left [m/s]."""
    x_m = np.array([p.x_m for p in robot.places])
    return truth.lateral_speed_m_s + x_m * truth.yaw_rate_rad_s
