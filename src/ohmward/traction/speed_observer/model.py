"""The robot as a filter sees it: next state, process noise, outputs, and the belief that it starts from.

Ground, grade and offsets are Gauss-Markov states (Ornstein-Uhlenbeck processes): they drift by their random walk and
return to their usual values, so one that is not observable for hours is as uncertain as before the first sample, never
more:

    x+ = e^(-dt/T) x + w,   Var w = sigma^2 (1 - e^(-2 dt/T)),   T = 2 sigma^2 / walk^2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import widen
from ohmward.filters.linear_algebra import mirror_lower, std
from ohmward.trace import Scalar, exp, isfinite, maximum, minimum, sqrt, where
from ohmward.traction.dynamics.forces import RobotInput, Scene, normal_loads
from ohmward.traction.motion.sample import LEAST_DIVISOR, CleanSample, SensorStds
from ohmward.traction.robot.robot import GRAVITY, motion_from_wheels
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.slip_step import SlipStep, grip, slip_step, traction, without_traction
from ohmward.traction.speed_observer.states import StateLayout, States

#: Acceleration [m/s^2] that is possible in a gap, and the largest change [m/s] of the speed in it.
UNKNOWN_M_S2, UNKNOWN_M_S = 3.0, 3.0

#: Share of a gap's change of speed by which a wheel may slip after it.
GAP_SLIP = 0.3


class GaussMarkov(NamedTuple):
    """Standard deviation of a Gauss-Markov state, and its random walk over the root of a second."""

    std: float
    walk: float


@dataclass(frozen=True)
class Model:
    """Robot, ground, states and noise."""

    scene: Scene  #: robot, and the terrain that it is assumed to drive on
    states: States  #: what is estimated besides the robot's own state
    noise: ObserverNoise  #: of sensors and model

    @cached_property
    def layout(self) -> StateLayout:
        """Order of the state vector."""
        return StateLayout(self.scene.robot, self.states)

    @property
    def driven(self) -> int:
        """Number of driven wheels."""
        return self.scene.robot.driven

    @cached_property
    def given_stds(self) -> SensorStds:
        """Given standard deviations of the sensors."""
        noise, robot = self.noise, self.scene.robot
        passive = [noise.passive_std_rad_s] * (len(robot.places) - robot.driven)
        encoders = [noise.encoder_std_rad_s] * robot.driven + [
            passive_std for passive_std in passive if passive_std is not None
        ]
        gyro = [] if noise.gyro_std_rad_s is None else [noise.gyro_std_rad_s]
        return SensorStds(np.array(encoders), np.full(robot.driven, noise.torque_std_Nm), np.array(gyro))

    def stds(self, clean: CleanSample) -> SensorStds:
        """Standard deviations of the sensors in a sample: matched, or the given ones."""
        return clean.stds or self.given_stds

    def first_belief(self, wheel_speed_rad_s: np.ndarray) -> Belief:
        """First belief: the body moves as the driven wheels (driven,) show."""
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
        return known.get(name) or self.gauss_markov(name).std or wheel

    def gauss_markov(self, name: str) -> GaussMarkov:
        """Standard deviation and walk of a state of ground or sensors; 0 for one of the robot's own."""
        noise = self.noise
        known = {
            "log_friction": GaussMarkov(noise.friction_std, noise.friction_walk),
            "log_stiffness": GaussMarkov(noise.stiffness_std, noise.stiffness_walk),
            "grade_rad": GaussMarkov(noise.grade_std_rad, noise.grade_walk),
            "rolling_excess": GaussMarkov(noise.rolling_std, noise.rolling_walk),
            "radius_ratio": GaussMarkov(noise.radius_std, 0.0),
        }
        return known.get(name, GaussMarkov(0.0, 0.0))

    def std_of(self, name: str, P: np.ndarray) -> Scalar:
        """Standard deviation of a state of ground or sensors; 0 for one that is assumed."""
        if name not in self.layout.names:
            return 0.0
        i = self.layout.index(name)
        return std(P[i, i])

    def decay_factor(self, name: str, dt_s: Scalar) -> Scalar:
        """e^(-dt/T) of a Gauss-Markov state; 1 for one without a random walk."""
        known = self.gauss_markov(name)
        return exp(-dt_s * (known.walk**2 / (2 * known.std**2))) if known.walk else 1.0

    def process_variance(self, name: str, dt_s: Scalar) -> Scalar:
        """sigma^2 (1 - e^(-2 dt/T)) of a Gauss-Markov state."""
        decay = self.decay_factor(name, dt_s)
        return self.gauss_markov(name).std ** 2 * (1.0 - decay * decay)

    def with_unknown_mass(self, belief: Belief) -> Belief:
        """The belief with a grade no surer than the mass allows: sigma >= sigma_m |F| / (m g), with the traction F."""
        if self.noise.mass_std is None or not self.states.grade:
            return belief
        i, robot = self.layout.index("grade_rad"), self.scene.robot
        force_N = robot.rolling[: self.driven, 0] @ self.traction_N(belief.mean)
        slope_rad = self.noise.mass_std * force_N / (robot.inertia[0] * GRAVITY)
        return widen(belief, i, slope_rad**2)

    def slip_step(self, x: np.ndarray, clean: CleanSample, start_m_s: np.ndarray | None = None) -> SlipStep:
        """Step of body and wheels from state x (n,); start_m_s as in `slip_step`."""
        return slip_step(self.layout.split(x), self.input(x, clean), self.scene, clean.modelled_s, start_m_s)

    def next_state(self, x: np.ndarray, clean: CleanSample, start_m_s: np.ndarray | None = None) -> np.ndarray:
        """Mean of the state after the step, (n,)."""
        step = self.slip_step(x, clean, start_m_s)
        first = self.layout.robot_states
        walking = zip(self.layout.names[first:], x[first:], strict=True)
        decayed = [self.decay_factor(name, clean.dt_s) * value for name, value in walking]
        return np.array([*step.motion, *step.omega, *decayed])

    def input(self, x: np.ndarray, clean: CleanSample) -> RobotInput:
        """Input of the robot; the grade is the state's, else the measured pitch, else level."""
        grade = self.layout.split(x).grade_rad
        if grade is None:
            grade = 0.0
            if self.noise.pitch_std_rad is not None:
                grade = where(isfinite(clean.pitch_rad), clean.pitch_rad, 0.0)
        return RobotInput(clean.current_A, grade)

    def process_noise(self, step: SlipStep, clean: CleanSample) -> np.ndarray:
        """Q (n, n) of a step; errors of torque and traction go through the model, where a gripping wheel damps them.

        Q = diag(random walks) + B B' + C C' + g^2 D,  B: `torque_noise`, C: `curve_shape_noise`, D: `gap_covariance`
        """
        own = self.layout.robot_states
        walking = [self.process_variance(name, clean.dt_s) for name in self.layout.names[own:]]
        Q = np.diag(np.array([*self.motion_variances(clean), *walking]))
        B = self.torque_noise(step, clean)
        C = self.curve_shape_noise(step, clean)
        gap = minimum(UNKNOWN_M_S2 * clean.unmodelled_s, UNKNOWN_M_S)
        within = where(clean.unmodelled_s > 0.0, 0.0, 1.0)  # D includes the effect of torques in a gap
        Q[:own, :own] = Q[:own, :own] + within * (B @ B.T) + C @ C.T + gap**2 * self.gap_covariance
        return mirror_lower(Q)

    def motion_variances(self, clean: CleanSample) -> list[Scalar]:
        """Variances that the robot's own states gain from unknown accelerations."""
        speed = self.noise.speed_walk**2 * clean.modelled_s
        yaw_rate = self.noise.yaw_rate_walk**2 * clean.modelled_s
        freedoms = self.scene.robot.chassis.freedoms
        return [*(yaw_rate if name == "yaw_rate_rad_s" else speed for name in freedoms), *[0.0] * self.driven]

    @cached_property
    def gap_covariance(self) -> np.ndarray:
        """D (own, own) of the robot's own states after a gap in which the speed may have changed by 1 m/s.

        Body and wheels change together, as gripping wheels do, except for GAP_SLIP of it.
        """
        robot = self.scene.robot
        arm_m = float(np.max(np.abs(robot.rolling[:, -1])))
        body = [1.0 / arm_m if name == "yaw_rate_rad_s" else 1.0 for name in robot.chassis.freedoms]
        together = np.vstack([np.eye(len(body)), robot.rolling[: self.driven] / robot.wheel.radius_m]) * np.array(body)
        slip = [0.0] * len(body) + [(GAP_SLIP / robot.wheel.radius_m) ** 2] * self.driven
        return together @ together.T + np.diag(slip)

    def torque_noise(self, step: SlipStep, clean: CleanSample) -> np.ndarray:
        """B (freedoms + driven, driven): change of body and wheels by one sigma of torque on each driven wheel.

        If a current is not measured, its torque may be anything that the ground takes.
        """
        most_Nm = self.scene.robot.wheel.radius_m * self.static_load_N[: self.driven]
        usual_Nm = self.stds(clean).torque_Nm
        return step.torque_response * where(clean.current_measured, usual_Nm, maximum(usual_Nm, most_Nm))

    def torque_noise_rad_s(self, step: SlipStep, clean: CleanSample) -> np.ndarray:
        """Standard deviation (driven,) of each wheel's predicted speed by the error of its own torque."""
        return np.diag(self.torque_noise(step, clean)[self.scene.robot.freedoms :])

    def curve_shape_noise(self, step: SlipStep, clean: CleanSample) -> np.ndarray:
        """C (freedoms + driven, driven): change of body and wheels by one sigma of the friction curve's shape.

        Friction and stiffness fix a friction law at its two ends, not its curvature in between, where a wheel then
        seems to measure a speed that it does not. An error that lasts for T counts like white noise sqrt(2 T/dt) times
        as large.
        """
        if not self.states.friction:
            return np.zeros_like(step.force_response)
        white = sqrt(2 * self.noise.curve_shape_correlation_s / maximum(clean.modelled_s, LEAST_DIVISOR))
        std_N = step.nonlinear_N * (self.noise.curve_shape_std * white)
        return step.force_response * std_N

    def encoder_lag(self, before: np.ndarray, after: np.ndarray, step: SlipStep) -> np.ndarray:
        """Speed (wheels,) [rad/s] of each wheel at the end of a step, less the one that its encoder shows.

        An encoder that counts shows the mean speed over the step, `encoder_lag_share` 0.5. Body and spinning wheels
        change their speed evenly, so half of their change is still to come. The slip of a gripping wheel settles with T
        = dt/(D - 1), n = dt/T: the implicit step ends after n/(1 + n) of the slip's whole change, ahead of the mean by
        (1 - e^-n)/n - 1/(1 + n) of it. Half of (2/(1 + D))^2 of the change made equals that to within 0.025.

        before, after: (n,) means of the state; step: the one between them.
        """
        robot = self.scene.robot
        change = after - before
        rolling = robot.rolling @ change[: robot.freedoms] / robot.wheel.radius_m
        slipping = change[robot.freedoms : self.layout.robot_states] - rolling[: self.driven]
        unsettled = (2.0 / (1.0 + step.damping)) ** 2
        driven = rolling[: self.driven] + slipping * unsettled
        return self.noise.encoder_lag_share * np.concatenate([driven, rolling[self.driven :]])

    def slip(self, x: np.ndarray) -> np.ndarray:
        """Slip speed (driven,) [m/s] in state x (n,)."""
        parts, robot = self.layout.split(x), self.scene.robot
        return robot.wheel.radius_m * parts.radius_ratio * parts.omega - robot.rolling[: self.driven] @ parts.motion

    def traction_N(self, x: np.ndarray) -> np.ndarray:
        """Traction (driven,) [N] in state x (n,)."""
        return traction(self.slip(x), self.layout.split(x), self.static_load_N, self.scene)

    def grip(self, x: np.ndarray, slip_m_s: np.ndarray) -> np.ndarray:
        """Grip (driven,) in [0, 1] of wheels at these slip speeds (driven,)."""
        return grip(slip_m_s, self.layout.split(x), self.static_load_N, self.scene)

    def usual_rolling_N(self, x: np.ndarray, clean: CleanSample) -> Scalar:
        """Usual rolling resistance along x in state x."""
        parts = self.layout.split(x)._replace(rolling_ratio=1.0)
        forces = without_traction(parts, self.input(x, clean), self.scene, self.static_load_N)
        return self.scene.robot.rolling[:, 0] @ forces.rolling_N

    def passive_speed(self, k: int) -> Callable[[np.ndarray], np.ndarray]:
        """Speed (1,) [rad/s] of wheel k, which is not driven, as a function of the state."""
        robot = self.scene.robot

        def speed(x: np.ndarray) -> np.ndarray:
            parts = self.layout.split(x)
            return np.array([robot.rolling[k] @ parts.motion / (robot.wheel.radius_m * parts.radius_ratio)])

        return speed

    @cached_property
    def static_load_N(self) -> np.ndarray:
        """Loads (wheels,) on level ground."""
        return normal_loads(RobotInput(0.0), self.scene.robot, np.zeros(2))
