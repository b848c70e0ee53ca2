"""The odometry as a filter: `init` and `step` are pure functions of its settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_positive
from ohmward.filters import extended
from ohmward.filters.belief import Belief, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose, inflate, widen
from ohmward.filters.linear_algebra import TINY, mirror_lower
from ohmward.filters.linear_algebra import std as std_of
from ohmward.filters.sanitize import every, some
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Scalar, clip, cos, exp, linearize, logical_not, maximum, minimum, sin, sqrt, where
from ohmward.traction.motion.outside_speed import ALARM, IS_HELD, Held
from ohmward.traction.motion.sample import (
    ENTRY_S,
    FIRST_INTERVAL_S,
    LOST,
    MOST_YAW_RAD_S,
    CleanSample,
    EncoderWatch,
    change_since,
    no_sample,
    sanitize,
    was_seen,
    watch_encoders,
    without_stopped,
)
from ohmward.traction.motion.stuck_sensors import GyroWatch, SpeedWatch, without_stuck_gyro, without_stuck_speed
from ohmward.traction.odometry.corrections import (
    LEAST_REJECTED_STD,
    MOST_OPENED,
    OVERRUN_S,
    HeadingTimes,
    Overrun,
    PoseCorrection,
    Trail,
    TurnSums,
    Unconfirmed,
    add_turn,
    confirm,
    empty_trail,
    extend,
    forget,
    moved_back,
    run_over,
    use_heading,
    use_increment,
    use_speeds,
    use_turn,
)
from ohmward.traction.odometry.gyro_noise import (
    GyroNoise,
    OffsetWalk,
    gyro_noise_of_sheet,
    learn_gyro_noise,
    learn_offset_walk,
    walk_variance,
)
from ohmward.traction.odometry.measured_motion import (
    GYRO,
    PASSIVE,
    WHEELS,
    MeasuredMotion,
    MotionState,
    in_place_of_wheels,
    no_motion,
    planar,
    rim_matrix,
    sense,
    show,
    turn_per_slip,
    with_silent_wheels,
)
from ohmward.traction.odometry.model import (
    CURVATURE,
    GROSS_SLIP,
    GYRO_SCALE,
    OFFSET,
    RADIUS,
    SLIP,
    SPEED_ERROR,
    SPEED_SCALE,
    TURN_SCALE,
    UNOBSERVED,
    YAW,
    MotionInput,
    OdometryNoise,
    X,
    Y,
    first_belief,
    next_state,
    noise_of,
    position_std,
    process_noise,
    twist,
    vector,
    yaw_now,
)
from ohmward.traction.odometry.modes import lever_m
from ohmward.traction.odometry.sample import Observed, OdometryEstimate, OdometryFlag, OdometrySample
from ohmward.traction.odometry.turn_watch import TurnWatch, watch_of_turn, watch_turn, without_wrong
from ohmward.traction.robot.robot import Robot

#: Standard deviations of a constant error from which these are doubled: it is larger than usual.
LARGER_SIGMAS = 2.0

#: Weights (constants, n) of sums of constant errors whose prior is widened then: of unlike wheels, of the track,
#: and of outside speeds.
CONSTANT_ERRORS = np.array(
    [vector(weights) for weights in ({CURVATURE: 1.0}, {TURN_SCALE: 1.0, GYRO_SCALE: 1.0}, {SPEED_SCALE: 1.0})]
)

#: Limits of the scale by which outside speeds are corrected.
SPEED_SCALES = -0.5, 1.0

#: Factor on the variance of a prior beyond which the error has been opened since, and the standard deviation then.
OPENED, ANY_STD = 1.01, 1e6

#: Times [s] before the wheels' last value over which their acceleration is found, of those at 5 Hz and faster.
CHANGES_S = (0.2, 0.5)


class Agreed(NamedTuple):
    """Part of the belief when wheels and gyro last agreed on the turn."""

    yaw_rad: Any = 0.0
    turn_scale: Any = 0.0
    turn_scale_variance: Any = 0.0


class Watches(NamedTuple):
    """Watches of the sensors for faults."""

    gyro: GyroWatch  #: of whether it is stuck
    encoders: EncoderWatch  #: of whether they have stopped
    turn: TurnWatch  #: of a wrong gyro, and of encoders that count the other way
    speed: SpeedWatch  #: of whether the outside speed is stuck


class PoseState(NamedTuple):
    """State from sample to sample: plain numbers."""

    belief: PackedBelief  #: packed, of `model.NAMES`
    motion: MotionState  #: last values of the sensors
    gyro: GyroNoise  #: its noise as learnt so far
    watches: Watches  #: of the sensors
    sums: TurnSums  #: angles of gyro and wheels since they were last compared
    trail: Trail  #: the last steps, for pose increments
    agreed: Agreed  #: yaw and scale of the turn when wheels and gyro last agreed
    offset_walk: OffsetWalk  #: of the gyro
    constant_stds: np.ndarray  #: (constants,) of errors that are constant along a drive, as large as they proved
    heading: HeadingTimes = HeadingTimes()  #: times of headings
    overrun: Overrun = Overrun()  #: distance beyond that of the outside speeds
    unconfirmed: Unconfirmed = Unconfirmed()  #: change of the rims' speed that these have not confirmed
    changed_yaw_rad: Any = 0.0  #: yaw at the gyro's last change
    slip_std_m_s: Any = 0.0  #: standard deviation that the slip was scaled by in that step
    distance_m: Any = 0.0  #: length of the path
    #: (2, 2) standard deviations [m] of x and y by the yaw error beyond its share in `belief`, along the way and across
    nonlinear_m: np.ndarray = np.zeros((2, 2))
    #: (2,) distance in x and y [m] by the wheels beyond that of the pose since the outside speed may be stuck
    held_back_m: np.ndarray = np.zeros(2)


class PoseStep(NamedTuple):
    """Outcome of a step."""

    state: PoseState  #: after it
    estimate: OdometryEstimate  #: still without flags
    incidents: dict[IntFlag, Scalar]  #: conditions of `OdometryFlag`
    unobserved_s: Scalar  #: time since wheels or an observer have shown the speed; 0 while their last value holds


@dataclass(frozen=True)
class PoseFilter:
    """Settings; `init` and `step` are pure functions of them."""

    robot: Robot  #: robot with its wheels
    noise: OdometryNoise  #: of sensors and wheels
    gate: float = 10.8  #: NIS beyond which a measurement is not used; 10.8 is 99.9 %
    #: time of disagreement after which the gyro's offset may have changed (gyro and wheels), or the zero of the
    #: headings (headings and yaw)
    reset_after_s: float = 5.0
    gap_s: float = 0.5  #: a longer step is flagged
    #: number of samples within which a pose increment must have begun, and by which a speed from outside may be late,
    #: or that many times `ENTRY_S` if that is longer; 0 disables increments
    late_steps: int = 20

    def __post_init__(self) -> None:
        require_each_positive("", self, "gate", "gap_s", "reset_after_s")
        require_between("late_steps", self.late_steps, 0, 1000)

    @cached_property
    def rims(self) -> np.ndarray:
        """(3, driven): `rim_matrix` of the robot."""
        return rim_matrix(self.robot)

    @cached_property
    def rolling(self) -> np.ndarray:
        """(driven, 3): speeds of the driven wheels' centres along their rolling directions, of the motion `PLANAR`."""
        return planar(self.robot, self.robot.rolling[: self.robot.driven].T).T

    @cached_property
    def turn_per_slip(self) -> float:
        """Yaw rate from independent slip of the wheels, per standard deviation of the slip [1/m]."""
        return turn_per_slip(self.robot)

    def no_sample(self) -> OdometrySample:
        """A sample without any measurement, to be filled with `_replace`."""
        return OdometrySample(no_sample(self.robot))

    def init(self, first: OdometrySample) -> PoseState:
        """State before the first sample: the origin of the frame `odom`."""
        counted_m = self.robot.wheel.radius_m * self.noise.encoder_std_rad / math.sqrt(2.0)
        belief = first_belief(self.noise, self.turn_per_slip, self.turn_per_slip * counted_m)
        return PoseState(
            belief=pack(belief),
            motion=no_motion(self.robot, self.late_steps),
            gyro=gyro_noise_of_sheet(self.noise.gyro_walk),
            watches=Watches(GyroWatch(), watch_encoders(self.robot), watch_of_turn(self.robot), SpeedWatch()),
            sums=TurnSums(),
            trail=empty_trail(self.late_steps),
            agreed=Agreed(0.0, belief.mean[TURN_SCALE], belief.cov[TURN_SCALE, TURN_SCALE]),
            offset_walk=OffsetWalk(offset_variance=belief.cov[OFFSET, OFFSET]),
            constant_stds=np.array([std_of(e @ belief.cov @ e) for e in CONSTANT_ERRORS]),
        )

    def step(self, state: PoseState, sample: OdometrySample) -> tuple[PoseState, OdometryEstimate]:
        """State and estimate after a sample."""
        after, estimate, incidents, _ = self.observe(state, sample)
        return after, estimate._replace(flags=flags_of(incidents))

    def observe(self, state: PoseState, sample: OdometrySample) -> PoseStep:
        """Outcome of a step: dead reckoning, then each measurement corrects."""
        clean, watches = watch_sensors(state.watches, sanitize(sample.robot, self.gap_s), self.robot)
        state = self.with_found_faults(state, watches)
        clean, motion, gyro = self.measure(state, clean, watches, sample.observed)
        is_caught = motion.is_held & (state.motion.held.probability <= IS_HELD)
        reckoned = self.reckon(state, motion, is_caught)
        after = self.remember(state, motion, reckoned, is_caught)._replace(gyro=gyro, watches=watches)
        overrun_m = where(is_caught, 0.0, state.overrun.way_m)
        body = self.correct(after, reckoned, sample, clean, motion, overrun_m)
        after = self.learn(after, body, motion)
        missed = turn_missed(unpack(after.belief).mean, watches, state.changed_yaw_rad)
        incidents = self.incidents(unpack(state.belief), clean, motion, body, watches)
        return PoseStep(after, self.conclude(motion, after, missed), incidents, motion.input.unobserved_s[0])

    def with_found_faults(self, state: PoseState, watches: Watches) -> PoseState:
        """The state before a sample, corrected for the faults of sensors that the sample has shown.

        watches: after the sample.
        """
        was, noise = state.watches, self.noise
        stuck = watches.gyro.stuck & logical_not(was.gyro.stuck)
        before = with_missed_turn(unpack(state.belief), watches.gyro, stuck, state.changed_yaw_rad, noise)
        returns = was.gyro.suspected & logical_not(some([was.gyro.stuck, watches.gyro.suspected]))
        before = choose(returns, with_unknown_turn(before, was.gyro, state.changed_yaw_rad), before)
        stopped = newly(watches.encoders.stopped, was.encoders.stopped)
        before = choose(stopped, with_first_scale(before, noise), before)
        agreed = when_agreed(state.agreed, before, was.turn)
        wrong = watches.turn.wrong & logical_not(was.turn.wrong)
        before = choose(wrong, with_turn_of_wheels(before, watches.turn, agreed, noise), before)
        reverses = watches.turn.some_reversed & logical_not(was.turn.some_reversed)
        before = choose(reverses, with_lost_way(before, watches.turn, agreed), before)
        freed = watches.speed.stuck & logical_not(was.speed.stuck)
        before = choose(freed, moved_on(before, state.held_back_m), before)
        motion = choose(freed, state.motion._replace(held=Held()), state.motion)
        return state._replace(belief=pack(before), agreed=agreed, motion=motion)

    def measure(
        self, state: PoseState, clean: CleanSample, watches: Watches, observed: Observed
    ) -> tuple[CleanSample, MeasuredMotion, GyroNoise]:
        """The sample with what stands in for sensors that are silent, its motion, and the noise of the gyro after it.

        state: before the sample.  watches: after it.  observed: of a speed observer.
        """
        before = unpack(state.belief)
        speed_scale = clip(before.mean[SPEED_SCALE], *SPEED_SCALES)
        clean = clean._replace(speed_m_s=clean.speed_m_s / (1.0 + speed_scale))
        clean, silent = with_silent_wheels(clean, state.motion, before.mean, self.robot)
        clean, outside = in_place_of_wheels(clean, state.motion, self.robot, self.noise)
        sensors, jump = sense(state.motion, clean, silent, observed, outside, self.robot)
        since_s = state.motion.intervals.age_s[WHEELS] + clean.dt_s
        gyro = self.estimate_gyro_noise(state.gyro, sensors, clean.dt_s)
        walk = walk_variance(gyro, self.noise.gyro_walk)
        motion = show(sensors, jump, clean, since_s, walk, before, self.robot, self.noise)
        u = motion.input._replace(
            comparable=motion.input.comparable & watches.gyro.comparable & logical_not(silent),
            offset_walk=state.offset_walk.variance(self.noise.gyro_offset_walk),
            wheels_variance=state.sums.differences.noise_variance,
            speed_scale=speed_scale,
        )
        return clean, motion._replace(input=u), gyro

    def reckon(self, state: PoseState, motion: MeasuredMotion, is_caught: Scalar) -> Belief:
        """Belief at the end of a step by dead reckoning; is_caught: the robot is held from the step on."""
        before, slip_std_m_s = unpack(state.belief), motion.input.motion_std[0]
        prior = with_slip_speed(before, state.slip_std_m_s, slip_std_m_s)
        alone = motion.by_driven & (abs(motion.input.slip_sigmas) > GROSS_SLIP)
        changed_m_s = (motion.sensors.modes.forward_m_s - state.motion.modes.forward_m_s).mean()
        slip_m_s = state.slip_std_m_s * before.mean[SLIP]
        prior = choose(alone, with_rims_alone(prior, slip_m_s, changed_m_s, slip_std_m_s), prior)
        stands = moved_back(forget(prior, SLIP, 1.0), state.overrun.way_m, motion.input)
        return self.predict(opened(choose(is_caught, stands, prior), motion, motion.speed.std_m_s), motion.input)

    def remember(self, state: PoseState, motion: MeasuredMotion, reckoned: Belief, is_caught: Scalar) -> PoseState:
        """The state with the motion of a step, before the measurements correct its belief."""
        before, u = unpack(state.belief).mean, motion.input
        dt_s = u.dt_s
        slides = where(is_caught, 1.0, motion.sensors.held.slides)
        return state._replace(
            motion=motion.sensors,
            sums=add_turn(state.sums, u, motion.rim_m),
            trail=extend(state.trail, twist(before, u), dt_s),
            overrun=run_over(state.overrun, twist(reckoned.mean, u)[0], motion.outside, slides, dt_s),
            unconfirmed=confirm(state.unconfirmed, motion.sensors.rim_m_s, motion.outside, state.overrun, dt_s),
            slip_std_m_s=u.motion_std[0],
            nonlinear_m=state.nonlinear_m + by_nonlinearity(before, reckoned),
        )

    def learn(self, state: PoseState, body: PoseCorrection, motion: MeasuredMotion) -> PoseState:
        """The state with the belief after the measurements, and what this says of gyro, wheels and path."""
        u, watches = motion.input, state.watches
        walk_std = self.noise.gyro_offset_walk
        offset_walk, belief = learn_offset_walk(state.offset_walk, body.belief, u.dt_s, walk_std)
        constant_stds = []
        for e, std in zip(CONSTANT_ERRORS, state.constant_stds, strict=True):
            belief, wider = with_wider_prior(belief, e, std, -self.noise.scrub * e[TURN_SCALE])
            constant_stds.append(wider)
        held_back_m = state.held_back_m + held_back(belief, motion, u.dt_s)
        return state._replace(
            belief=pack(belief),
            sums=body.sums,
            heading=body.heading,
            offset_walk=offset_walk,
            constant_stds=np.array(constant_stds),
            changed_yaw_rad=where(watches.gyro.rate.count > 0.0, state.changed_yaw_rad, belief.mean[YAW]),
            distance_m=state.distance_m + travelled(belief, u),
            held_back_m=where(watches.speed.doubted, held_back_m, 0.0),
        )

    def estimate_gyro_noise(self, known: GyroNoise, sensors: MotionState, dt_s: Scalar) -> GyroNoise:
        """Noise of the gyro after the step; its sample is new if its age is zero."""
        new = sensors.intervals.age_s[GYRO] <= 0.0
        stands = every([speed == 0.0 for speed in sensors.wheel_speed_rad_s]) & was_seen(sensors.intervals)[WHEELS]
        return learn_gyro_noise(known, sensors.gyro_rad_s, new, stands, dt_s, self.noise.gyro_walk)

    def predict(self, before: Belief, u: MotionInput) -> Belief:
        """Belief at the end of a step by dead reckoning."""
        Q = process_noise(before.mean, u, self.noise)
        mean, F = linearize(lambda x: next_state(x, u, self.noise), before.mean)
        F[[X, Y], YAW] = F[[X, Y], YAW] * exp(-0.5 * before.cov[YAW, YAW])
        return Belief(mean, mirror_lower(F @ before.cov @ F.T + Q))

    def correct(
        self,
        state: PoseState,
        reckoned: Belief,
        sample: OdometrySample,
        clean: CleanSample,
        motion: MeasuredMotion,
        overrun_m: Scalar,
    ) -> PoseCorrection:
        """Correct with wheels against gyro, with external speeds, with a pose increment and with a heading.

        state: with the motion of the step.  overrun_m: distance by which the pose is ahead of the outside speeds.
        """
        noise, gate, u = self.noise, self.gate, motion.input
        fresh = some([motion.sensors.intervals.age_s[channel] <= 0.0 for channel in (WHEELS, PASSIVE)])
        body = PoseCorrection(reckoned, state.sums, state.heading)
        body = use_turn(body, u, fresh, gate, self.reset_after_s)
        body = body._replace(belief=opened(body.belief, motion, self.slip_by_turn(body, motion)))
        slides = motion.sensors.held.slides
        body = use_speeds(body, sample, clean, u, motion.outside, slides, overrun_m, noise, gate)
        body = use_increment(body, sample, u, state.trail, noise, gate)
        return use_heading(body, sample, u, noise, gate, self.reset_after_s)

    def slip_by_turn(self, body: PoseCorrection, motion: MeasuredMotion) -> Scalar:
        """Slip [m/s] of rolling driven wheels implied by a turn that they showed and the robot did not make."""
        apart_m_s = lever_m(self.robot) * body.turn_apart_rad_s
        rolls = motion.sensors.modes.probability[0]
        return where(body.turn_rejected, rolls * minimum(apart_m_s, motion.speed.loose_m_s), 0.0)

    def conclude(self, motion: MeasuredMotion, after: PoseState, missed: np.ndarray) -> OdometryEstimate:
        """The estimate still without flags; missed: `missed_variance` of a turn that is not known."""
        overrun, unconfirmed = after.overrun, after.unconfirmed
        x, P = with_open_radius(unpack(after.belief))
        yaw, along = linearize(lambda state: np.array([yaw_now(state, motion.input)]), x)
        to_yaw = P @ along[0]
        apart = np.array([*after.nonlinear_m, np.zeros(2)])
        pose_cov = apart @ apart.T + np.array([
            [P[X, X], P[X, Y], to_yaw[X]],
            [P[Y, X], P[Y, Y], to_yaw[Y]],
            [to_yaw[X], to_yaw[Y], along[0] @ to_yaw],
        ])  # fmt: skip
        alone = where(motion.by_driven & logical_not(motion.is_held), 1.0 - motion.sensors.held.slides, 0.0)
        way = np.array([cos(yaw[0]), sin(yaw[0]), 0.0])
        pose_cov = pose_cov + np.diag(missed) + alone * unconfirmed.way_variance * np.outer(way, way)
        rates, J = linearize(lambda state: twist(state, motion.input), x)
        by_slide = np.array([alone * unconfirmed.speed_variance, 0.0, 0.0])
        changed = motion_changed(motion.input) ** 2 + open_motion(motion, after.watches.turn) ** 2
        twist_cov = mirror_lower(J @ P @ J.T + np.diag(motion.white_variance + by_slide + changed))
        changed_m_s = changed_since_value(motion)
        rims = motion.rims_m_s * (1.0 + motion.input.scale * x[RADIUS])
        stuck = where(motion.by_driven & motion.turns, motion.sensors.held.probability, 0.0)
        # Rims that have come halfway back to the last outside speed no longer slide.
        lasts = 2.0 * abs(motion.sensors.rim_m_s - overrun.last_m_s) >= abs(overrun.slip_m_s)
        slides = motion.by_driven & motion.turns & lasts & (overrun.age_s <= OVERRUN_S)
        all_slip = where(slides, motion.sensors.held.slides, 0.0)
        return OdometryEstimate(
            x_m=x[X],
            y_m=x[Y],
            yaw_rad=yaw[0],
            pose_cov=pose_cov,
            position_std_m=position_std(pose_cov),
            speed_m_s=rates[0],
            speed_left_m_s=rates[1],
            yaw_rate_rad_s=rates[2],
            twist_cov=twist_cov + np.diag([changed_m_s * changed_m_s, 0.0, 0.0]),
            distance_m=after.distance_m,
            gyro_offset_rad_s=x[OFFSET],
            gyro_offset_std_rad_s=std_of(P[OFFSET, OFFSET]),
            radius_ratio=1.0 + x[RADIUS],
            radius_std=std_of(P[RADIUS, RADIUS]),
            slip_speed_m_s=rims - self.rolling @ rates,
            slip_speed_std_m_s=np.array([std_of(row @ twist_cov @ row) for row in self.rolling]),
            slip_probability=maximum(motion.speed.slips, where(motion.is_held, stuck, all_slip)),
            stuck_probability=stuck,
            flags=0.0,
        )

    def incidents(
        self, before: Belief, clean: CleanSample, motion: MeasuredMotion, body: PoseCorrection, watches: Watches
    ) -> dict[IntFlag, Scalar]:
        """Conditions of the flags of a sample."""
        silent = some_silent(watches.encoders, motion.sensors, self.robot)
        return {
            OdometryFlag.BAD_TIME: logical_not(clean.time_credible),
            OdometryFlag.GAP: clean.gap,
            OdometryFlag.NO_WHEELS: motion.no_wheels,
            OdometryFlag.NO_GYRO: motion.no_gyro,
            OdometryFlag.NO_ENCODER: some([silent, watches.turn.some_reversed]),
            OdometryFlag.WHEEL_JUMP: motion.jump,
            OdometryFlag.WHEEL_SLIPS: motion.by_driven & motion.speed.named,
            OdometryFlag.STUCK: motion.by_driven & motion.turns & (motion.sensors.held.probability > ALARM),
            OdometryFlag.TURN_REJECTED: body.turn_rejected,
            OdometryFlag.SPEED_REJECTED: some([body.speed_rejected, clean.speed_refused]),
            OdometryFlag.HEADING_REJECTED: body.heading_rejected,
            OdometryFlag.INCREMENT_REJECTED: body.increment_rejected,
            OdometryFlag.INCREMENT_TOO_OLD: body.increment_too_old,
            OdometryFlag.NOT_POSITIVE_DEFINITE: logical_not(every([v >= 0.0 for v in np.diag(before.cov)])),
        }


