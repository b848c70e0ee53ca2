"""Speed from momentum, at the pace of a slip controller: counts, currents and an accelerometer that knows its zero.

The speed that a wheel shows rests on friction, which a slip controller may not trust: with the stiffness of the ground
unknown by half, a slip of 0.12 is known to 0.06. This observer asks the ground nothing. A robot that starts from rest
knows its speed exactly; from there the momentum that the motors give, less that of the wheels, is the body's. The rest
is slow: slope, resistance, mass. An accelerometer that was read at rest measures it, on any slope and with any offset
of its own; so do passive wheels, and an external speed.

Counts are angles: the error of a count does not add up, where a speed from differences of counts, at 1 kHz and 4096
counts, is one of 0.18 m/s or none. All is linear (`model`), so the filter is Kalman's own.

Wheels of one axle cannot tell a turn from a slip: give it a gyro, or for `yaw_rate_rad_s` the commanded one, with a
standard deviation that covers its error.

Nothing ties the speed to the wheels, so it drifts on long drives: 2 mm/s over the root of each second with an
accelerometer of 0.05 m/s^2. `speed_observer` knows when wheels grip; its speed may be given as the external one.

Encoder of the momentum observer: the angle of a wheel as one row of a linear measurement.

count   y = ahead                                   0, to within a count
edge    y = ahead(t - age),  x(t - age) = exp(-A age) x(t) + added(-age)     half a count from the middle, to within the
                                                                             uncertainty of edges
none    |ahead| <= half a count                     informative only where more is believed

`ahead` is the angle beyond the middle of the count that is shown. An edge that lies within 0.02 of a count tells the
angle 14 times as well as the count does, but only when it comes: in between, a slow wheel is within its count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_positive
from ohmward.errors import InputError
from ohmward.filters import kalman
from ohmward.filters.belief import Belief, Correction, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose, correct_gated, inflate
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import between, every, hold, is_step, some, within
from ohmward.trace import clip, exp, isfinite, logical_not, sign, sin, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.motor import Motor, wheel_torque
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.encoders import with_part_of_gain
from ohmward_lab.traction.momentum_observer.estimate import AngleSample, MomentumEstimate, MomentumFlag
from ohmward_lab.traction.momentum_observer.model import FOLLOWING, FOLLOWING_STD, MomentumModel, MomentumNoise


class CleanAngleSample(NamedTuple):
    """A sample for the prediction, with every number finite."""

    dt_s: Scalar  #: step [s], >= 0
    time_credible: Scalar  #: the condition that the clock can have shown the step
    pitch_rad: Scalar  #: 0 where it is not measured
    pitch_measured: Scalar  #: the condition that it is
    torque_Nm: np.ndarray  #: (driven,) at the wheels over the step, the last one where no current came
    currents_measured: Scalar  #: the condition that all currents came
    rest_s: Scalar = 0.0  #: time for which counts and motors have been still
    resting: Scalar = False  #: the condition that this has lasted long enough for a standstill


def sanitize(
    sample: AngleSample,
    motor: Motor,
    wheel_speed_rad_s: np.ndarray,
    last_Nm: np.ndarray,
    gap_s: float,
    current_limit_A: float,
) -> CleanAngleSample:
    """The sample with what no sensor and no clock can have shown replaced.

    wheel_speed_rad_s: (driven,) believed ones.
    last_Nm: (driven,) torques of the sample before.
    gap_s: after a longer step nothing is known of the speed.
    current_limit_A: beyond it a sensor is at fault.
    """
    time_credible = is_step(sample.dt_s, gap_s)
    measured = [within(current, current_limit_A) for current in sample.current_A]
    currents = [where(good, current, 0.0) for good, current in zip(measured, sample.current_A, strict=True)]
    given = [wheel_torque(motor, i, w) for i, w in zip(currents, wheel_speed_rad_s, strict=True)]
    torque_Nm = [hold(now, good, last) for now, good, last in zip(given, measured, last_Nm, strict=True)]
    return CleanAngleSample(
        dt_s=where(time_credible, sample.dt_s, 0.0),
        time_credible=time_credible,
        pitch_rad=where(isfinite(sample.pitch_rad), sample.pitch_rad, 0.0),
        pitch_measured=isfinite(sample.pitch_rad),
        torque_Nm=np.array(torque_Nm),
        currents_measured=every(measured),
    )


class Angle(NamedTuple):
    """y = row @ x + v, v ~ N(0, variance)."""

    row: np.ndarray  #: (n,)
    angle_rad: Scalar  #: y; nan where there is nothing to learn
    variance: Scalar  #: rad^2


def count_angle(model: MomentumModel, k: int) -> Angle:
    """Measurement by the count of wheel k alone: its middle, give or take."""
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

#: Standard deviation [N] of the force on a wheel of a robot that stands.
RESTING_FORCE_N = 2.0

#: A body on its tyres swings out within this time [s] after a change of torque, and its accelerometer shows so much
#: [m/s^2] for each N m: MuJoCo's RLMA, 60 kN/m under each wheel.
SHAKING_S, SHAKING_M_S2_PER_NM = 0.02, 0.03

#: No robot shows more than this acceleration [m/s^2], gravity included: the sensor is at fault.
FASTEST_M_S2 = 100.0

#: Standard deviation [m/s, rad/s] of the speed after a gap.
GAP_STD = 1.0


class MomentumState(NamedTuple):
    """State of the observer from sample to sample: plain numbers."""

    belief: PackedBelief  #: mean (n,) and lower triangle of the covariance
    torque_Nm: np.ndarray  #: (driven,) last torques
    rest_s: Scalar  #: time for which counts and motors have been still
    shaken_Nm: Scalar = 0.0  #: changes of the motors' torque, fading out as the body comes to rest on its tyres


class CountCorrection(NamedTuple):
    """Belief after the encoders, and the condition that a driven wheel moved as its torque excludes."""

    belief: Belief
    ground_changed: Scalar


@dataclass(frozen=True)
class MomentumObserver:
    """Settings; `init` and `step` are pure functions of them."""

    scene: Scene  #: robot, and the terrain, of which only the rolling resistance counts
    noise: MomentumNoise  #: of sensors and model; says which sensors there are
    count_gate: float = 25.0  #: NIS of a count beyond which the ground under its wheel has changed, > 0
    #: the same of an edge, whose time shows even how gradually the ground takes up a torque, > 0
    edge_gate: float = 400.0
    gate: float = 25.0  #: NIS beyond which any other measurement is not used, > 0
    gap_s: float = 0.05  #: after a longer step nothing is known of the speed, > 0
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
        """State of a robot that stands."""
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
        counts = self.correct_counts(prior, sample, clean)
        changed_Nm = sum(abs(change) for change in clean.torque_Nm - state.torque_Nm)
        shaken_Nm = state.shaken_Nm * exp(-clean.dt_s / SHAKING_S) + changed_Nm
        belief = self.correct_accelerometer(counts.belief, sample, clean, shaken_Nm)
        belief = self.correct_body(belief, sample)
        flags = flags_of({
            MomentumFlag.BAD_TIME: logical_not(clean.time_credible),
            MomentumFlag.NO_CURRENT: logical_not(clean.currents_measured),
            MomentumFlag.GROUND_CHANGED: counts.ground_changed,
            MomentumFlag.STANDSTILL: clean.resting,
        })  # fmt: skip
        after = MomentumState(pack(belief), clean.torque_Nm, clean.rest_s, shaken_Nm)
        return after, self.conclude(belief, clean)._replace(flags=flags)

    def sanitize(self, state: MomentumState, before: Belief, sample: AngleSample) -> CleanAngleSample:
        """The sample without what no sensor can have shown, and the time at rest."""
        robot = self.scene.robot
        wheel_speed_rad_s = before.mean[robot.freedoms : robot.freedoms + robot.driven]
        limits = self.gap_s, self.current_limit_A
        clean = sanitize(sample, robot.motor, wheel_speed_rad_s, state.torque_Nm, *limits)
        still = every(abs(turned) <= 0.0 for turned in sample.turned_rad[: robot.driven])
        idle = every(within(current, self.rest_current_A) for current in sample.current_A)
        rest_s = where(still & idle, state.rest_s + clean.dt_s, 0.0)
        return clean._replace(rest_s=rest_s, resting=rest_s > self.rest_hold_s)

    def predict(self, before: Belief, last_Nm: np.ndarray, clean: CleanAngleSample) -> Belief:
        """Belief at the end of the step: of a robot that moves, that stands, or of which a gap hides the speed."""
        Q = self.model.process_noise(before.mean, clean.dt_s)
        moving = self.predict_motion(before, last_Nm, clean, Q)
        belief = choose(clean.time_credible, moving, self.speed_unknown(moving))
        slope_m_s2 = where(clean.pitch_measured, 0.0, self.slope_unknown_m_s2)
        standing = self.standing(Belief(before.mean, before.cov + Q), slope_m_s2)
        return choose(clean.resting, standing, belief)

    def predict_motion(self, before: Belief, last_Nm: np.ndarray, clean: CleanAngleSample, Q: np.ndarray) -> Belief:
        """x+ = Phi follow(x) + added,  P+ = (Phi S) P (Phi S)' + Q, and what late forces may have done."""
        model = self.model
        change_N = (clean.torque_Nm - last_Nm) / self.scene.robot.wheel.radius_m
        followed, S = model.follow(before.mean, change_N, clean.dt_s)
        Phi = model.transition(followed, clean.dt_s)
        added = model.added(followed, model.drive(followed, clean.torque_Nm, clean.pitch_rad), clean.dt_s)
        for k, change in enumerate(change_N):
            late = model.late_force(followed, k, change)
            Q = Q + np.outer(late, late)
        return Belief(Phi @ followed + added, kalman.predict(before, Phi @ S, Q).cov)

    def speed_unknown(self, belief: Belief) -> Belief:
        """Belief after a gap."""
        for i in range(self.scene.robot.freedoms):
            belief = inflate(belief, i, GAP_STD**2)
        return belief

    @property
    def slope_unknown_m_s2(self) -> float:
        """Standard deviation [m/s^2] of gravity along the robot where no pitch is measured."""
        return GRAVITY * self.noise.slope_std_rad

    def standing(self, belief: Belief, slope_m_s2: Scalar) -> Belief:
        """Belief in a robot that stands: motion, forces and disturbance start again; other states stay as they are.

        slope_m_s2: standard deviation of gravity along the robot.
        """
        model, noise, n = self.model, self.noise, self.scene.robot.driven
        stds = [noise.standstill_std_m_s] * model.wheel(0)
        stds += [noise.standstill_std_m_s / self.scene.robot.wheel.radius_m] * n + [RESTING_FORCE_N] * n
        disturbance_m_s2 = sqrt(noise.disturbance_std_m_s2**2 + slope_m_s2**2)
        started: dict[int, Any] = dict(enumerate(stds)) | {model.disturbance: disturbance_m_s2}
        stays = np.diag([0.0 if i in started else 1.0 for i in range(len(model.names))])
        variances = vector(len(model.names), started) ** 2
        return Belief(stays @ belief.mean, stays @ belief.cov @ stays + np.diag(variances))

    def correct_counts(self, prior: Belief, sample: AngleSample, clean: CleanAngleSample) -> CountCorrection:
        """Correct with the encoders; the force on a driven wheel outside its gate is unknown."""
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
        return CountCorrection(belief, some(changed))

    def angle(self, belief: Belief, k: int, sample: AngleSample, b: np.ndarray) -> Angle:
        """Measurement by the encoder of wheel k."""
        if self.noise.edge_std_counts is None:
            return count_angle(self.model, k)
        return edge_angle(self.model, k, belief, sample, b)

    def is_outside_gate(self, belief: Belief, angle: Angle) -> Scalar:
        """True where an angle is farther from the believed one than the ground as it was allows."""
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

        A change of torque shakes the body on its tyres, and the accelerometer with it. A sample outside of its gate is
        not used, but the disturbance may be anything from then on: the next one is believed.
        """
        accelerometer_std = self.noise.accelerometer_std_m_s2
        if accelerometer_std is None:
            return belief
        model, x = self.model, belief.mean
        gain, tilt = model.index("accelerometer_gain"), model.index("accelerometer_tilt_m_s2_per_Nm")
        moving = where(clean.resting, 0.0, 1.0)
        gravity = GRAVITY * sin(clean.pitch_rad)
        rates = model.rate(x)[0]
        specific = gravity + moving * (rates @ x + model.drive(x, clean.torque_Nm, clean.pitch_rad)[0])
        reaction_Nm = sum(clean.torque_Nm)
        row = moving * (1.0 + x[gain]) * rates
        row = row + vector(len(x), {gain: moving * specific, tilt: moving * reaction_Nm, model.offset: 1.0})
        expected = (1.0 + moving * x[gain]) * specific + moving * x[tilt] * reaction_Nm + x[model.offset]
        y = within_or_nan(sample.acceleration_m_s2, FASTEST_M_S2) - expected + row @ x
        nu = y - row @ x
        variance = accelerometer_std**2 + (SHAKING_M_S2_PER_NM * shaken_Nm) ** 2
        unlike = nu**2 > self.gate * (row @ belief.cov @ row + variance)
        doubted = inflate(belief, model.disturbance, nu**2)
        corrected = consider_radius(belief, correct_row(belief, row, y, variance), model)
        return choose(unlike, doubted, corrected)

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
            disturbance_m_s2=x[model.disturbance],
            flags=0.0,
        )


def within_or_nan(value: Scalar, limit: float) -> Scalar:
    """The value, nan where it is none or larger than the limit."""
    return where(within(value, limit), value, math.nan)


def consider_radius(before: Belief, after: Belief, model: MomentumModel) -> Belief:
    """The belief after a correction from which the radius of the passive wheels has learnt nothing: Schmidt's filter.

    The wheels show (1 + kappa) v. Linearised at an ever different v, their counts seem to tell kappa from v, which they
    do not, and the filter went 30 standard deviations after it where a drag was larger than believed.
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
