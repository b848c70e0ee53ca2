"""Speed from momentum, at the rate of a slip controller: counts, currents and an accelerometer with a known zero.

Speed from the wheels rests on the friction law, which a slip controller cannot rely on: with the stiffness of the
ground uncertain by half, a slip of 0.12 is known to within 0.06. This observer assumes no friction law. A robot that
starts from rest knows its speed exactly; from there the momentum that the motors give, less that of the wheels, is the
body's. The remaining errors are slow: slope, resistance, mass. An accelerometer whose zero was found at rest measures
them, on any slope and with any offset of its own; so do passive wheels, and an external speed.

Counts are angles: the error of a count does not accumulate, whereas a speed from differences of counts, at 1 kHz and
4096 counts, is either 0.18 m/s or zero. All is linear (`MomentumModel`), so the filter is a plain Kalman filter.

Wheels of one axle cannot distinguish a turn from slip: add a gyro, or give the commanded yaw rate as `yaw_rate_rad_s`,
with a standard deviation that covers its error.

Nothing ties the speed to the wheels, so it drifts on long drives: 2 mm/s per root of a second with an accelerometer of
0.05 m/s^2. `speed_observer` knows when wheels grip; its speed may be given as the external one.

Encoder of the momentum observer: the angle of a wheel as one row of a linear measurement.

count   y = ahead                                   0, to within a count
edge    y = ahead(t - age),  x(t - age) = exp(-A age) x(t) + added(-age)     half a count from the middle, to within the
                                                                             uncertainty of edges
none    |ahead| <= half a count                     informative only where the prior is outside

`ahead` is the angle beyond the middle of the present count. An edge that is known to within 0.02 of a count gives the
angle 14 times as precisely as the count, but only when it comes: in between, a slow wheel is within its count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_positive, require_positive
from ohmward.errors import InputError
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, Correction, PackedBelief, pack, unpack
from ohmward.filters.flags import SampleFlag, flags_of
from ohmward.filters.gate import choose, correct_gated, inflate
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import between, every, hold, is_step, some, within
from ohmward.trace import Scalar, clip, exp, isfinite, logical_not, sign, sin, sqrt, where
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.encoders import with_part_of_gain
from ohmward.traction.speed_observer.noise import require_stds


class MomentumFlag(SampleFlag):
    """Events at a sample. None of them stops the observer."""

    BAD_TIME = 1  # dt_s is not a number, negative or longer than `gap_s`: the speed is unknown
    NO_CURRENT = 2  # of at least one motor; the last torque was held
    GROUND_CHANGED = 4  # a driven wheel moved in a way that its torque excludes: the force on it is unknown
    STANDSTILL = 8  # wheels and motors at rest: speed is zero, and the accelerometer shows its zero


class AngleSample(NamedTuple):
    """One sample of the sensors; nan where there is nothing new."""

    dt_s: Any  #: time since the sample before [s]
    turned_rad: np.ndarray  #: (wheels,) counts since the sample before, as an angle; driven wheels first
    current_A: np.ndarray  #: (driven,) of the motors over the step that ends now
    edge_age_s: np.ndarray  #: (wheels,) time since the last edge of a count, >= 0, where a timer captures it
    acceleration_m_s2: Any = math.nan  #: from an accelerometer along x, gravity included
    pitch_rad: Any = math.nan  #: of the body, > 0 with the nose up; nan counts as level
    yaw_rate_rad_s: Any = math.nan  #: from a gyro
    speed_m_s: Any = math.nan  #: forward, external, of now


class MomentumEstimate(NamedTuple):
    """Estimate after a sample; arrays are (driven,)."""

    #: of the body
    speed_m_s: Any
    speed_std_m_s: Any
    yaw_rate_rad_s: Any  #: > 0 to the left
    #: of each driven wheel, and of its centre in rolling direction
    wheel_speed_rad_s: np.ndarray
    travel_speed_m_s: np.ndarray
    #: the ratio is nan below a floor of speed
    slip_speed_m_s: np.ndarray
    slip_speed_std_m_s: np.ndarray
    slip_ratio: np.ndarray
    force_N: np.ndarray  #: of the ground on the wheel
    acceleration_m_s2: np.ndarray  #: of the wheel's centre
    disturbance_m_s2: Any  #: unmodelled acceleration against the robot
    flags: Any  #: sum of `MomentumFlag`


_OPTIONAL = ("edge_std_counts", "passive_std_rad", "accelerometer_std_m_s2", "gyro_std_rad_s", "speed_std_m_s")


@dataclass(frozen=True)
class MomentumNoise:
    """Standard deviations of sensors for one sample, and random walks over the root of a second.

    A sensor with None is absent: nothing is compiled for it.
    """

    encoder_std_rad: float  #: of the angle of a driven wheel; `count_std_rad`
    #: of the position of an edge, as a share of a count; None where the time of edges is not captured
    edge_std_counts: float | None = None
    torque_std_Nm: float = 0.05  #: of the torque at a wheel
    passive_std_rad: float | None = None  #: of the angle of a wheel that is not driven
    accelerometer_std_m_s2: float | None = None  #: of an accelerometer along x; offset and slope are learnt at rest
    gyro_std_rad_s: float | None = None  #: of a yaw gyro, offset included
    speed_std_m_s: float | None = None  #: of an external speed
    #: of the ground's force at constant torque, as loads and ground change: in N, and as a share of the force
    force_walk_N: float = 1.0
    force_walk_share: float = 0.1
    mass_std: float = 0.2  #: share of the mass that may be payload, or missing
    accelerometer_gain_std: float = 0.01  #: relative gain error of the accelerometer
    #: its error [m/s^2] for each N m of the motors, which tilts the body on its tyres
    accelerometer_tilt_std: float = 0.001
    passive_radius_std: float = 0.003  #: relative error of the radius of the wheels that are not driven
    #: speed by which these wheels lag behind the robot
    passive_creep_std_m_s: float = 0.004
    passive_creep_walk: float = 0.008
    #: of unknown accelerations [m/s, rad/s]
    speed_walk: float = 0.001
    yaw_rate_walk: float = 3.0
    #: of the unmodelled acceleration: 0.17 m/s^2 for each degree of unknown slope and 0.1 m/s^2 for a rolling
    #: resistance that is unknown by 1 % of the weight. Where no pitch is measured, a slope of `slope_std_rad` is added.
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


#: Time [s] within which a force follows its torque, by tyre and wheel; in the model it follows at once.
FORCE_DELAY_S = 0.0015
#: Travel [m/s] below which a passive wheel has no direction yet.
STILL_M_S = 0.01
#: Mean and standard deviation of `following` before anything is known, and its correlation time [s].
FOLLOWING, FOLLOWING_STD, FOLLOWING_S = 0.5, 0.5, 0.3


@dataclass(frozen=True)
class MomentumModel:
    """Momentum model of the robot: without tyre and without friction.

    dv/dt        = M^-1 (G' F / (1 + mu) - R) - g sin(pitch) - d      mu, sin and d along x only
    J domega/dt  = tau - r F                                          each driven wheel
    dahead/dt    = omega                                              driven wheels
                 = ((1 + kappa) v_wheel - c) / r                      the others, c against their travel
    F+           = F + phi (tau+ - tau) / r + w                       at each step
    a            = (1 + gamma) (dv/dt + g sin(pitch)) + theta sum(tau) + offset       what the accelerometer shows

    The force F of the ground balances the wheel's torque and acceleration. It follows a change of torque fully while
    the wheel grips and not at all while it spins; the share phi (`following`) is learnt on the way, and forgotten in
    `FOLLOWING_S`. A payload is the share mu of the mass; rolling resistance grows with it, so only the forces feel it.
    The disturbance acceleration d covers the other unknowns along x: rolling resistance and slope. Wheels without a
    motor creep by c, and their radius is known to within kappa, which is considered and never learnt. The accelerometer
    has a gain error gamma, and tilts with the body by theta for each N m of reaction of the motors: under 24 N m a
    robot on tyres lifts its nose by a thousandth, 10 mm/s^2. `ahead` is the angle of a wheel beyond its last count, so
    numbers stay small however far the robot goes. Products of two states are linearised at the mean. The chains from d,
    mu and F to the angle have three links, so exp(A dt) ends after its square.
    """

    scene: Scene  #: of the terrain only the rolling resistance is used
    noise: MomentumNoise  #: of sensors and model

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
        """Standard deviation of each constant error that these sensors can show, by the name of its state."""
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
        A[0][self.index("disturbance_m_s2")] = -1.0
        for k in range(n, self.counted):
            travel = robot.rolling[k] @ x[:free]
            for column in range(free):
                A[self.ahead(k)][column] = robot.rolling[k, column] / r * (1.0 + x[self.index("passive_radius_excess")])
            A[self.ahead(k)][self.index("passive_radius_excess")] = travel / r
            A[self.ahead(k)][self.index("passive_creep_m_s")] = -travel / (abs(travel) + STILL_M_S) / r
        return np.array(A)

    def thrust_m_s2(self, x: np.ndarray) -> Scalar:
        """Acceleration along x that the wheels' forces would give the nominal mass."""
        robot = self.scene.robot
        forces = x[self.force(0) : self.force(0) + robot.driven]
        return robot.rolling[: robot.driven, 0] @ forces / robot.inertia[0]

    def drive(self, x: np.ndarray, torque_Nm: np.ndarray, pitch_rad: Scalar) -> np.ndarray:
        """Vector b (n,) of torques (driven,), rolling resistance and slope, and the remainder of the linearisation."""
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


class CleanAngleSample(NamedTuple):
    """A sample for the prediction, with every number finite."""

    dt_s: Scalar  #: step [s], >= 0
    time_credible: Scalar  #: the condition that the step is plausible
    pitch_rad: Scalar  #: 0 where it is not measured
    pitch_measured: Scalar  #: the condition that it is
    torque_Nm: np.ndarray  #: (driven,) at the wheels over the step, the last one where no current was measured
    currents_measured: Scalar  #: the condition that all currents were measured
    rest_s: Scalar  #: time for which counts and motors have been still
    resting: Scalar  #: the condition that this has lasted long enough for a standstill


class Angle(NamedTuple):
    """y = row @ x + v, v ~ N(0, variance)."""

    row: np.ndarray  #: (n,)
    angle_rad: Scalar  #: y; nan where there is no information
    variance: Scalar  #: rad^2


def count_angle(model: MomentumModel, k: int) -> Angle:
    """Measurement by the count of wheel k alone: its middle, with the standard deviation of a count."""
    std = model.noise.encoder_std_rad if k < model.scene.robot.driven else model.noise.passive_std_rad or 0.0
    row = np.zeros(len(model.names))
    row[model.ahead(k)] = 1.0
    return Angle(row, 0.0, std**2)


def edge_angle(model: MomentumModel, k: int, belief: Belief, sample: AngleSample, b: np.ndarray) -> Angle:
    """Measurement by the time of the last edge of wheel k; by the count where it moved and no time was captured.

    Args:
        model: of the robot, with `noise.edge_std_counts`.
        k: number of the wheel.
        belief: at the time of the sample, its angle beyond the middle of the new count.
        sample: with `turned_rad` and `edge_age_s`.
        b: (n,) drive of the model over the step.
    """
    count, ahead = count_angle(model, k), belief.mean[model.ahead(k)]
    turned, age_s = sample.turned_rad[k], sample.edge_age_s[k]
    half = math.sqrt(3.0 * count.variance)
    moved = turned != 0.0
    timed = moved & between(age_s, 0.0, sample.dt_s)
    back_s = where(timed, -age_s, 0.0)
    at_edge = -half * sign(turned) - model.added(belief.mean, b, back_s)[model.ahead(k)]
    nearest_in_count = where(abs(ahead) > half, clip(ahead, -half, half), math.nan)
    edge_variance = (2.0 * half * (model.noise.edge_std_counts or 0.0)) ** 2
    return Angle(
        row=model.transition(belief.mean, back_s)[model.ahead(k)],
        angle_rad=where(timed, at_edge, where(moved, 0.0, nearest_in_count)),
        variance=where(timed, edge_variance, count.variance),
    )


#: Time [s] after which a change of force is seen in the counts.
SEEN_LATE_S = 0.003

#: Standard deviation [N] of the force on a wheel of a robot at rest.
RESTING_FORCE_N = 2.0

#: Decay time [s] of the body's oscillation on its tyres after a change of torque, and its acceleration [m/s^2] for each
#: N m: MuJoCo's RLMA, 60 kN/m under each wheel.
SHAKING_S, SHAKING_M_S2_PER_NM = 0.02, 0.03

#: Largest plausible acceleration [m/s^2], gravity included: a larger one is a sensor fault.
FASTEST_M_S2 = 100.0

#: Standard deviation [m/s, rad/s] of the speed after a gap.
GAP_STD = 1.0


class MomentumState(NamedTuple):
    """State of the observer from sample to sample: plain numbers."""

    belief: PackedBelief  #: mean (n,) and lower triangle of the covariance
    torque_Nm: np.ndarray  #: (driven,) last torques
    rest_s: Scalar  #: time for which counts and motors have been still
    shaken_Nm: Scalar = 0.0  #: changes of the motors' torque, fading out as the body comes to rest on its tyres


@dataclass(frozen=True)
class MomentumObserver:
    """Settings; `init` and `step` are pure functions of them."""

    scene: Scene  #: robot, and the terrain, of which only the rolling resistance is used
    noise: MomentumNoise  #: of sensors and model; determines which sensors there are
    count_gate: float = 25.0  #: NIS of a count beyond which the ground under its wheel has changed, > 0
    #: the same for an edge, whose time is precise enough to show that the ground takes up a torque gradually, > 0
    edge_gate: float = 400.0
    gate: float = 25.0  #: NIS beyond which any other measurement is not used, > 0
    gap_s: float = 0.05  #: after a longer step the speed is unknown, > 0
    rest_hold_s: float = 0.1  #: time for which counts and motors must be still before the robot counts as standing
    rest_current_A: float = 0.5  #: below it a motor is still, > 0
    current_limit_A: float = 200.0  #: beyond it a sensor is at fault, > 0

    def __post_init__(self) -> None:
        if self.scene.robot.chassis.scrubs:
            raise InputError(
                "scene.robot must have wheels that are free sideways; describe a skid-steered robot as "
                'Differential(driven="all") and give it a gyro'
            )
        require_each_positive(
            "momentum_observer.", self, "count_gate", "edge_gate", "gate", "gap_s", "rest_current_A", "current_limit_A"
        )
        require_between("momentum_observer.rest_hold_s", self.rest_hold_s, 0.0, math.inf)

    @cached_property
    def model(self) -> MomentumModel:
        """The robot as the filter sees it."""
        return MomentumModel(self.scene, self.noise)

    def no_sample(self) -> AngleSample:
        """A sample without any measurement, to be filled with `_replace`."""
        robot = self.scene.robot
        angles = np.full(len(robot.places), math.nan)
        return AngleSample(0.0, angles, np.full(robot.driven, math.nan), angles)

    def init(self) -> MomentumState:
        """State of a robot at rest."""
        names, noise = self.model.names, self.noise
        stds = {name: FOLLOWING_STD for name in names if name.startswith("following")}
        stds |= {"accelerometer_offset_m_s2": noise.accelerometer_offset_std_m_s2, **self.model.initial_stds}
        initial_std = [stds.get(name, noise.encoder_std_rad) for name in names]
        mean = np.array([FOLLOWING if name.startswith("following") else 0.0 for name in names])
        belief = self.standing(Belief(mean, np.diag(np.square(initial_std))), self.slope_unknown_m_s2)
        return MomentumState(pack(belief), np.zeros(self.scene.robot.driven), 2 * self.rest_hold_s)

    def step(self, state: MomentumState, sample: AngleSample) -> tuple[MomentumState, MomentumEstimate]:
        """State and estimate after a sample: the model predicts, then each measurement corrects."""
        before = unpack(state.belief)
        clean = self.sanitize(state, before, sample)
        prior = self.predict(before, state.torque_Nm, clean)
        belief, ground_changed = self.correct_counts(prior, sample, clean)
        changed_Nm = sum(abs(change) for change in clean.torque_Nm - state.torque_Nm)
        shaken_Nm = state.shaken_Nm * exp(-clean.dt_s / SHAKING_S) + changed_Nm
        belief = self.correct_accelerometer(belief, sample, clean, shaken_Nm)
        belief = self.correct_body(belief, sample)
        flags = flags_of({
            MomentumFlag.BAD_TIME: logical_not(clean.time_credible),
            MomentumFlag.NO_CURRENT: logical_not(clean.currents_measured),
            MomentumFlag.GROUND_CHANGED: ground_changed,
            MomentumFlag.STANDSTILL: clean.resting,
        })  # fmt: skip
        after = MomentumState(pack(belief), clean.torque_Nm, clean.rest_s, shaken_Nm)
        return after, self.conclude(belief, clean)._replace(flags=flags)

    def sanitize(self, state: MomentumState, before: Belief, sample: AngleSample) -> CleanAngleSample:
        """The sample with implausible values replaced, and the time at rest."""
        robot = self.scene.robot
        time_credible = is_step(sample.dt_s, self.gap_s)
        dt_s = where(time_credible, sample.dt_s, 0.0)
        measured = [within(current, self.current_limit_A) for current in sample.current_A]
        currents = [where(good, current, 0.0) for good, current in zip(measured, sample.current_A, strict=True)]
        wheel_speed_rad_s = before.mean[robot.freedoms : robot.freedoms + robot.driven]
        given = [wheel_torque(robot.motor, i, w) for i, w in zip(currents, wheel_speed_rad_s, strict=True)]
        torque_Nm = [hold(now, good, last) for now, good, last in zip(given, measured, state.torque_Nm, strict=True)]
        still = every(abs(turned) <= 0.0 for turned in sample.turned_rad[: robot.driven])
        idle = every(within(current, self.rest_current_A) for current in sample.current_A)
        rest_s = where(still & idle, state.rest_s + dt_s, 0.0)
        return CleanAngleSample(
            dt_s=dt_s,
            time_credible=time_credible,
            pitch_rad=where(isfinite(sample.pitch_rad), sample.pitch_rad, 0.0),
            pitch_measured=isfinite(sample.pitch_rad),
            torque_Nm=np.array(torque_Nm),
            currents_measured=every(measured),
            rest_s=rest_s,
            resting=rest_s > self.rest_hold_s,
        )

    def predict(self, before: Belief, last_Nm: np.ndarray, clean: CleanAngleSample) -> Belief:
        """Belief at the end of the step: the robot moves, is at rest, or has an unknown speed after a gap."""
        Q = self.model.process_noise(before.mean, clean.dt_s)
        moving = self.predict_motion(before, last_Nm, clean, Q)
        after_gap = moving
        for i in range(self.scene.robot.freedoms):
            after_gap = inflate(after_gap, i, GAP_STD**2)
        belief = choose(clean.time_credible, moving, after_gap)
        slope_m_s2 = where(clean.pitch_measured, 0.0, self.slope_unknown_m_s2)
        standing = self.standing(Belief(before.mean, before.cov + Q), slope_m_s2)
        return choose(clean.resting, standing, belief)

    def predict_motion(self, before: Belief, last_Nm: np.ndarray, clean: CleanAngleSample, Q: np.ndarray) -> Belief:
        """x+ = Phi follow(x) + added,  P+ = (Phi S) P (Phi S)' + Q, and the possible effect of late forces."""
        model = self.model
        change_N = (clean.torque_Nm - last_Nm) / self.scene.robot.wheel.radius_m
        followed, S = model.follow(before.mean, change_N, clean.dt_s)
        Phi = model.transition(followed, clean.dt_s)
        added = model.added(followed, model.drive(followed, clean.torque_Nm, clean.pitch_rad), clean.dt_s)
        for k, change in enumerate(change_N):
            late = model.late_force(followed, k, change)
            Q = Q + np.outer(late, late)
        return Belief(Phi @ followed + added, kalman.predict(before, Phi @ S, Q).cov)

    @property
    def slope_unknown_m_s2(self) -> float:
        """Standard deviation [m/s^2] of gravity along the robot where no pitch is measured."""
        return GRAVITY * self.noise.slope_std_rad

    def standing(self, belief: Belief, slope_m_s2: Scalar) -> Belief:
        """Belief for a robot at rest: motion, forces and disturbance restart; other states stay as they are.

        slope_m_s2: standard deviation of gravity along the robot.
        """
        model, noise, n = self.model, self.noise, self.scene.robot.driven
        stds = [noise.standstill_std_m_s] * model.wheel(0)
        stds += [noise.standstill_std_m_s / self.scene.robot.wheel.radius_m] * n + [RESTING_FORCE_N] * n
        disturbance_m_s2 = sqrt(noise.disturbance_std_m_s2**2 + slope_m_s2**2)
        started: dict[int, Any] = dict(enumerate(stds)) | {model.index("disturbance_m_s2"): disturbance_m_s2}
        stays = np.diag([0.0 if i in started else 1.0 for i in range(len(model.names))])
        variances = vector(len(model.names), started) ** 2
        return Belief(stays @ belief.mean, stays @ belief.cov @ stays + np.diag(variances))

    def correct_counts(self, prior: Belief, sample: AngleSample, clean: CleanAngleSample) -> tuple[Belief, Scalar]:
        """Correct with the encoders; the force on a driven wheel outside its gate becomes unknown.

        Returns: the belief, and the condition that a driven wheel moved in a way that its torque excludes.
        """
        model, robot = self.model, self.scene.robot
        b = model.drive(prior.mean, clean.torque_Nm, clean.pitch_rad)
        belief, changed = prior, []
        for k in range(model.counted):
            turned_rad = sample.turned_rad[k]
            counted = {model.ahead(k): where(isfinite(turned_rad), turned_rad, 0.0)}
            belief = belief._replace(mean=belief.mean - vector(len(belief.mean), counted))
            angle = self.angle(belief, k, sample, b)
            measured = isfinite(turned_rad) & isfinite(angle.angle_rad)
            if k < robot.driven:
                changed.append(measured & self.is_outside_gate(belief, angle))
                belief = choose(changed[-1], self.force_unknown(belief, k), belief)
            y = where(measured, angle.angle_rad, math.nan)
            belief = consider_radius(belief, correct_row(belief, angle.row, y, angle.variance), model)
        return belief, some(changed)

    def angle(self, belief: Belief, k: int, sample: AngleSample, b: np.ndarray) -> Angle:
        """Measurement by the encoder of wheel k."""
        if self.noise.edge_std_counts is None:
            return count_angle(self.model, k)
        return edge_angle(self.model, k, belief, sample, b)

    def is_outside_gate(self, belief: Belief, angle: Angle) -> Scalar:
        """True where an angle is farther from the predicted one than an unchanged ground allows."""
        nu = angle.angle_rad - angle.row @ belief.mean
        gate = self.count_gate if self.noise.edge_std_counts is None else self.edge_gate
        return nu**2 > gate * (angle.row @ belief.cov @ angle.row + angle.variance)

    def force_unknown(self, belief: Belief, k: int) -> Belief:
        """Belief after the force on a wheel may have changed by anything up to its load, `SEEN_LATE_S` ago."""
        column = self.model.transition(belief.mean, SEEN_LATE_S)[:, self.model.force(k)] * self.model.load_N[k]
        return Belief(belief.mean, belief.cov + np.outer(column, column))

    def correct_accelerometer(
        self, belief: Belief, sample: AngleSample, clean: CleanAngleSample, shaken_Nm: Scalar
    ) -> Belief:
        """Correct with the accelerometer: at rest it shows gravity and its offset, else the body's acceleration too.

        A change of torque shakes the body on its tyres, and the accelerometer with it. A sample outside its gate is not
        used, but it inflates the variance of the disturbance, so that the next one passes.
        """
        accelerometer_std = self.noise.accelerometer_std_m_s2
        if accelerometer_std is None:
            return belief
        model, x = self.model, belief.mean
        gain, tilt = model.index("accelerometer_gain"), model.index("accelerometer_tilt_m_s2_per_Nm")
        offset = model.index("accelerometer_offset_m_s2")
        moving = where(clean.resting, 0.0, 1.0)
        gravity = GRAVITY * sin(clean.pitch_rad)
        rates = model.rate(x)[0]
        specific = gravity + moving * (rates @ x + model.drive(x, clean.torque_Nm, clean.pitch_rad)[0])
        reaction_Nm = sum(clean.torque_Nm)
        row = moving * (1.0 + x[gain]) * rates
        row = row + vector(len(x), {gain: moving * specific, tilt: moving * reaction_Nm, offset: 1.0})
        expected = (1.0 + moving * x[gain]) * specific + moving * x[tilt] * reaction_Nm + x[offset]
        measured = where(within(sample.acceleration_m_s2, FASTEST_M_S2), sample.acceleration_m_s2, math.nan)
        y = measured - expected + row @ x
        nu = y - row @ x
        variance = accelerometer_std**2 + (SHAKING_M_S2_PER_NM * shaken_Nm) ** 2
        unlike = nu**2 > self.gate * (row @ belief.cov @ row + variance)
        inflated = inflate(belief, model.index("disturbance_m_s2"), nu**2)
        corrected = consider_radius(belief, correct_row(belief, row, y, variance), model)
        return choose(unlike, inflated, corrected)

    def correct_body(self, belief: Belief, sample: AngleSample) -> Belief:
        """Correct with yaw gyro and external speed."""
        yaw = vector(len(belief.mean), {self.model.names.index("yaw_rate_rad_s"): 1.0})
        speed = vector(len(belief.mean), {0: 1.0})
        if self.noise.gyro_std_rad_s is not None:
            belief = correct_row(belief, yaw, sample.yaw_rate_rad_s, self.noise.gyro_std_rad_s**2, self.gate)
        if self.noise.speed_std_m_s is not None:
            belief = correct_row(belief, speed, sample.speed_m_s, self.noise.speed_std_m_s**2, self.gate)
        return belief

    def conclude(self, belief: Belief, clean: CleanAngleSample) -> MomentumEstimate:
        """The estimate, still without flags."""
        model, robot = self.model, self.scene.robot
        x, P = belief
        free, n, r = robot.freedoms, robot.driven, robot.wheel.radius_m
        G = robot.rolling[:n]
        rates = model.rate(x)[:free] @ x + model.drive(x, clean.torque_Nm, clean.pitch_rad)[:free]
        H = np.hstack([-G, r * np.eye(n)])
        slip = H @ x[: free + n]
        travel = G @ x[:free]
        return MomentumEstimate(
            speed_m_s=x[0],
            speed_std_m_s=std(P[0, 0]),
            yaw_rate_rad_s=x[model.names.index("yaw_rate_rad_s")],
            wheel_speed_rad_s=x[free : free + n],
            travel_speed_m_s=travel,
            slip_speed_m_s=slip,
            slip_speed_std_m_s=np.array([std(row @ P[: free + n, : free + n] @ row) for row in H]),
            slip_ratio=np.array([slip_ratio(s + v, v) for s, v in zip(slip, travel, strict=True)]),
            force_N=x[free + n : free + 2 * n],
            acceleration_m_s2=G @ rates,
            disturbance_m_s2=x[model.index("disturbance_m_s2")],
            flags=0.0,
        )


def consider_radius(before: Belief, after: Belief, model: MomentumModel) -> Belief:
    """The belief after a correction that leaves the radius of the passive wheels as it was: Schmidt-Kalman filter.

    The wheels show (1 + kappa) v. Linearised at a changing v, their counts seem to distinguish kappa from v, which they
    cannot; where a drag was larger than modelled, the filter moved kappa by 30 standard deviations.
    """
    if "passive_radius_excess" not in model.initial_stds:
        return after
    return with_part_of_gain(before, after, model.index("passive_radius_excess"), 0.0)


def correct_row(belief: Belief, row: np.ndarray, y: Scalar, variance: Scalar, gate: float = math.inf) -> Belief:
    """The belief after y = row @ x, row (n,); a measurement that is missing or outside its gate changes nothing."""

    def correct(measured: np.ndarray) -> Correction:
        return kalman.correct(belief, measured, row[None], np.array([[variance]]))

    after, _ = correct_gated(belief, y, correct, gate)
    return after


def vector(n: int, elements: Mapping[int, Scalar]) -> np.ndarray:
    """Zeros (n,) except for these elements."""
    return np.array([elements.get(i, 0.0) for i in range(n)])