def watch_sensors(before: Watches, clean: CleanSample, robot: Robot) -> tuple[CleanSample, Watches]:
    """The sample without the values of sensors at fault, and the watches after it."""
    since_s = before.gyro.wheel_age_s + clean.dt_s
    clean, encoders = without_stopped(clean, before.encoders, robot)
    clean, gyro = without_stuck_gyro(clean, before.gyro, robot)
    turn = watch_turn(before.turn, clean, since_s, gyro.average_rad_s, robot)
    clean = without_wrong(clean, turn, robot)
    clean, speed = without_stuck_speed(clean, before.speed, since_s, robot)
    return clean, Watches(gyro, encoders, turn, speed)


def newly(now: np.ndarray, before: np.ndarray) -> Scalar:
    """The condition that one of some conditions has begun to hold."""
    return some([holds_now & logical_not(held) for holds_now, held in zip(now, before, strict=True)])


def with_first_scale(belief: Belief, noise: OdometryNoise) -> Belief:
    """The belief with the scale of the wheels' turn as at the start: one that has stopped has spoilt it."""
    return forget(belief, TURN_SCALE, noise.turn_scale_std**2 + noise.gyro_scale_std**2, -noise.scrub)


def when_agreed(before: Agreed, belief: Belief, watch: TurnWatch) -> Agreed:
    """Yaw and scale when wheels and gyro last agreed; watch: of the sample of this belief."""
    x, P = belief
    return choose(watch.agrees > 0.5, Agreed(x[YAW], x[TURN_SCALE], P[TURN_SCALE, TURN_SCALE]), before)


