"""Our own equations as a plant: any robot, any terrain under each wheel, load transfer; torques in, truth out.

It has the interface of `mujoco_plant.RlmaPlant`, so loops and sensors work with either.

Several terrains are mixed, weighted by their shares, so that one compiled step serves a wheel on any ground.

F = sum_k w_k F_k,   w_k the share of the contact that lies on terrain k
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_positive
from ohmward.trace import Kernel, cos, sin
from ohmward.traction.dynamics.forces import EnergyBalance, Forces, RobotInput, Scene, forces, momentum_rates, scene
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.friction.terrain import Terrain
from ohmward.traction.robot.robot import GRAVITY, Robot
from ohmward_lab.simulate.ground import Grade, Patch, adhesion, surface
from ohmward_lab.simulate.implicit_step import Step, step
from ohmward_lab.simulate.robot_sensors import RobotTruth, driven_torques


@dataclass(frozen=True)
class MixedLaw:
    """Weighted mean of laws of traction, or of rolling resistance."""

    laws: tuple[Any, ...]  #: (K,) of them
    shares: np.ndarray  #: (K,) weights, adding up to 1; may be traced

    def force_N(self, *at: Any) -> Any:
        """Force [N] of the ground, with the arguments of its laws."""
        return sum(w * law.force_N(*at) for w, law in zip(self.shares, self.laws, strict=True))


def terrain_mixture(terrains: Sequence[Terrain], shares: np.ndarray) -> Terrain:
    """Mixture of terrains with these shares (K,); a law that they have in common is evaluated once."""
    traction = [t.traction for t in terrains]
    rolling = [t.rolling for t in terrains]
    return Terrain(
        "terrain_mixture",
        traction[0] if _all_equal(traction) else MixedLaw(tuple(traction), shares),
        rolling[0] if _all_equal(rolling) else MixedLaw(tuple(rolling), shares),
        "scenario",
    )


def _all_equal(laws: Sequence[Any]) -> bool:
    return all(law == laws[0] for law in laws)


class PlantInput(NamedTuple):
    """Torques and ground of one step."""

    torque_Nm: Any  #: (driven,) of the motors at the wheels, before the losses of the drive
    #: of the ground, along the robot and to its left
    grade_rad: Any
    bank_rad: Any
    drag_N: Any  #: against the robot
    shares: Any  #: (wheels, grounds) of each ground under each wheel
    dt_s: Any  #: length of the step


class PlantView(NamedTuple):
    """Motion at the end of a step, for the truth and the sensors."""

    travel_m_s: Any  #: (wheels,) of the wheels' centres along their rolling direction
    rim_m_s: Any  #: (wheels,) of the rims
    slip_ratio: Any  #: (wheels,)
    specific_force_m_s2: Any  #: (3,) forward, left, up


class TractionPlant:
    """A robot on patches of ground. Nothing in it is random: the same torques give the same truth.

    Args:
        robot: any.
        patches: of the ground, dry asphalt where there are none.
        grade: along x.
        drag_N_s2_per_m2: drag over the square of the speed; it counts as a drawbar's pull.
        longest_step_s: of the implicit step; `step` divides longer ones.

    Raises:
        InputError: patches that overlap or name wheels that the robot does not have.
    """

    def __init__(
        self,
        robot: Robot,
        patches: Sequence[Patch] = (),
        grade: Grade | None = None,
        drag_N_s2_per_m2: float = 0.0,
        longest_step_s: float = 1e-3,
    ) -> None:
        require_positive("longest_step_s", longest_step_s)
        self.robot, self.grade = robot, grade or Grade()
        self.surface = surface(patches, [p.name for p in robot.places])
        grounds = [patch.ground(robot) for patch in self.surface.patches]
        self._terrains = [ground for k, ground in enumerate(grounds) if ground not in grounds[:k]]
        self._shares = np.array([[float(ground == terrain) for terrain in self._terrains] for ground in grounds])
        self._adhesion = np.array([adhesion(ground) for ground in grounds])
        self._arms = np.array([[p.x_m, p.y_m] for p in robot.places])
        self._longest_step_s, self._drag = longest_step_s, drag_N_s2_per_m2
        at_rest = PlantInput(np.zeros(robot.driven), 0.0, 0.0, 0.0, self._shares[[0] * len(robot.places)], 0.0)
        self._kernel = Kernel(
            partial(observed_step, robot=robot, terrains=self._terrains), np.zeros(len(robot.state_names)), at_rest
        )
        self.reset()

    def reset(self, speed_m_s: float = 0.0, heading_rad: float = 0.0) -> RobotTruth:
        """Put the robot back to the origin, rolling without slip at `speed_m_s`; return the truth there."""
        robot = self.robot
        motion = np.zeros(robot.freedoms)
        motion[0] = speed_m_s
        rolling = robot.rolling[: robot.driven] @ motion / robot.wheel.radius_m
        self._x = np.concatenate([motion, rolling])
        self._time_s, self._position_m, self._heading_rad = 0.0, np.zeros(3), heading_rad
        self._angle_rad = np.zeros(len(robot.places))
        self.energy = EnergyBalance()
        return self._advance(np.zeros(robot.driven), 0.0)

    def step(self, torque_N_m: Any, dt_s: float) -> RobotTruth:
        """Hold the torque for `dt_s`; return the truth at the end, with forces under this torque.

        `energy` is the balance [J] of this step.

        torque_N_m: of each driven wheel, a number or (driven,).

        Raises:
            InputError: a wrong number of torques, a number that is not finite, dt_s <= 0.
        """
        require_positive("dt_s", dt_s)
        torque = driven_torques(torque_N_m, tuple(range(self.robot.driven)))
        parts = math.ceil(dt_s / self._longest_step_s - 1e-9)
        self.energy = EnergyBalance()
        for _ in range(parts):
            truth = self._advance(torque, dt_s / parts)
        return truth

    def _advance(self, torque_Nm: np.ndarray, dt_s: float) -> RobotTruth:
        under = self._under()
        slope = self.grade.at(self._position_m[0])
        drag_N = self._drag * abs(self._x[0]) * self._x[0]
        u = PlantInput(torque_Nm, *tilt(slope, self._heading_rad), drag_N, self._shares[under], dt_s)
        before = self._x
        result, f, view = self._kernel(before, u)
        self._x = result.state
        self._move(0.5 * (before + self._x), dt_s)
        self.energy = self.energy.accumulate(result.energy)
        return self._truth(torque_Nm, f, view, self._adhesion[under], slope)

    def _under(self) -> list[int]:
        """Number of the patch under each wheel."""
        c, s = math.cos(self._heading_rad), math.sin(self._heading_rad)
        x_m = self._position_m[0] + self._arms @ np.array([c, -s])
        return list(self.surface.under(x_m.tolist(), self._time_s))

    def _move(self, mean: np.ndarray, dt_s: float) -> None:
        """Advance position and angles with the mean state of the step; wheels that are not driven roll."""
        robot = self.robot
        motion, driven_rad_s = mean[: robot.freedoms], mean[robot.freedoms :]
        forward, yaw_rate = motion[0], motion[-1]
        left = motion[1] if robot.freedoms == 3 else 0.0
        halfway = self._heading_rad + 0.5 * dt_s * yaw_rate
        c, s = math.cos(halfway), math.sin(halfway)
        self._position_m = self._position_m + dt_s * np.array([c * forward - s * left, s * forward + c * left, 0.0])
        self._heading_rad += dt_s * yaw_rate
        rolling_rad_s = robot.rolling @ motion / robot.wheel.radius_m
        self._angle_rad = self._angle_rad + dt_s * np.concatenate([driven_rad_s, rolling_rad_s[robot.driven :]])
        self._time_s += dt_s

    def _truth(self, torque: np.ndarray, f: Forces, view: PlantView, friction: np.ndarray, slope: float) -> RobotTruth:
        robot, x = self.robot, self._x
        return RobotTruth(
            time_s=self._time_s,
            position_m=self._position_m,
            heading_rad=self._heading_rad,
            speed_m_s=float(x[0]),
            lateral_speed_m_s=float(x[1]) if robot.freedoms == 3 else 0.0,
            yaw_rate_rad_s=float(x[robot.freedoms - 1]),
            wheel_angle_rad=self._angle_rad,
            wheel_speed_rad_s=view.rim_m_s / robot.wheel.radius_m,
            torque_N_m=np.concatenate([torque, np.zeros(len(robot.places) - robot.driven)]),
            wheel_centre_speed_m_s=view.travel_m_s,
            slip_speed_m_s=f.slip_speed_m_s,
            slip_ratio=view.slip_ratio,
            traction_N=f.traction_N,
            lateral_N=f.scrub_N,
            normal_N=f.load_N,
            friction=friction,
            grade_rad=slope,
            gyro_rad_s=np.array([0.0, 0.0, x[robot.freedoms - 1]]),
            specific_force_m_s2=view.specific_force_m_s2,
        )


def observed_step(
    x: np.ndarray, plant_input: PlantInput, robot: Robot, terrains: Sequence[Terrain]
) -> tuple[Step, Forces, PlantView]:
    """One implicit step, with forces and motion at its end."""
    p = scene(robot, *(terrain_mixture(terrains, shares) for shares in plant_input.shares))
    current_A = plant_input.torque_Nm / robot.motor.wheel_constant_Nm_per_A
    u = RobotInput(current_A, plant_input.grade_rad, plant_input.bank_rad, plant_input.drag_N)
    result = step(x, u, p, plant_input.dt_s)
    f = forces(result.state, u, p)
    motion = result.state[: robot.freedoms]
    travel = robot.rolling @ motion
    rim = np.concatenate([robot.wheel.radius_m * result.state[robot.freedoms :], travel[robot.driven :]])
    ratio = np.array([slip_ratio(a, b) for a, b in zip(rim, travel, strict=True)])
    return result, f, PlantView(travel, rim, ratio, specific_force(result.state, u, p, f))


def specific_force(x: np.ndarray, u: RobotInput, p: Scene, f: Forces) -> np.ndarray:
    """Specific force (3,) [m/s^2] of an ideal accelerometer: acceleration of the body's centre less gravity."""
    robot = p.robot
    rates = momentum_rates(x, u, p, f) / robot.inertia
    yaw_rate = x[robot.freedoms - 1]
    if robot.freedoms == 3:
        forward, left = rates[0] - yaw_rate * x[1], rates[1] + yaw_rate * x[0]
    else:
        forward, left = rates[0], yaw_rate * x[0]
    across = GRAVITY * cos(u.grade_rad)
    return np.array([forward + GRAVITY * sin(u.grade_rad), left + across * sin(u.bank_rad), across * cos(u.bank_rad)])


def tilt(slope_rad: float, heading_rad: float) -> tuple[float, float]:
    """Grade along a robot and bank to its left, on ground that leads up along x by `slope_rad`."""
    rise = math.sin(slope_rad)
    grade = math.asin(rise * math.cos(heading_rad))
    return grade, -math.asin(rise * math.sin(heading_rad) / math.cos(grade))
