"""The robot as a filter sees it: how its state moves in a step, how far that may be wrong, and what it starts from.

Ground, grade and offsets are Ornstein-Uhlenbeck processes: they wander by their walk and return to what is usual, so a
quantity that nothing shows for hours is as unknown as before the first sample, and never more:

    x+ = e^(-dt/T) x + w,   Var w = sigma^2 (1 - e^(-2 dt/T)),   T = 2 sigma^2 / walk^2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import exp, maximum, minimum, sin, sqrt, where
from ohmward.traction.dynamics.forces import RobotInput, Scene, momentum_rates, normal_loads
from ohmward.traction.robot.robot import GRAVITY, motion_from_wheels
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.slip_step import Moved, grip, slip_step, traction, without_traction
from ohmward.traction.speed_observer.states import StateLayout, States

#: What the speed may change by in a second of which nothing is known [m/s^2], and at most [m/s].
UNKNOWN_M_S2, UNKNOWN_M_S = 3.0, 3.0

#: A steeper pitch [rad] is a sensor's fault.
STEEPEST_RAD = 1.5

_TINY_S = 1e-9


@dataclass(frozen=True)
class Model:
    """Robot, ground, states and noise.

    Attributes:
        scene: robot, and the terrain that it is believed to drive on.
        states: what is estimated besides the robot's own state.
        noise: how wrong sensors and model may be.
    """

    scene: Scene
    states: States
    noise: ObserverNoise

    @cached_property
    def layout(self) -> StateLayout:
        """Which element of the state is what."""
        return StateLayout(self.scene.robot, self.states)

    @property
    def driven(self) -> int:
        """Number of driven wheels."""
        return self.scene.robot.driven

    def first_belief(self, wheel_speed_rad_s: np.ndarray) -> Belief:
        """A body that moves as the driven wheels (driven,) say."""
        robot, names = self.scene.robot, self.layout.names
        own = np.concatenate([motion_from_wheels(robot, wheel_speed_rad_s), wheel_speed_rad_s])
        mean = np.array([*own, *(1.0 if name == "radius_ratio" else 0.0 for name in names[len(own) :])])
        return Belief(mean, np.diag([self.initial_std(name) ** 2 for name in names]))

    def initial_std(self, name: str) -> float:
        """Standard deviation of a state before the first sample."""
        noise = self.noise
        known = {
            "yaw_rate_rad_s": noise.initial_yaw_rate_std_rad_s,
            "v_m_s": noise.initial_speed_std_m_s,
            "v_left_m_s": noise.initial_speed_std_m_s,
        }
        wheel = noise.initial_speed_std_m_s / self.scene.robot.wheel.radius_m + noise.encoder_std_rad_s
        return known.get(name) or self.lasting(name)[0] or wheel

    def lasting(self, name: str) -> tuple[float, float]:
        """Standard deviation and walk of a state that the robot's motion does not change; 0 for one that it does."""
        noise = self.noise
        if name.startswith("log_friction"):
            return noise.friction_std, noise.friction_walk
        return {
            "log_stiffness": (noise.stiffness_std, noise.stiffness_walk),
            "grade_rad": (noise.grade_std_rad, noise.grade_walk),
            "rolling_excess": (noise.rolling_std, noise.rolling_walk),
            "radius_ratio": (noise.radius_std, 0.0),
            "accelerometer_offset_m_s2": (noise.accelerometer_offset_std_m_s2, 0.0),
        }.get(name, (0.0, 0.0))

    def kept(self, name: str, dt_s: Any) -> Any:
        """Share of a lasting state that is left after `dt_s`."""
        std, walk = self.lasting(name)
        return exp(-dt_s * (walk**2 / (2 * std**2))) if walk else 1.0

    def walked(self, name: str, dt_s: Any) -> Any:
        """Variance that a lasting state gains in `dt_s`."""
        kept = self.kept(name, dt_s)
        return self.lasting(name)[0] ** 2 * (1.0 - kept * kept)

    def moved(self, x: np.ndarray, reading: CleanSlipSample, start_m_s: np.ndarray | None = None) -> Moved:
        """Body and wheels after the step from state x (n,); start_m_s as in `slip_step`."""
        return slip_step(self.layout.split(x), self.input(x, reading), self.scene, reading.moving_s, start_m_s)

    def next_state(self, x: np.ndarray, reading: CleanSlipSample, start_m_s: np.ndarray | None = None) -> np.ndarray:
        """Mean of the state after the step, (n,)."""
        moved = self.moved(x, reading, start_m_s)
        own = [*moved.motion, *moved.omega]
        names = self.layout.names
        return np.array([*own, *(self.kept(names[i], reading.dt_s) * x[i] for i in range(len(own), len(names)))])

    def input(self, x: np.ndarray, reading: CleanSlipSample) -> RobotInput:
        """What acts on the robot; the grade is the state's, else the measured one, else level."""
        grade = self.layout.split(x).grade_rad
        if grade is None:
            grade = 0.0
            if self.noise.pitch_std_rad is not None:
                grade = where(abs(reading.pitch_rad) <= STEEPEST_RAD, reading.pitch_rad, 0.0)
        return RobotInput(reading.current_A, grade)

    def process_noise(self, mean: np.ndarray, reading: CleanSlipSample) -> np.ndarray:
        """Q (n, n) of a step; unknown torque and traction go through the model, where a wheel that grips damps them."""
        robot, noise = self.scene.robot, self.noise
        moved = self.moved(mean, reading)
        B = self.torque_response(moved, reading)
        unknown = minimum(UNKNOWN_M_S2 * reading.unknown_s, UNKNOWN_M_S) ** 2
        arm_m = float(np.max(np.abs(robot.rolling[:, -1])))
        diagonal = [
            noise.yaw_rate_walk**2 * reading.moving_s + unknown / arm_m**2
            if name == "yaw_rate_rad_s"
            else noise.speed_walk**2 * reading.moving_s + unknown
            for name in self.layout.names[: robot.freedoms]
        ]
        diagonal += [unknown / robot.wheel.radius_m**2] * self.driven
        diagonal += [self.walked(name, reading.dt_s) for name in self.layout.names[len(diagonal) :]]
        Q = np.diag(np.array(diagonal))
        own = robot.freedoms + self.driven
        C = self.curve_shape_noise(moved, reading)
        Q[:own, :own] = Q[:own, :own] + B @ B.T + C @ C.T
        return mirror_lower(Q)

    def torque_response(self, moved: Moved, reading: CleanSlipSample) -> np.ndarray:
        """Change (freedoms + driven, driven) of body and wheels in a step by a torque that is wrong by one sigma."""
        most_Nm = self.scene.robot.wheel.radius_m * self.static_load_N[: self.driven]
        return moved.torque_response * (self.noise.torque_std_Nm + reading.guessed * most_Nm)

    def torque_noise_rad_s(self, moved: Moved, reading: CleanSlipSample) -> np.ndarray:
        """(driven,) standard deviation of what a wrong torque adds to each wheel's speed at the end of the step."""
        return np.diag(self.torque_response(moved, reading)[self.scene.robot.freedoms :])

    def encoder_lag(self, before: np.ndarray, after: np.ndarray, moved: Moved) -> np.ndarray:
        """By how much (wheels,) [rad/s] each wheel is faster at the end of a step than where its encoder saw it.

        before, after: (n,) means of the state; moved: the step between them.

        Body and spinning wheels change their speed all along the step. The slip of a wheel that grips settles at once,
        and its encoder has seen most of the step at the new slip. Where it settles with T, the implicit step's end is
        later than the mean over the step by (1 - e^-n)/n - 1/(1 + n) of the whole change, n = dt/T = damping - 1; the
        factor below is that to within 0.025.
        """
        robot, n = self.scene.robot, self.driven
        share, parts = self.noise.encoder_lag_share, self.layout.split(after - before)
        rolled = robot.rolling @ parts.motion / robot.wheel.radius_m
        slipped = (parts.omega - rolled[:n]) * (2.0 / (1.0 + moved.damping)) ** 2
        return share * np.concatenate([rolled[:n] + slipped, rolled[n:]])

    def curve_shape_noise(self, moved: Moved, reading: CleanSlipSample) -> np.ndarray:
        """Change (freedoms + driven, driven) of body and wheels in a step by a law that bends otherwise, one sigma.

        Friction and stiffness fit a law at its two ends; how it bends in between stays unknown, and a wheel there seems
        to show a speed that it does not. An error that lasts for T weighs as white noise sqrt(2 T/dt) times as large.
        """
        if self.states.friction == "known":
            return np.zeros_like(moved.force_response)
        lasting = sqrt(2 * self.noise.curve_shape_correlation_s / maximum(reading.moving_s, _TINY_S))
        return moved.force_response * (moved.bend_N * (self.noise.curve_shape_std * lasting))

    def slip(self, x: np.ndarray) -> np.ndarray:
        """Slip speed (driven,) [m/s] in state x (n,)."""
        parts, robot = self.layout.split(x), self.scene.robot
        return robot.wheel.radius_m * parts.radius_ratio * parts.omega - robot.rolling[: self.driven] @ parts.motion

    def traction_N(self, x: np.ndarray) -> np.ndarray:
        """Force (driven,) [N] of the ground on the driven wheels in state x (n,)."""
        return traction(self.slip(x), self.layout.split(x), self.static_load_N, self.scene)

    def grip(self, x: np.ndarray, slip_m_s: np.ndarray) -> np.ndarray:
        """(driven,) in [0, 1], of wheels that slip so."""
        return grip(slip_m_s, self.layout.split(x), self.static_load_N, self.scene)

    def specific_force(self, x: np.ndarray, reading: CleanSlipSample) -> np.ndarray:
        """What an accelerometer along x shows in state x, (1,) [m/s^2]."""
        parts, robot, n = self.layout.split(x), self.scene.robot, self.driven
        u = self.input(x, reading)
        own = x[: robot.freedoms + n]
        rolling = momentum_rates(own, u, self.scene, without_traction(parts, u, self.scene, self.static_load_N))
        push = rolling[0] + robot.rolling[:n, 0] @ self.traction_N(x)
        return np.array([push / robot.inertia[0] + GRAVITY * sin(u.grade_rad) + parts.accelerometer_offset])

    def passive_speed(self, k: int) -> Callable[[np.ndarray], np.ndarray]:
        """Speed (1,) [rad/s] of wheel k, which is not driven, as a function of the state."""
        robot = self.scene.robot

        def speed(x: np.ndarray) -> np.ndarray:
            parts = self.layout.split(x)
            return np.array([robot.rolling[k] @ parts.motion / (robot.wheel.radius_m * parts.radius_ratio)])

        return speed

    @cached_property
    def static_load_N(self) -> np.ndarray:
        """(wheels,) on level ground."""
        return normal_loads(RobotInput(0.0), self.scene.robot, np.zeros(2))