def with_turn_of_wheels(belief: Belief, watch: TurnWatch, agreed: Agreed, noise: OdometryNoise) -> Belief:
    """The belief with the turn of the wheels since they last agreed with a gyro that is found to be wrong.

    The way since then is lost, unless it is open anyway.
    """
    first = forget(belief, TURN_SCALE, agreed.turn_scale_variance, agreed.turn_scale)
    yaw_rad = agreed.yaw_rad + watch.turned_rad * (1.0 + agreed.turn_scale)
    across = missed_variance(where(watch.scaled, watch.most_rad, 0.0), watch.way_m)
    by_scale = agreed.turn_scale_variance + noise.turn_share**2
    variance = {X: across[0], Y: across[1], YAW: watch.turned_rad**2 * by_scale}
    return Belief(first.mean + vector({YAW: yaw_rad - belief.mean[YAW]}), first.cov + np.diag(vector(variance)))


def moved_on(belief: Belief, way_m: np.ndarray) -> Belief:
    """The belief after a stuck outside speed, which has held it back by this distance (2,), known to a third of it."""
    free = forget(forget(belief, SLIP, 1.0), SPEED_ERROR, 1.0)
    way = vector({X: way_m[0], Y: way_m[1]})
    return Belief(free.mean + way, free.cov + np.outer(way, way) / 9.0)


