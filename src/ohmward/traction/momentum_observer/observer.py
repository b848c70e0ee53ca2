"""Speed from momentum, at the pace of a slip controller: counts, currents and an accelerometer that knows its zero.

What a wheel shows of the speed rests on friction, which a slip controller may not trust: with the stiffness of the
ground unknown by half, a slip of 0.12 is known to 0.06. This observer asks the ground nothing. A robot that starts from
rest knows its speed exactly; from there the momentum that the motors give, less what the wheels keep, is the body's.
What is left is slow: slope, resistance, mass. An accelerometer that was read at rest measures it, on any slope and
whatever its own offset; so do passive wheels, and an external speed.

Counts are angles: the error of a count does not add up, where a speed from differences of counts, at 1 kHz and 4096
counts, is one of 0.18 m/s or none. All is linear (`momentum_model`), so the filter is Kalman's own.

Wheels of one axle cannot tell a turn from a slip: give it a gyro, or for `yaw_rate_rad_s` what was commanded, with its
doubt.

Nothing ties the speed to the wheels, so it drifts on long drives: 2 mm/s over the root of each second with an
accelerometer of 0.05 m/s^2. `speed_observer` knows when wheels grip; its speed may be given as the external one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.gate import choose, passes
from ohmward.filters.sanitize import every, within
from ohmward.trace import isfinite, maximum, sin, sqrt, where
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.momentum_observer.angle import Angle, count_angle, edge_angle
from ohmward.traction.momentum_observer.estimate import AngleSample, MomentumEstimate, MomentumFlag
from ohmward.traction.momentum_observer.model import FOLLOWING, FOLLOWING_STD, MomentumModel
from ohmward.traction.momentum_observer.noise import MomentumNoise
from ohmward.traction.robot.motor import wheel_torque
from ohmward.traction.robot.robot import GRAVITY

#: A change of force is seen in the counts this long [s] after it.
SEEN_LATE_S = 0.003

#: Standard deviation [N] of the force on a wheel of a robot that stands.
RESTING_FORCE_N = 2.0


class MomentumState(NamedTuple):
    """What the observer carries from sample to sample: the belief, the last torques (driven,), and how long at rest."""

    belief: PackedBelief
    torque_Nm: np.ndarray
    rest_s: Any


@dataclass(frozen=True)
class MomentumObserver:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        scene: robot, and the terrain, of which only the rolling resistance counts.
        noise: how wrong sensors and model may be, and which sensors there are.
        surprise: NIS of a count beyond which the ground under its wheel has changed, > 0.
        edge_surprise: likewise of an edge, whose time shows even how gradually the ground takes up a torque, > 0.
        gate: largest NIS of any other measurement that is used, > 0.
        gap_s: after a longer step nothing is known of the speed, > 0.
        rest_hold_s: counts and motors must be still for so long before the robot counts as standing.
        rest_current_A: what counts as still, > 0.
        current_limit_A: beyond it a sensor is at fault, > 0.
    """

    scene: Scene
    noise: MomentumNoise
    surprise: float = 25.0
    edge_surprise: float = 400.0
    gate: float = 25.0
    gap_s: float = 0.05
    rest_hold_s: float = 0.1
    rest_current_A: float = 0.5
    current_limit_A: float = 200.0

    def __post_init__(self) -> None:
        if self.scene.robot.chassis.scrubs:
            raise InputError(
                "scene.robot must have wheels that are free sideways; describe a skid-steered robot as "
                'Differential(driven="all") and give it a gyro'
            )
        for name in ("surprise", "edge_surprise", "gate", "gap_s", "rest_current_A", "current_limit_A"):
            require_positive(f"momentum_observer.{name}", getattr(self, name))
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
        """The state of a robot that stands."""
        names, noise = self.model.names, self.noise
        stds = {name: FOLLOWING_STD for name in names if name.startswith("following")}
        stds["accelerometer_offset_m_s2"] = noise.accelerometer_offset_std_m_s2
        std = [stds.get(name, noise.encoder_std_rad) for name in names]
        mean = np.array([FOLLOWING if name.startswith("following") else 0.0 for name in names])
        belief = self.standing(Belief(mean, np.diag(np.square(std))))
        return MomentumState(pack(belief), np.zeros(self.scene.robot.driven), 2 * self.rest_hold_s)

    def step(self, state: MomentumState, sample: AngleSample) -> tuple[MomentumState, MomentumEstimate]:
        """The state after a sample, and what is known then."""
        before = unpack(state.belief)
        good = (sample.dt_s >= 0.0) & (sample.dt_s <= self.gap_s)
        dt_s = where(good, sample.dt_s, 0.0)
        pitch_rad = where(isfinite(sample.pitch_rad), sample.pitch_rad, 0.0)
        torque_Nm, driven = self.torques(state, before, sample)

        still = every([abs(turned) <= 0.0 for turned in sample.turned_rad[: len(torque_Nm)]])
        idle = every([abs(i) <= self.rest_current_A for i in sample.current_A])
        rest_s = where(still & idle, state.rest_s + dt_s, 0.0)
        resting = rest_s > self.rest_hold_s

        belief = self.predict(before, state.torque_Nm, torque_Nm, pitch_rad, dt_s)
        belief = choose(good, belief, self.lost(belief))
        rested = Belief(before.mean, before.cov + self.model.process_noise(dt_s))
        belief = choose(resting, self.standing(rested), belief)
        belief, changed = self.use_counts(belief, sample, torque_Nm, pitch_rad)
        belief = self.use_accelerometer(belief, sample, torque_Nm, pitch_rad, where(resting, 0.0, 1.0))
        belief = self.use_body(belief, sample)

        flags = (
            where(good, 0.0, float(MomentumFlag.BAD_TIME))
            + where(driven, 0.0, float(MomentumFlag.NO_CURRENT))
            + where(changed, float(MomentumFlag.GROUND_CHANGED), 0.0)
            + where(resting, float(MomentumFlag.STANDSTILL), 0.0)
        )
        after = MomentumState(pack(belief), torque_Nm, rest_s)
        return after, self.conclude(belief, torque_Nm, pitch_rad, flags)

    def torques(self, state: MomentumState, before: Belief, sample: AngleSample) -> tuple[np.ndarray, Any]:
        """Torque (driven,) over the step, the last one where no current came, and whether all came."""
        motor = self.scene.robot.motor
        known = [within(i, self.current_limit_A) for i in sample.current_A]
        given = [
            where(good, wheel_torque(motor, where(good, i, 0.0), before.mean[self.model.wheel(k)]), last)
            for k, (good, i, last) in enumerate(zip(known, sample.current_A, state.torque_Nm, strict=True))
        ]
        return np.array(given), every(known)

    def predict(
        self, before: Belief, torque_before: np.ndarray, torque_Nm: np.ndarray, pitch_rad: Any, dt_s: Any
    ) -> Belief:
        """The belief at the end of the step."""
        model, free = self.model, self.scene.robot.freedoms
        change_N = (torque_Nm - torque_before) / self.scene.robot.wheel.radius_m
        followed, S = model.follow(before.mean, change_N, dt_s)
        Phi = model.transition(dt_s)
        added = model.added(model.drive(before.mean[:free], torque_Nm, pitch_rad), dt_s)
        return Belief(Phi @ followed + added, kalman.predict(before, Phi @ S, model.process_noise(dt_s)).cov)

    def lost(self, belief: Belief) -> Belief:
        """After a gap: any speed."""
        return widened(belief, dict.fromkeys(range(self.scene.robot.freedoms), 1.0))

    def standing(self, belief: Belief) -> Belief:
        """The belief of a robot that stands: it does not move, and what holds it says nothing of what will push it."""
        model, noise, n = self.model, self.noise, self.scene.robot.driven
        stds = [noise.standstill_std_m_s] * model.wheel(0)
        stds += [noise.standstill_std_m_s / self.scene.robot.wheel.radius_m] * n + [RESTING_FORCE_N] * n
        new = dict(enumerate(stds)) | {model.push: noise.push_std_m_s2}
        kept = np.diag([0.0 if i in new else 1.0 for i in range(len(model.names))])
        return Belief(kept @ belief.mean, kept @ belief.cov @ kept + np.diag(vector(len(model.names), new) ** 2))

    def use_counts(
        self, belief: Belief, sample: AngleSample, torque_Nm: np.ndarray, pitch_rad: Any
    ) -> tuple[Belief, Any]:
        """With the encoders; and whether one of the driven wheels was a surprise."""
        model, driven = self.model, self.scene.robot.driven
        b = model.drive(belief.mean[: self.scene.robot.freedoms], torque_Nm, pitch_rad)
        changed: Any = False
        for k in range(model.counted):
            turned = sample.turned_rad[k]
            there, i = isfinite(turned), model.ahead(k)
            belief = belief._replace(mean=belief.mean - vector(len(belief.mean), {i: where(there, turned, 0.0)}))
            seen = self.angle(belief, k, sample, b)
            there = there & isfinite(seen.angle_rad)
            if k < driven:
                surprise = there & self.surprises(belief, seen)
                belief = choose(surprise, self.force_unknown(belief, k), belief)
                changed = changed | surprise
            y = where(there, seen.angle_rad, math.nan)
            belief = observed(belief, seen.row, y, seen.variance, math.inf)
        return belief, changed

    def angle(self, belief: Belief, k: int, sample: AngleSample, b: np.ndarray) -> Angle:
        """What the encoder of wheel k says."""
        if self.noise.edge_std_counts is None:
            return count_angle(self.model, k)
        return edge_angle(self.model, k, belief, sample, b)

    def surprises(self, belief: Belief, seen: Angle) -> Any:
        """Whether an angle is farther from the believed one than the ground as it was allows."""
        error = seen.angle_rad - seen.row @ belief.mean
        most = self.surprise if self.noise.edge_std_counts is None else self.edge_surprise
        return error**2 > most * (seen.row @ belief.cov @ seen.row + seen.variance)

    def force_unknown(self, belief: Belief, k: int) -> Belief:
        """As if the force on a wheel had changed by anything up to its load, `SEEN_LATE_S` ago."""
        column = self.model.transition(SEEN_LATE_S)[:, self.model.force(k)] * self.model.load_N[k]
        return Belief(belief.mean, belief.cov + np.outer(column, column))

    def use_accelerometer(
        self, belief: Belief, sample: AngleSample, torque_Nm: np.ndarray, pitch_rad: Any, moving: Any
    ) -> Belief:
        """With what it shows beyond gravity: the offset at rest, the body's acceleration and the offset else."""
        std = self.noise.accelerometer_std_m_s2
        if std is None:
            return belief
        model = self.model
        known = model.drive(belief.mean[: self.scene.robot.freedoms], torque_Nm, pitch_rad)[0]
        y = sample.acceleration_m_s2 - GRAVITY * sin(pitch_rad) - moving * known
        rates = {i: moving * value for i, value in enumerate(model.rate[0]) if value}
        return observed(belief, vector(len(belief.mean), {**rates, model.offset: 1.0}), y, std**2, self.gate)

    def use_body(self, belief: Belief, sample: AngleSample) -> Belief:
        """With yaw gyro and external speed."""
        yaw = vector(len(belief.mean), {self.model.names.index("yaw_rate_rad_s"): 1.0})
        speed = vector(len(belief.mean), {0: 1.0})
        if self.noise.gyro_std_rad_s is not None:
            belief = observed(belief, yaw, sample.yaw_rate_rad_s, self.noise.gyro_std_rad_s**2, self.gate)
        if self.noise.speed_std_m_s is not None:
            belief = observed(belief, speed, sample.speed_m_s, self.noise.speed_std_m_s**2, self.gate)
        return belief

    def conclude(self, belief: Belief, torque_Nm: np.ndarray, pitch_rad: Any, flags: Any) -> MomentumEstimate:
        """What the belief means."""
        model, robot = self.model, self.scene.robot
        x, P = belief
        free, n, r = robot.freedoms, robot.driven, robot.wheel.radius_m
        G = robot.rolling[:n]
        rates = model.rate[:free] @ x + model.drive(x[:free], torque_Nm, pitch_rad)[:free]
        H = np.hstack([-G, r * np.eye(n)])
        slip = H @ x[: free + n]
        variance = [H[k] @ P[: free + n, : free + n] @ H[k] for k in range(n)]
        travel = G @ x[:free]
        return MomentumEstimate(
            speed_m_s=x[0],
            speed_std_m_s=root(P[0, 0]),
            yaw_rate_rad_s=x[model.names.index("yaw_rate_rad_s")],
            wheel_speed_rad_s=x[free : free + n],
            travel_speed_m_s=travel,
            slip_speed_m_s=slip,
            slip_speed_std_m_s=np.array([root(v) for v in variance]),
            slip_ratio=np.array([slip_ratio(s + v, v) for s, v in zip(slip, travel, strict=True)]),
            force_N=x[free + n : free + 2 * n],
            acceleration_m_s2=G @ rates,
            push_m_s2=x[model.push],
            flags=flags,
        )


def observed(belief: Belief, row: np.ndarray, y: Any, variance: Any, gate: float) -> Belief:
    """The belief after y = row @ x, row (n,); a measurement that is no number or outside its gate changes nothing."""
    there = isfinite(y)
    correction = kalman.correct(belief, np.array([where(there, y, 0.0)]), row[None], np.array([[variance]]))
    return choose(there & passes(correction.innovation, gate), correction.belief, belief)


def widened(belief: Belief, variances: dict[int, float]) -> Belief:
    """The belief with so much more variance of some elements."""
    extra = np.zeros_like(belief.cov)
    for i, variance in variances.items():
        extra[i, i] = variance
    return Belief(belief.mean, belief.cov + extra)


def vector(n: int, elements: dict[int, Any]) -> np.ndarray:
    """(n,) of zeros but for these elements."""
    return np.array([elements.get(i, 0.0) for i in range(n)])


def root(variance: Any) -> Any:
    """Of a variance that rounding may have made negative."""
    return sqrt(maximum(variance, 0.0))
