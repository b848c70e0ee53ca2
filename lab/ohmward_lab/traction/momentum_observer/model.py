"""The robot as its momentum: without tyre and without friction.

dv/dt        = M^-1 (G' F / (1 + mu) - R) - g sin(pitch) - d      mu, sin and d along x only
J domega/dt  = tau - r F                                          each driven wheel
dahead/dt    = omega                                              driven wheels
             = ((1 + kappa) v_wheel - c) / r                      the others, c against their travel
F+           = F + phi (tau+ - tau) / r + w                       at each step
a            = (1 + gamma) (dv/dt + g sin(pitch)) + theta sum(tau) + offset       what the accelerometer shows

The force F of the ground is what the wheel's torque and acceleration leave over. It follows a change of torque fully
while the wheel grips and not at all while it spins; the share phi (`following`) is learnt as it goes, and forgotten in
`FOLLOWING_S`. A payload is the share mu of the mass; rolling resistance grows with it, so only the forces feel it. The
disturbance acceleration d is what else is unknown along x: rolling resistance and slope. Wheels without a motor creep
by c, and their radius is known to kappa, which is considered and never learnt. The accelerometer has a gain error
gamma, and tilts with the body by theta for each N m that the motors react on it: under 24 N m a robot on tyres lifts
its nose by a thousandth, 10 mm/s^2. `ahead` is the angle of a wheel beyond its last count, so numbers stay small
however far the robot goes. Products of two states are linearised at the mean. The chains from d, mu and F to the angle
have three links, so exp(A dt) ends after its square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.checks import require_positive
from ohmward.trace import clip, exp, sin
from ohmward.trace.expression import Scalar
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.noise import require_stds

_OPTIONAL = ("edge_std_counts", "passive_std_rad", "accelerometer_std_m_s2", "gyro_std_rad_s", "speed_std_m_s")


@dataclass(frozen=True)
class MomentumNoise:
    """Standard deviations of sensors for one sample, and random walks over the root of a second.

    A sensor with None does not exist: nothing is compiled for it.
    """

    encoder_std_rad: float  #: of the angle of a driven wheel; `count_std_rad`
    #: of the position of an edge, as a share of a count; None where the time of edges is not captured
    edge_std_counts: float | None = None
    torque_std_Nm: float = 0.05  #: of the torque at a wheel
    passive_std_rad: float | None = None  #: of the angle of a wheel that is not driven
    accelerometer_std_m_s2: float | None = None  #: of an accelerometer along x; offset and slope are learnt at rest
    gyro_std_rad_s: float | None = None  #: of a yaw gyro, offset included
    speed_std_m_s: float | None = None  #: of an external speed
    #: of the ground's force while the torque does not change: in N, and as a share of the force, which loads and ground
    #: make
    force_walk_N: float = 1.0
    force_walk_share: float = 0.1
    mass_std: float = 0.2  #: share of the mass that may be payload, or missing
    accelerometer_gain_std: float = 0.01  #: share by which the accelerometer shows too much
    #: m/s^2 that it shows for each N m of the motors, by which the body tilts on its tyres
    accelerometer_tilt_std: float = 0.001
    passive_radius_std: float = 0.003  #: share of the radius of the wheels that are not driven
    #: speed by which these wheels lag behind the robot
    passive_creep_std_m_s: float = 0.004
    passive_creep_walk: float = 0.008
    #: of unknown accelerations [m/s, rad/s]
    speed_walk: float = 0.001
    yaw_rate_walk: float = 3.0
    #: of the unmodelled acceleration: 0.17 m/s^2 for each degree of unknown slope and 0.1 m/s^2 for a rolling
    #: resistance that is unknown by 1 % of the weight. Where no pitch is measured, a slope of `slope_std_rad` comes on
    #: top.
    disturbance_std_m_s2: float = 0.17
    disturbance_walk: float = 0.1
    slope_std_rad: float = 0.05  #: of the ground where no pitch is measured
    #: before the first rest, and after it
    accelerometer_offset_std_m_s2: float = 0.5
    accelerometer_offset_walk: float = 0.002
    standstill_std_m_s: float = 0.001  #: of the zero speed of a robot at rest

    def __post_init__(self) -> None:
        stds = {field.name: getattr(self, field.name) for field in fields(self)}
        require_stds("momentum_noise", stds, _OPTIONAL)


def count_std_rad(counts_per_turn: float) -> float:
    """Standard deviation [rad] of an angle that is known to within a count: the count over the root of 12."""
    require_positive("counts_per_turn", counts_per_turn)
    return 2 * math.pi / counts_per_turn / math.sqrt(12)


#: A force follows its torque within this time [s], the tyre's and the wheel's; the model lets it follow at once.
FORCE_DELAY_S = 0.0015
#: Travel [m/s] below which a passive wheel has no direction yet.
STILL_M_S = 0.01
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
            *self.initial_stds,
        )

    @cached_property
    def initial_stds(self) -> dict[str, float]:
        """Standard deviation of each constant error that the sensors there are can show, by the name of its state."""
        noise = self.noise
        stds = {"mass_excess": noise.mass_std}
        if noise.accelerometer_std_m_s2 is not None:
            stds["accelerometer_gain"] = noise.accelerometer_gain_std
            stds["accelerometer_tilt_m_s2_per_Nm"] = noise.accelerometer_tilt_std
        if noise.passive_std_rad is not None:
            stds["passive_radius_excess"] = noise.passive_radius_std
            stds["passive_creep_m_s"] = noise.passive_creep_std_m_s
        return stds

    def index(self, name: str) -> int:
        """Index of a state."""
        return self.names.index(name)

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

    def rate(self, x: np.ndarray) -> np.ndarray:
        """A (n, n) of dx/dt = A x + b near the state x (n,)."""
        robot, r = self.scene.robot, self.scene.robot.wheel.radius_m
        free, n = robot.freedoms, robot.driven
        by_force = (robot.rolling[:n] / robot.inertia[:free]).T
        lighter = 1.0 / (1.0 + x[self.index("mass_excess")])
        A = np.zeros((len(self.names), len(self.names))).tolist()
        for k in range(n):
            A[0][self.force(k)] = by_force[0, k] * lighter
            for row in range(1, free):
                A[row][self.force(k)] = by_force[row, k]
            A[self.wheel(k)][self.force(k)] = -r / robot.inertia[free + k]
            A[self.ahead(k)][self.wheel(k)] = 1.0
        A[0][self.index("mass_excess")] = -self.thrust_m_s2(x) * lighter * lighter
        A[0][self.disturbance] = -1.0
        for k in range(n, self.counted):
            travel = robot.rolling[k] @ x[:free]
            for column in range(free):
                A[self.ahead(k)][column] = robot.rolling[k, column] / r * (1.0 + x[self.index("passive_radius_excess")])
            A[self.ahead(k)][self.index("passive_radius_excess")] = travel / r
            A[self.ahead(k)][self.index("passive_creep_m_s")] = -travel / (abs(travel) + STILL_M_S) / r
        return np.array(A)

    def thrust_m_s2(self, x: np.ndarray) -> Scalar:
        """Acceleration along x that the wheels' forces would give the mass that is believed."""
        robot = self.scene.robot
        forces = x[self.force(0) : self.force(0) + robot.driven]
        return robot.rolling[: robot.driven, 0] @ forces / robot.inertia[0]

    def drive(self, x: np.ndarray, torque_Nm: np.ndarray, pitch_rad: Scalar) -> np.ndarray:
        """Vector b (n,) of torques (driven,), rolling resistance and slope, and of what linearising leaves."""
        robot, free = self.scene.robot, self.scene.robot.freedoms
        travel = robot.rolling @ x[:free]
        R = [t.rolling.force_N(v, N) for t, v, N in zip(self.scene.terrains, travel, self.load_N, strict=True)]
        body = robot.rolling.T @ np.array(R) / robot.inertia[:free]
        b: list[Any] = [0.0] * len(self.names)
        b[:free] = body.tolist()
        mu = x[self.index("mass_excess")]
        b[0] = b[0] - GRAVITY * sin(pitch_rad) + self.thrust_m_s2(x) * mu / (1.0 + mu) ** 2
        for k in range(robot.driven):
            b[self.wheel(k)] = torque_Nm[k] / robot.inertia[free + k]
        for k in range(robot.driven, self.counted):
            b[self.ahead(k)] = -x[self.index("passive_radius_excess")] * travel[k] / robot.wheel.radius_m
        return np.array(b)

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

    def transition(self, x: np.ndarray, dt_s: Scalar) -> np.ndarray:
        """exp(A dt), (n, n), exact for the A of this state."""
        A = self.rate(x)
        return np.eye(len(self.names)) + A * dt_s + A @ A * (0.5 * dt_s * dt_s)

    def added(self, x: np.ndarray, b: np.ndarray, dt_s: Scalar) -> np.ndarray:
        """Change (n,) of the state x by a constant b over `dt_s`."""
        return b * dt_s + self.rate(x) @ b * (0.5 * dt_s * dt_s)

    def late_force(self, x: np.ndarray, k: int, change_N: Scalar) -> np.ndarray:
        """Error (n,) of the motion where the force on driven wheel k followed a change `FORCE_DELAY_S` late."""
        late = self.transition(x, FORCE_DELAY_S)[:, self.force(k)] * change_N
        return np.array([0.0 if i == self.force(k) else value for i, value in enumerate(late)])

    def process_noise(self, x: np.ndarray, dt_s: Scalar) -> np.ndarray:
        """Q (n, n) of a step from the state x (n,)."""
        robot, noise = self.scene.robot, self.noise
        walks = dict.fromkeys(self.names[: robot.freedoms], noise.yaw_rate_walk) | {
            "v_m_s": noise.speed_walk,
            "disturbance_m_s2": noise.disturbance_walk,
            "accelerometer_offset_m_s2": noise.accelerometer_offset_walk,
            "passive_creep_m_s": noise.passive_creep_walk,
        }
        variances = [walks.get(name, 0.0) ** 2 * dt_s for name in self.names]
        for k in range(robot.driven):
            variances[self.wheel(k)] = (noise.torque_std_Nm * dt_s / robot.inertia[robot.freedoms + k]) ** 2
            walk_N2 = noise.force_walk_N**2 + (noise.force_walk_share * x[self.force(k)]) ** 2
            variances[self.force(k)] = walk_N2 * dt_s
            variances[self.following(k)] = FOLLOWING_STD**2 * (1 - exp(-2 * dt_s / FOLLOWING_S))
        return np.diag(np.array(variances))

    @cached_property
    def load_N(self) -> np.ndarray:
        """Loads (wheels,) on level ground."""
        robot = self.scene.robot
        return robot.loads[:, 0] * robot.mass_kg * GRAVITY