def with_lost_way(belief: Belief, watch: TurnWatch, agreed: Agreed) -> Belief:
    """The belief without the way and the scale that encoders have shown since they began to count the other way."""
    first = forget(forget(belief, TURN_SCALE, agreed.turn_scale_variance, agreed.turn_scale), SLIP, 1.0)
    variance = watch.way_m * watch.way_m
    return Belief(first.mean, first.cov + np.diag(vector({X: variance, Y: variance})))


def some_silent(encoders: EncoderWatch, sensors: MotionState, robot: Robot) -> Scalar:
    """The condition that some driven wheels have had no value for long, while others have."""
    longest_s = (LOST + 1) * maximum(sensors.intervals.usual_s[WHEELS], FIRST_INTERVAL_S)
    silent = [silent_s > longest_s for silent_s in encoders.silent_s[: robot.driven]]
    return some(silent) & logical_not(every(silent))


def missed_turn(x: np.ndarray, watch: GyroWatch, yaw_rad: Scalar) -> Scalar:
    """Turn [rad] that the wheels have shown, and the yaw in state x has not, since the gyro's last change.

    yaw_rad: the yaw then.
    """
    return yaw_rad + watch.wheels_rad * (1.0 + x[TURN_SCALE]) - x[YAW]


def turn_missed(x: np.ndarray, watches: Watches, changed_yaw_rad: Scalar) -> np.ndarray:
    """Variance (3,) of the pose by turns that a gyro may have missed, and by those that may have had no way.

    x: (n,) state.  changed_yaw_rad: yaw at the gyro's last change.
    """
    gyro, turn = watches.gyro, watches.turn
    suspected = gyro.suspected & logical_not(gyro.stuck)
    missed_rad = where(suspected, missed_turn(x, gyro, changed_yaw_rad), 0.0)
    open_rad = where(turn.spins, abs(turn.turned_rad), turn.most_rad)
    by_gyro = missed_variance(missed_rad, gyro.rims_m)
    return by_gyro + where(turn.turn_open, missed_variance(open_rad, turn.way_m), 0.0)


