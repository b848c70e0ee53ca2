"""The robot as its momentum: linear, without tyre and without friction.

dv/dt        = M^-1 (G' F - R) - g sin(pitch) - d          the last two along x only
J domega/dt  = tau - r F                                   each driven wheel
dahead/dt    = omega                                       driven wheels; v_wheel / r for the others
F+           = F + phi (tau+ - tau) / r + w                at each step

The force F of the ground is what the wheel's torque and acceleration leave over. It follows a change of torque fully
while the wheel grips and not at all while it spins; the share phi (`following`) is learnt as it goes, and forgotten in
`FOLLOWING_S`. The disturbance acceleration d is all that is unknown along x: rolling resistance, mass, slope. `ahead`
is the angle of a wheel beyond its last count, so numbers stay small however far the robot goes. The chains from d and F
to the angle have three links, so exp(A dt) ends after its square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.trace import clip, exp, sin
from ohmward.trace.expression import Scalar
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.momentum_observer.noise import MomentumNoise
from ohmward.traction.robot.robot import GRAVITY

#: Mean and standard deviation of `following` before anything is known, and its correlation time [s].
FOLLOWING, FOLLOWING_STD, FOLLOWING_S = 0.5, 0.5, 0.3


@dataclass(frozen=True)
class MomentumModel:
    """Robot, and the noise of its sensors and of the model; of the terrain only the rolling resistance is used."""

    scene: Scene
    noise: MomentumNoise

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the state, in order."""
        robot = self.scene.robot
        places = [p.name for p in robot.places]
        driven = places[: robot.driven]
        return (
            *robot.state_names,
            *(f"force_{name}_N" for name in driven),
            *(f"following_{name}" for name in driven),
            *(f"ahead_{name}_rad" for name in places[: self.counted]),
            "disturbance_m_s2",
            "accelerometer_offset_m_s2",
        )

    @property
    def counted(self) -> int:
        """Number of wheels with an encoder: the driven ones, or all."""
        robot = self.scene.robot
        return robot.driven if self.noise.passive_std_rad is None else len(robot.places)

    def wheel(self, k: int) -> int:
        """Index of the speed of driven wheel k."""
        return self.scene.robot.freedoms + k

    def force(self, k: int) -> int:
        """Index of the force on driven wheel k."""
        return self.scene.robot.freedoms + self.scene.robot.driven + k

    def following(self, k: int) -> int:
        """Index of the share phi of driven wheel k."""
        return self.scene.robot.freedoms + 2 * self.scene.robot.driven + k

    def ahead(self, k: int) -> int:
        """Index of the angle of counted wheel k."""
        return self.scene.robot.freedoms + 3 * self.scene.robot.driven + k

    @property
    def disturbance(self) -> int:
        """Index of the disturbance acceleration."""
        return self.names.index("disturbance_m_s2")

    @property
    def offset(self) -> int:
        """Index of the accelerometer's offset."""
        return self.names.index("accelerometer_offset_m_s2")

    @cached_property
    def rate(self) -> np.ndarray:
        """A (n, n) of dx/dt = A x + b."""
        robot, r = self.scene.robot, self.scene.robot.wheel.radius_m
        free, n = robot.freedoms, robot.driven
        A = np.zeros((len(self.names), len(self.names)))
        A[:free, free + n : free + 2 * n] = (robot.rolling[:n] / robot.inertia[:free]).T
        A[0, self.disturbance] = -1.0
        for k in range(self.counted):
            if k < n:
                A[self.wheel(k), self.force(k)] = -r / robot.inertia[free + k]
                A[self.ahead(k), self.wheel(k)] = 1.0
            else:
                A[self.ahead(k), :free] = robot.rolling[k] / r
        return A

    def drive(self, motion: np.ndarray, torque_Nm: np.ndarray, pitch_rad: Scalar) -> np.ndarray:
        """Vector b (n,) of torques (driven,), rolling resistance and slope."""
        robot, free = self.scene.robot, self.scene.robot.freedoms
        travel = robot.rolling @ motion
        R = [t.rolling.force_N(v, N) for t, v, N in zip(self.scene.terrains, travel, self.load_N, strict=True)]
        body = robot.rolling.T @ np.array(R) / robot.inertia[:free]
        wheels = torque_Nm / robot.inertia[free:]
        rest = np.zeros(len(self.names) - free - robot.driven)
        return np.array([body[0] - GRAVITY * sin(pitch_rad), *body[1:], *wheels, *rest])

    def follow(self, x: np.ndarray, change_N: np.ndarray, dt_s: Scalar) -> tuple[np.ndarray, np.ndarray]:
        """State (n,) and its Jacobian (n, n) after the torques over the radius have changed by dF (driven,) [N].

        F+ = F + clip(phi, 0, 1) dF,    phi+ = phi_0 + e^(-dt/T) (phi - phi_0)

        The Jacobian leaves the clip out, so that a phi outside of [0, 1] is still corrected.
        """
        decay = exp(-dt_s / FOLLOWING_S)
        jacobian = np.eye(len(self.names)).tolist()
        rest: list[Any] = [0.0] * len(self.names)
        for k, dF in enumerate(change_N):
            F, phi = self.force(k), self.following(k)
            jacobian[F][phi] = dF
            jacobian[phi][phi] = decay
            rest[F] = (clip(x[phi], 0.0, 1.0) - x[phi]) * dF
            rest[phi] = (1.0 - decay) * FOLLOWING
        S = np.array(jacobian)
        return S @ x + np.array(rest), S

    def transition(self, dt_s: Scalar) -> np.ndarray:
        """exp(A dt), (n, n), exact."""
        return np.eye(len(self.names)) + self.rate * dt_s + self.rate @ self.rate * (0.5 * dt_s * dt_s)

    def added(self, b: np.ndarray, dt_s: Scalar) -> np.ndarray:
        """Change (n,) of the state by a constant b over `dt_s`."""
        return b * dt_s + self.rate @ b * (0.5 * dt_s * dt_s)

    def process_noise(self, dt_s: Scalar) -> np.ndarray:
        """Q (n, n) of a step."""
        robot, noise = self.scene.robot, self.noise
        walks = dict.fromkeys(self.names[: robot.freedoms], noise.yaw_rate_walk) | {
            "v_m_s": noise.speed_walk,
            "disturbance_m_s2": noise.disturbance_walk,
            "accelerometer_offset_m_s2": noise.accelerometer_offset_walk,
        }
        variances = [walks.get(name, 0.0) ** 2 * dt_s for name in self.names]
        for k in range(robot.driven):
            variances[self.wheel(k)] = (noise.torque_std_Nm * dt_s / robot.inertia[robot.freedoms + k]) ** 2
            variances[self.force(k)] = noise.force_walk_N**2 * dt_s
            variances[self.following(k)] = FOLLOWING_STD**2 * (1 - exp(-2 * dt_s / FOLLOWING_S))
        return np.diag(np.array(variances))

    @cached_property
    def load_N(self) -> np.ndarray:
        """Loads (wheels,) on level ground."""
        robot = self.scene.robot
        return robot.loads[:, 0] * robot.mass_kg * GRAVITY
