"""The robot and the ground in MuJoCo: torques in, truth out.

Grade tilts gravity, not the ground. Contacts, rigid bodies and integrator are MuJoCo's own; ours are the numbers in
`mjcf` that make a contact behave as a wheel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ohmward.checks import require_between, require_finite, require_positive
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.traction.dynamics.slip import slip_ratio, slip_speed
from ohmward.traction.robot.robot import GRAVITY
from ohmward_lab.simulate.mujoco_plant.ground import ROUGHEST, STEEPEST_GRADE_RAD, Ground, uniform
from ohmward_lab.simulate.mujoco_plant.mjcf import contact_stiffness, robot_xml, stable_step_s
from ohmward_lab.simulate.mujoco_plant.parameters import RlmaParameters
from ohmward_lab.simulate.robot_sensors import RobotTruth, driven_torques, stack

_BODY = 1
_WHEELS = slice(2, 6)


class RlmaPlant:
    """The robot on a ground. Nothing in it is random: the same torques give the same truth.

    Args:
        parameters: of the robot.
        ground: it drives on, by default level and dry.
        longest_step_s: of the physics; `step` divides longer steps.

    Raises:
        InputError: MuJoCo is not installed, or the step is so long that the slip of the wheels swings.
    """

    def __init__(
        self,
        parameters: RlmaParameters | None = None,
        ground: Ground | None = None,
        longest_step_s: float = 1e-3,
    ) -> None:
        self.parameters = parameters or RlmaParameters()
        self.ground = ground or uniform(0.8)
        self._longest_step_s = longest_step_s
        self._mujoco = require("mujoco", "this plant")
        self._model = _model(self.parameters, self._mujoco)
        stable_s = stable_step_s(self.parameters, self._model.body_invweight0[_WHEELS, 0])
        require_between("longest_step_s", longest_step_s, 1e-5, stable_s)
        self._data = self._mujoco.MjData(self._model)
        self._friction = self._model.pair_friction[:, :2].T
        self.reset()

    def reset(self, speed_m_s: float = 0.0, heading_rad: float = 0.0) -> RobotTruth:
        """Put the robot back to the origin, rolling without slip at `speed_m_s`; the truth there."""
        require_between("speed_m_s", speed_m_s, -10.0, 10.0)
        require_finite("heading_rad", heading_rad)
        d = self._data
        self._mujoco.mj_resetData(self._model, d)
        d.qpos[3:7] = math.cos(0.5 * heading_rad), 0.0, 0.0, math.sin(0.5 * heading_rad)
        d.qvel[:2] = speed_m_s * math.cos(heading_rad), speed_m_s * math.sin(heading_rad)
        d.qvel[6:] = speed_m_s / self.parameters.wheel_radius_m
        return self._settled()

    def step(self, torque_N_m: Any, dt_s: float) -> RobotTruth:
        """Hold the torque for `dt_s`; the truth at the end, its forces and accelerations still under this torque.

        torque_N_m: of each driven wheel, a number or one for each in the order of `parameters.driven`.

        Raises:
            InputError: another number of torques, a number that is not finite, dt_s <= 0, ground out of its range.
        """
        require_positive("dt_s", dt_s)
        driven = self.parameters.driven
        self._data.ctrl[list(driven)] = driven_torques(torque_N_m, driven)
        parts = math.ceil(dt_s / self._longest_step_s - 1e-9)
        self._model.opt.timestep = dt_s / parts
        for _ in range(parts):
            self._surroundings()
            self._mujoco.mj_step(self._model, self._data)
        return self._settled()

    def _surroundings(self) -> float:
        """Set friction, gravity and drag of the next step; the grade."""
        d, p = self._data, self.parameters
        self._friction[:] = self.ground.friction(d.time, d.xpos[_WHEELS, :2])
        grade = float(self.ground.grade_rad(d.time, d.xpos[_BODY, :2]))
        _check_ground(self._friction[0].tolist(), grade)
        self._model.opt.gravity[:] = -GRAVITY * math.sin(grade), 0.0, -GRAVITY * math.cos(grade)
        if p.drag_N_s2_per_m2:
            vx, vy = d.qvel[:2]
            factor = -p.drag_N_s2_per_m2 * math.hypot(vx, vy)
            d.xfrc_applied[_BODY, :2] = factor * vx, factor * vy
        return grade

    def _settled(self) -> RobotTruth:
        """Forces and accelerations for the present state, and the truth."""
        self._mujoco.mj_kinematics(self._model, self._data)
        grade = self._surroundings()
        self._mujoco.mj_forward(self._model, self._data)
        return _truth(self._data, self.parameters, self._friction[0].copy(), grade)


def drive(
    plant: RlmaPlant, torque_N_m: float | Callable[[RobotTruth], Any], duration_s: float, dt_s: float = 0.01
) -> RobotTruth:
    """Reset the plant, drive for `duration_s` and stack the truth, (T, ...), the start included.

    torque_N_m: a number, or a controller, asked every `dt_s` with the truth.

    Raises:
        InputError: as `RlmaPlant.step`.
    """
    truths = [plant.reset()]
    for _ in range(round(duration_s / dt_s)):
        torque = torque_N_m(truths[-1]) if callable(torque_N_m) else torque_N_m
        truths.append(plant.step(torque, dt_s))
    return stack(truths)


def _truth(d: Any, p: RlmaParameters, friction: np.ndarray, grade_rad: float) -> RobotTruth:
    cos, sin = _heading(d)
    forward, left = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])
    speed, yaw_rate = float(d.qvel[:3] @ forward), float(d.sensordata[2])
    wheel_speed = d.qvel[6:].copy()
    centre_speed = speed - p.wheel_position_m[:, 1] * yaw_rate
    rolling = p.wheel_radius_m * wheel_speed
    force = ground_forces(d)
    return RobotTruth(
        time_s=d.time,
        position_m=d.qpos[:3].copy(),
        heading_rad=math.atan2(sin, cos),
        speed_m_s=speed,
        lateral_speed_m_s=float(d.qvel[:3] @ left),
        yaw_rate_rad_s=yaw_rate,
        wheel_angle_rad=d.qpos[7:].copy(),
        wheel_speed_rad_s=wheel_speed,
        torque_N_m=d.ctrl.copy(),
        wheel_centre_speed_m_s=centre_speed,
        slip_speed_m_s=slip_speed(rolling, centre_speed),
        slip_ratio=slip_ratio(rolling, centre_speed),
        traction_N=force @ forward,
        lateral_N=force @ left,
        normal_N=force[:, 2],
        friction=friction,
        grade_rad=grade_rad,
        gyro_rad_s=d.sensordata[:3].copy(),
        specific_force_m_s2=d.sensordata[3:6].copy(),
    )


def ground_forces(d: Any) -> np.ndarray:
    """(4, 3) force of the ground on each wheel in the world [N], zero for a wheel that does not touch it."""
    force = np.zeros((4, 3))
    contact = d.contact
    rows = contact.efc_address[:, None] + np.arange(3)
    frames = contact.frame.reshape(-1, 3, 3)
    force[contact.geom[:, 1] - 1] = np.einsum("ci,cij->cj", d.efc_force[rows], frames)
    return force


def _heading(d: Any) -> tuple[float, float]:
    """Cosine and sine of the heading: the body's x axis, seen from above."""
    x, y = d.xmat[_BODY, 0], d.xmat[_BODY, 3]
    length = math.hypot(x, y)
    return x / length, y / length


def _check_ground(friction: list[float], grade_rad: float) -> None:
    if not all(0 < mu <= ROUGHEST for mu in friction):
        raise InputError(f"ground.friction must return values in (0, {ROUGHEST:g}], got {friction}")
    if not abs(grade_rad) <= STEEPEST_GRADE_RAD:
        raise InputError(f"ground.grade_rad must return a value within ± {STEEPEST_GRADE_RAD:g}, got {grade_rad}")


def _model(p: RlmaParameters, mujoco: Any) -> Any:
    model = mujoco.MjModel.from_xml_string(robot_xml(p))
    model.pair_solref[:], model.pair_solreffriction[:] = contact_stiffness(p, model.body_invweight0[_WHEELS, 0])
    return model