def held_back(belief: Belief, motion: MeasuredMotion, dt_s: Scalar) -> np.ndarray:
    """Distance (2,) in x and y [m] by which the pose stays behind the wheels in a step."""
    behind_m = (motion.rim_forward_m_s - twist(belief.mean, motion.input)[0]) * dt_s
    yaw = yaw_now(belief.mean, motion.input)
    return behind_m * np.array([cos(yaw), sin(yaw)])


def missed_variance(missed_rad: Scalar, way_m: Scalar) -> np.ndarray:
    """Variance (3,) of the pose by a turn that was missed in some part of the way."""
    across_m = way_m * minimum(abs(missed_rad), 1.0)
    return np.array([across_m**2, across_m**2, missed_rad**2])


def with_wider_prior(belief: Belief, e: np.ndarray, std: Scalar, mean: float = 0.0) -> tuple[Belief, Scalar]:
    """The belief, and the standard deviation s of a sum e'x of constant errors, doubled once it proves larger.

    The wider prior N(m, 4 s^2) takes the place of N(m, s^2) from the start, unless the error has been opened since:

        x+ = x + P e (e'x - m) / r,   P+ = P + P e e'P / r,   r = 4 s^2 / 3 - e'P e

    So the gyro's offset and the pose change by what they owe to an error that was taken for too small.
    """
    x, P = belief
    off, along = e @ x - mean, P @ e
    own, variance = e @ along, std * std
    opened_since = own > OPENED * variance
    larger = (abs(off) > LARGER_SIGMAS * std) & logical_not(opened_since)
    gain = along * where(larger, 1.0 / maximum(4.0 / 3.0 * variance - own, variance / 3.0), 0.0)
    after = Belief(x + gain * off, mirror_lower(P + np.outer(gain, along)))
    return after, where(opened_since, ANY_STD, where(larger, 2.0 * std, std))


def with_open_radius(belief: Belief) -> Belief:
    """The belief with a standard deviation of the radius of at least half the scale of the outside speeds.

    Which of the two is wrong is unknown. The wheels are believed, as cameras more often have another scale than wheels
    another radius, and P + q P_k P_k' / P_kk^2 opens the radius error k to P_kk + q, as if from the start.
    """
    x, P = belief
    along = P[:, RADIUS] / maximum(P[RADIUS, RADIUS], TINY)
    opened = maximum((x[SPEED_SCALE] / 2.0) ** 2 - P[RADIUS, RADIUS], 0.0)
    return Belief(x, P + opened * np.outer(along, along))


def with_unknown_turn(belief: Belief, watch: GyroWatch, yaw_rad: Scalar) -> Belief:
    """The belief after a gyro that may have been stuck, so that the turn by the wheels since then may be missed."""
    variance = missed_variance(missed_turn(belief.mean, watch, yaw_rad), watch.rims_m)
    return Belief(belief.mean, belief.cov + np.diag(vector(dict(enumerate(variance)))))


def with_missed_turn(belief: Belief, watch: GyroWatch, found: Scalar, yaw_rad: Scalar, noise: OdometryNoise) -> Belief:
    """The belief with the turn by the wheels since the last change of a gyro that is found to be stuck.

    found: the condition that it is.
    yaw_rad: yaw at that change.
    """
    missed_rad = missed_turn(belief.mean, watch, yaw_rad)
    across = missed_variance(missed_rad, watch.rims_m)
    Q = np.diag(vector({X: across[0], Y: across[1], YAW: (noise.turn_share * watch.wheels_rad) ** 2}))

    def turned(x: np.ndarray) -> np.ndarray:
        by_scale = watch.wheels_rad * (x[TURN_SCALE] - belief.mean[TURN_SCALE])
        return np.array([*x[:YAW], x[YAW] + missed_rad + by_scale, *x[YAW + 1 :]])

    return choose(found, extended.predict(belief, turned, Q), belief)


def with_slip_speed(belief: Belief, before_m_s: Scalar, now_m_s: Scalar) -> Belief:
    """The belief with a widened slip that stays the same in m/s as its standard deviation grows to this."""
    most = 1.0 / sqrt(maximum(belief.cov[SLIP, SLIP], 1.0))
    share = minimum(maximum(before_m_s / maximum(now_m_s, LEAST_REJECTED_STD), most), 1.0)
    scale = np.array([share if i == SLIP else 1.0 for i in range(len(belief.mean))])
    return Belief(belief.mean * scale, belief.cov * np.outer(scale, scale))


def with_rims_alone(belief: Belief, slip_m_s: Scalar, change_m_s: Scalar, std_m_s: Scalar) -> Belief:
    """The belief where the rims of slipping wheels may have changed their speed without the robot.

    Either the slip is the same share of the rims' speed, as the mean has it, or the robot keeps its speed until the
    rims meet it. The difference adds to the standard deviation: the changes of several steps have one cause.

    slip_m_s: before the step.
    change_m_s: of the rims.
    std_m_s: speed of a slip of one standard deviation now.
    """
    left_m_s = slip_m_s - change_m_s
    alone = where(left_m_s * slip_m_s > 0.0, left_m_s, 0.0) / maximum(std_m_s, LEAST_REJECTED_STD)
    apart = alone - belief.mean[SLIP]
    return inflate(belief, SLIP, apart * apart + 2.0 * abs(apart) * sqrt(belief.cov[SLIP, SLIP]))


def opened(belief: Belief, motion: MeasuredMotion, slip_m_s: Scalar) -> Belief:
    """The belief with a slip of at least this standard deviation [m/s], which decays in `correlation_s`."""
    slip = minimum(slip_m_s / maximum(motion.input.motion_std[0], LEAST_REJECTED_STD), MOST_OPENED)
    return choose(motion.by_driven, widen(belief, SLIP, slip * slip), belief)


def by_nonlinearity(before: np.ndarray, after: Belief) -> np.ndarray:
    """Contribution of a step to `PoseState.nonlinear_m` (2, 2).

    A normal yaw error e of standard deviation s changes the way d of a step by d (cos e - 1) along it and by d sin e
    across it, of which q d e is linear, q = exp(-s^2/2). The rest has the mean squares

        E(1 - cos e)^2 = (1 - q)^2 (q^2 + 2 q + 3) / 2,   E(sin e - q e)^2 = (1 - q^4) / 2 - q^2 s^2

    Yaw errors persist, so these add up.
    """
    variance = after.cov[YAW, YAW]
    q = exp(-0.5 * variance)
    along = (1.0 - q) * sqrt((q * q + 2.0 * q + 3.0) / 2.0)
    across = std_of((1.0 - q**4) / 2.0 - q * q * variance)
    dx, dy = after.mean[:YAW] - before[:YAW]
    return np.array([[along * dx, -across * dy], [along * dy, across * dx]])


def motion_changed(u: MotionInput) -> np.ndarray:
    """Standard deviations (3,) [m/s, m/s, rad/s] by which the motion may have changed since it was last observed."""
    unobserved_s = np.array([*u.unobserved_s[:YAW], where(u.by_gyro, 0.0, u.unobserved_s[YAW])])
    return minimum(UNOBSERVED * unobserved_s, np.array([FASTEST_M_S, FASTEST_M_S, MOST_YAW_RAD_S]))


def open_motion(motion: MeasuredMotion, turn: TurnWatch) -> np.ndarray:
    """Standard deviations (3,) of a motion that wheels may not show: their speed and, while they spin, their turn."""
    rim_m_s = where(turn.way_open, sum(abs(motion.rims_m_s)) / len(motion.rims_m_s), 0.0)
    return np.array([rim_m_s, 0.0, where(turn.spins, abs(motion.input.motion[YAW]), 0.0)])


def changed_since_value(motion: MeasuredMotion) -> Scalar:
    """Standard deviation [m/s] of the speed by its change since the time of the wheels' last value, while that holds.

    It goes on changing as before that value, over the usual interval or any of `CHANGES_S`, whichever was fastest. The
    value is that of its time or, as of counts, the mean since the one before, equally likely.
    """
    rims, intervals = motion.sensors.rims, motion.sensors.intervals
    age_s, usual_s = intervals.age_s[WHEELS], maximum(intervals.usual_s[WHEELS], ENTRY_S)

    def fastest_m_s2(shortest_s: Scalar) -> Scalar:
        return reduce(maximum, [abs(change_since(rims, age_s + s)) / s for s in (*CHANGES_S, shortest_s)])

    by_age = fastest_m_s2(usual_s) * age_s
    by_time = fastest_m_s2(maximum(usual_s, CHANGES_S[0])) * usual_s
    return where(motion.by_driven, sqrt(by_age * by_age + by_time * by_time / 8.0), 0.0)


def travelled(belief: Belief, u: MotionInput) -> Scalar:
    """Length [m] of the path of a step."""
    forward, left, _ = twist(belief.mean, u)
    return sqrt(forward * forward + left * left) * u.dt_s


def pose_filter(robot: Robot, noise: OdometryNoise | None = None) -> PoseFilter:
    """The filter of a robot, with the default noise of its chassis unless given."""
    return PoseFilter(robot, noise or noise_of(robot))
