"""Speed and slip of a robot from encoders and motor currents, and from any other sensors; [T] 4.5.

The model predicts (EKF or UKF) with a step that is implicit in the slip, so samples may be 10 ms apart although wheels
settle in 0.5 ms. Every measurement is an update of its own: at its own rate, missing, late or wrong. Matching learns
the white noise of encoders, currents and gyro from their own signals (`matched_noise`); what the ground adds to Q is
not matched, because innovations show the size of the noise but not the ratio of Q to R, which sets the gain
(`ohmward.filters.adaptive`).

The driven wheels show the speed as far as they grip, through the slope of traction over slip. A spinning wheel shows
its force but not the speed; a steady spin cannot determine both friction and speed. The speed is then dead reckoning
from the forces, and its sigma grows with that of the grade: 0.17 m/s each second per degree. A passive wheel, an
external speed or a standstill makes it observable again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import NamedTuple

import numpy as np

from ohmward.checks import (
    require_between,
    require_each_not_negative,
    require_each_positive,
    require_one_of,
)
from ohmward.errors import InputError
from ohmward.filters import extended, unscented
from ohmward.filters.belief import Belief, PackedBelief, is_healthy, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import every, some, within
from ohmward.trace import Scalar, logical_not, maximum, where
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.motion.outside_speed import ALARM, IS_HELD, TURNS_M_S, Held, receive, weigh_held
from ohmward.traction.motion.sample import (
    LEAST_DIVISOR,
    CleanSample,
    History,
    Intervals,
    RobotSample,
    advance,
    empty_history,
    hold_currents,
    hold_still,
    holds,
    never,
    no_sample,
    remember,
    sanitize,
    share_measured,
    was_seen,
)
from ohmward.traction.motion.stuck_sensors import GyroWatch, SpeedWatch, without_stuck_gyro, without_stuck_speed
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.body_sensors import (
    BodyCorrection,
    BodyTimers,
    SensorGate,
    use_gyro,
    use_held,
    use_passive_wheels,
    use_pitch,
    use_speed,
    use_standstill,
)
from ohmward.traction.speed_observer.encoders import (
    POSSIBLE_SIGMAS,
    EncoderCorrection,
    EncoderGate,
    FreeWheels,
    RejectedFor,
    correct_wheels,
    released,
    turned,
)
from ohmward.traction.speed_observer.estimate import (
    SlipAlarm,
    SlipEstimate,
    SlipFlag,
    conclude,
    driven_wheels,
    with_unknown_mass,
)
from ohmward.traction.speed_observer.matched_noise import MatchedNoise, fixed, match, matched_stds, unmatched
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.slip_step import SlipStep
from ohmward.traction.speed_observer.speed_evidence import (
    LEAST_GRIP,
    SEEN_S,
    SpeedEvidence,
    by_mass_m_s,
    fastest_m_s,
    is_lost,
    judge,
    restarted,
    with_reach,
)
from ohmward.traction.speed_observer.states import States


class ObserverState(NamedTuple):
    """State of the observer from sample to sample: plain numbers."""

    belief: PackedBelief  #: mean (n,) and lower triangle of the covariance
    matched: MatchedNoise  #: noise of the sensors; empty without matching
    current_A: np.ndarray  #: (driven,) last credible currents
    current_intervals: Intervals  #: of the motor currents, each (driven,)
    encoder_intervals: Intervals  #: of the encoders, each (wheels,)
    gyro: GyroWatch  #: whether it is stuck
    speed_watch: SpeedWatch  #: whether the outside speed is
    lag_rad_s: np.ndarray  #: (wheels,) lag of the model's wheel speed since each encoder's last value
    free: FreeWheels  #: the wheels as their motors alone would turn them
    history: History  #: recent predicted changes of the speed, for speeds that arrive late
    rest_s: Scalar  #: time for which wheels and motors have been at rest
    rejected: RejectedFor  #: time for which each encoder has been outside its gate, (driven,)
    body_rejected: BodyTimers  #: the same for the sensors of the body
    evidence: SpeedEvidence  #: of whether the wheels show the speed
    unobserved_s: Scalar  #: time since the speed was last observed
    stuck_s: Scalar  #: time for which the wheels have turned and the robot has not


def started(
    belief: Belief, model: Model, late_steps: int, matching: bool, before: ObserverState | None = None
) -> ObserverState:
    """State of an observer with this belief and no past, except for the clocks and noise of its sensors."""
    n, wheels = model.driven, len(model.scene.robot.places)
    return ObserverState(
        belief=pack(belief),
        matched=before.matched if before else unmatched(model) if matching else fixed(),
        current_A=before.current_A if before else np.zeros(n),
        current_intervals=before.current_intervals if before else never(n),
        encoder_intervals=before.encoder_intervals if before else never(wheels),
        gyro=before.gyro if before else GyroWatch(),
        speed_watch=before.speed_watch if before else SpeedWatch(),
        lag_rad_s=np.zeros(wheels),
        free=FreeWheels(belief.mean[model.layout.wheel(0) : model.layout.robot_states], np.zeros(n)),
        history=empty_history(0 if model.noise.speed_std_m_s is None else late_steps),
        rest_s=0.0,
        rejected=RejectedFor(np.zeros(n), np.zeros(n)),
        body_rejected=BodyTimers(0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(wheels - n), 0.0),
        evidence=SpeedEvidence(outside=before.evidence.outside, held=before.evidence.held)
        if before
        else SpeedEvidence(),
        unobserved_s=0.0,
        stuck_s=0.0,
    )


def without_stuck_speeds(clean: CleanSample, state: ObserverState, robot: Robot) -> tuple[CleanSample, ObserverState]:
    """The sample without the outside speed of a stuck source, and the state, which it no longer holds once it is."""
    since_s = state.gyro.wheel_age_s + clean.dt_s
    clean, watch = without_stuck_speed(clean, state.speed_watch, since_s, robot)
    freed = watch.stuck & logical_not(state.speed_watch.stuck)
    held = choose(freed, Held(), state.evidence.held)
    return clean, state._replace(speed_watch=watch, evidence=state.evidence._replace(held=held))


#: Largest force that any ground takes, over the load.
MOST_ADHESION = 2.0


METHODS: dict[str, ModuleType] = {"ekf": extended, "ukf": unscented}

#: If every encoder has been outside its gate for this many times `reset_after_s`, the encoders are not at fault.
LOCKED_OUT = 2.0


class Prediction(NamedTuple):
    """Belief at the end of a step, before its measurements."""

    belief: Belief  #: of the model alone
    step: SlipStep  #: of the mean
    lag_rad_s: np.ndarray  #: (wheels,) `Model.encoder_lag` of a value that comes now
    lag_since_rad_s: np.ndarray  #: (wheels,) that of all steps since the last value


@dataclass(frozen=True)
class SpeedObserver:
    """Settings; `init` and `step` are pure functions of them."""

    scene: Scene  #: robot, and the terrain that it is assumed to drive on
    states: States = field(default_factory=States)  #: what is estimated besides the robot's own state
    noise: ObserverNoise = field(default_factory=ObserverNoise)  #: of sensors and model; says which sensors there are
    method: str = "ukf"  #: "ekf" or "ukf"
    matching: bool = False  #: learn the noise of encoders, currents and gyro (AEKF, AUKF)
    window: float = 100.0  #: effective samples of the matching; [T] uses 100
    alarm: SlipAlarm = field(default_factory=SlipAlarm)  #: tests for slip and for a robot that is stuck
    gate: float = 10.8  #: NIS beyond which a measurement of the body is not used; 10.8 is 99.9 %
    encoder_gate: float = 25.0  #: NIS of an encoder beyond which its wheel has met other ground
    #: time outside its gate after which an encoder is at fault, and an external speed is accepted
    reset_after_s: float = 1.0
    gap_s: float = 0.1  #: a longer step leaves the current in between unknown
    #: time for which wheels and motors must be at rest before the speed counts as zero; inf never does
    rest_hold_s: float = 0.5
    #: a wheel and a motor below both are at rest
    rest_wheel_rad_s: float = 0.05
    rest_current_A: float = 0.5
    #: number of samples by which an external speed may be late, or that many times `ENTRY_S` if that is longer
    late_steps: int = 20

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)
        if self.scene.robot.chassis.scrubs:
            raise InputError(
                "scene.robot must have wheels that are free sideways; describe a skid-steered robot as "
                'Differential(driven="all"), or observe it by `SlipByOdometry`'
            )
        require_each_positive("", self, "gate", "encoder_gate", "gap_s")
        require_each_not_negative("", self, "reset_after_s", "rest_wheel_rad_s", "rest_current_A")
        require_between("window", self.window, 1.0, math.inf)
        require_between("late_steps", self.late_steps, 0, 1000)

    @cached_property
    def model(self) -> Model:
        """The robot as the filter sees it."""
        return Model(self.scene, self.states, self.noise)

    @property
    def robot(self) -> Robot:
        """Robot with its wheels."""
        return self.scene.robot

    @property
    def sensor_gate(self) -> SensorGate:
        """Gate of the sensors of the body."""
        return SensorGate(self.gate, self.reset_after_s)

    def no_sample(self) -> RobotSample:
        """A sample without any measurement, to be filled with `_replace`."""
        return no_sample(self.scene.robot)

    def init(self, first: RobotSample) -> ObserverState:
        """State before the first sample: the body moves as the driven wheels show in it."""
        clean = sanitize(first, self.gap_s)
        speeds = np.asarray(clean.wheel_speed_rad_s[: self.model.driven], dtype=float)
        return started(self.model.first_belief(speeds), self.model, self.late_steps, self.matching)

    def step(self, state: ObserverState, sample: RobotSample) -> tuple[ObserverState, SlipEstimate]:
        """State and estimate after a sample: the model predicts, then each measurement corrects."""
        before, clean, state = self.sanitize(state, sample)
        prediction = self.predict(state, before, clean)
        free = turned(state.free, clean, self.model)
        wheels = self.correct_wheels(state, free, prediction, clean)
        history = remember(state.history, clean.dt_s, speed_change(before, prediction, wheels, clean))
        evidence = self.weigh_held(state.evidence, wheels.belief, clean)
        body = BodyCorrection(wheels.belief, state.body_rejected)
        body = self.correct_body(state, body, prediction, clean, history)
        body = use_held(body, evidence.held.probability > IS_HELD, clean, self.model)
        judged = judge(evidence, before, wheels.belief, body, clean, self.model, self.gate)
        belief = judged.belief._replace(mean=self.model.layout.bounded(judged.belief.mean))
        evidence = with_reach(judged.evidence, belief, body.observable, state.unobserved_s, clean, self.model)
        lost = is_lost(belief, evidence, wheels.rejected.gate_s, LOCKED_OUT * self.reset_after_s, self.model)
        new = restarted(before, clean, self.model)
        stuck_s, estimate = self.conclude(state, choose(lost, new, belief), evidence, wheels, body, clean)
        ground_changed = some([wheels.ground_changed, judged.ground_changed])
        flags = self.flags(state, before, clean, wheels, body, ground_changed, estimate.unobserved_s, lost)
        after = state._replace(
            belief=pack(belief),
            lag_rad_s=where(clean.wheel_measured, 0.0, prediction.lag_since_rad_s),
            free=released(free, belief, clean, self.model),
            history=history,
            rejected=wheels.rejected,
            body_rejected=body.rejected,
            evidence=evidence,
            unobserved_s=estimate.unobserved_s,
            stuck_s=stuck_s,
        )
        fresh = started(new, self.model, self.late_steps, self.matching, state)
        return choose(lost, fresh, after), estimate._replace(flags=flags)

    def sanitize(self, state: ObserverState, sample: RobotSample) -> tuple[Belief, CleanSample, ObserverState]:
        """The belief before the step, the sample without impossible values, and the state with its clocks.

        At an encoder's first value, the belief becomes one of a body that moves as the wheels do. While the robot
        stands, the sample has no motion.
        """
        clean = sanitize(sample, self.gap_s)
        clean, gyro = without_stuck_gyro(clean, state.gyro, self.scene.robot)
        if self.model.noise.speed_std_m_s is not None:
            clean, state = without_stuck_speeds(clean, state, self.scene.robot)
        before = first_sight(unpack(state.belief), clean, state.encoder_intervals, self.model)
        clean = without_impossible_currents(clean, before, self.model)
        current_intervals = advance(state.current_intervals, clean.current_measured, clean.dt_s)
        encoder_intervals = advance(state.encoder_intervals, clean.wheel_measured, clean.dt_s)
        stds = matched_stds(state.matched, self.model) if self.matching else None
        matched = match(state.matched, clean, self.model, self.window) if self.matching else state.matched
        clean = hold_currents(clean, state.current_A, current_intervals)._replace(stds=stds)
        clean = clean._replace(wheel_known=clean.wheel_measured | holds(encoder_intervals))
        at_rest = self.is_at_rest(clean)
        clean = hold_still(clean, where(at_rest, state.rest_s + clean.dt_s, 0.0), self.rest_hold_s)
        lag_share = share_measured(state.encoder_intervals, encoder_intervals, clean.dt_s)
        clean = clean._replace(lag_share=lag_share, interval_s=encoder_intervals.usual_s)
        state = state._replace(
            current_A=clean.current_A,
            current_intervals=current_intervals,
            encoder_intervals=encoder_intervals,
            gyro=gyro,
            rest_s=clean.rest_s,
            matched=matched,
        )
        return before, clean, state

    def is_at_rest(self, clean: CleanSample) -> Scalar:
        """True where all driven wheels and motors are known, and all are at rest."""
        n = self.model.driven
        still = [within(speed, self.rest_wheel_rad_s) for speed in clean.wheel_speed_rad_s[:n]]
        idle = [within(current, self.rest_current_A) for current in clean.current_A]
        return every([*still, *idle, *clean.wheel_known[:n], *clean.current_measured])

    def predict(self, state: ObserverState, before: Belief, clean: CleanSample) -> Prediction:
        """Predict the belief over one step."""
        before = self.model.with_unknown_mass(before)
        step = self.model.slip_step(before.mean, clean)
        Q = self.model.process_noise(step, clean)
        start_m_s = step.slip_m_s if self.method == "ukf" else None
        belief = METHODS[self.method].predict(before, lambda x: self.model.next_state(x, clean, start_m_s), Q)
        lag_rad_s = state.lag_rad_s + self.model.encoder_lag(before.mean, belief.mean, step)
        return Prediction(belief, step, lag_rad_s * clean.lag_share, lag_rad_s)

    def correct_wheels(
        self, state: ObserverState, free: FreeWheels, prediction: Prediction, clean: CleanSample
    ) -> EncoderCorrection:
        """Correct with the encoders of the driven wheels."""
        jumps_informative = self.method == "ukf" and self.states.friction
        gate = EncoderGate(self.encoder_gate, self.reset_after_s, jumps_informative)
        belief, step, lag_rad_s, _ = prediction
        return correct_wheels(free, belief, lag_rad_s, step, clean, state.rejected, self.model, gate)

    def correct_body(
        self,
        state: ObserverState,
        body: BodyCorrection,
        prediction: Prediction,
        clean: CleanSample,
        history: History,
    ) -> BodyCorrection:
        """Correct with every other sensor of the body, and with a standstill."""
        model, gate = self.model, self.sensor_gate
        body = use_passive_wheels(body, prediction.lag_rad_s, clean, model, gate)
        body = use_gyro(body, clean, model, gate)
        body = use_pitch(body, clean, model, gate)
        body = use_speed(body, clean, history, fastest_m_s(state.evidence), model, gate)
        return use_standstill(body, clean.resting, model)

    def weigh_held(self, before: SpeedEvidence, wheels: Belief, clean: CleanSample) -> SpeedEvidence:
        """Weigh whether the robot is held while its wheels turn, if it has an outside speed; wheels: as corrected."""
        std_m_s, model = self.model.noise.speed_std_m_s, self.model
        if std_m_s is None:
            return before
        robot = model.scene.robot
        rim_m_s = robot.motion_by_rims[0] @ (robot.wheel.radius_m * model.layout.split(wheels.mean).omega)
        was_held = before.held.probability > IS_HELD
        outside, y = receive(before.outside, rim_m_s, clean, logical_not(was_held), std_m_s)
        white = y._replace(std_m_s=y.white_std_m_s)  # lasting errors are slides here, not noise
        return before._replace(outside=outside, held=weigh_held(before.held, white, rim_m_s, clean.dt_s))

    def conclude(
        self,
        state: ObserverState,
        belief: Belief,
        evidence: SpeedEvidence,
        wheels: EncoderCorrection,
        body: BodyCorrection,
        clean: CleanSample,
    ) -> tuple[Scalar, SlipEstimate]:
        """Time for which the wheels have turned and the robot has not, and the estimate still without flags."""
        driven = driven_wheels(belief, evidence.open_m_s, self.model)
        encoders = zip(wheels.wheels, driven.grip, strict=True)
        gripping = [wheel.used & (grip > LEAST_GRIP) for wheel, grip in encoders]
        observable = some([*gripping, body.observable])
        unobserved_s = where(observable, 0.0, state.unobserved_s + clean.dt_s)
        motions = zip(driven.travel_m_s, driven.travel_std_m_s, driven.rim_m_s, strict=True)
        stands = every(self.alarm.stands(travel, travel_std, rim) for travel, travel_std, rim in motions)
        stuck_s = where(stands, state.stuck_s + clean.dt_s, 0.0)
        driven = with_unknown_mass(driven, by_mass_m_s(evidence), self.model)
        rim_m_s = self.scene.robot.motion_by_rims[0] @ driven.rim_m_s
        held = (evidence.held.probability > ALARM) & (abs(rim_m_s) > TURNS_M_S)
        stuck = some([stuck_s > self.alarm.stuck_s, held])
        return stuck_s, conclude(belief, driven, unobserved_s, stuck, clean, self.model, self.alarm)

    def flags(
        self,
        state: ObserverState,
        before: Belief,
        clean: CleanSample,
        wheels: EncoderCorrection,
        body: BodyCorrection,
        ground_changed: Scalar,
        unobserved_s: Scalar,
        lost: Scalar,
    ) -> Scalar:
        """Flags of a sample; state: with the clocks and the watches after it."""
        return flags_of({
            SlipFlag.BAD_TIME: logical_not(clean.time_credible),
            SlipFlag.GAP: clean.gap,
            SlipFlag.NO_CURRENT: some([logical_not(every(clean.current_measured)), clean.current_refused]),
            SlipFlag.NO_ENCODER: logical_not(every(clean.wheel_known[: self.model.driven])),
            SlipFlag.GROUND_CHANGED: ground_changed,
            SlipFlag.ENCODER_SPIKE: some([wheels.spike, body.passive_rejected]),
            SlipFlag.ENCODER_REJECTED: some([wheels.suspect, body.passive_suspect]),
            SlipFlag.GYRO_REJECTED: some([body.gyro_rejected, state.gyro.stuck]),
            SlipFlag.SPEED_REJECTED: some([body.speed_rejected, clean.speed_refused]),
            SlipFlag.SPEED_RESET: body.speed_reset,
            SlipFlag.STANDSTILL: clean.resting,
            SlipFlag.SPEED_UNOBSERVED: unobserved_s > SEEN_S,
            SlipFlag.NOT_POSITIVE_DEFINITE: is_healthy(before) <= 0.5,
            SlipFlag.RESTARTED: lost,
        })  # fmt: skip


def speed_change(before: Belief, prediction: Prediction, wheels: EncoderCorrection, clean: CleanSample) -> Scalar:
    """Change [m/s] of the speed in the step: the forces', or the wheels' where a motor current is missing."""
    speed_m_s = where(every(clean.current_measured), prediction.belief.mean[0], wheels.belief.mean[0])
    return speed_m_s - before.mean[0]


def first_sight(belief: Belief, clean: CleanSample, encoders: Intervals, model: Model) -> Belief:
    """The belief, or at an encoder's first value one of a body that moves as the wheels do.

    encoders: clocks before the step.
    """
    n, layout = model.driven, model.layout
    measured = clean.wheel_measured[:n]
    estimated = belief.mean[layout.wheel(0) : layout.robot_states]
    first = measured & logical_not(was_seen(encoders)[:n])
    speeds = where(measured, clean.wheel_speed_rad_s[:n], estimated)
    return choose(some(first), model.first_belief(speeds), belief)


def without_impossible_currents(clean: CleanSample, before: Belief, model: Model) -> CleanSample:
    """The sample without currents whose torque neither the ground nor the wheel can have taken.

    K_m n |I| <= MOST_ADHESION r N + J_w (|change of the wheel's speed| + its uncertainty) / dt
    """
    robot, layout, n = model.scene.robot, model.layout, model.driven
    wheels = slice(layout.wheel(0), layout.robot_states)
    room = [POSSIBLE_SIGMAS * std(P + model.noise.encoder_std_rad_s**2) for P in np.diag(before.cov)[wheels]]
    change = abs(clean.wheel_speed_rad_s[:n] - before.mean[wheels]) + np.array(room)
    wheel_Nm = robot.inertia[robot.freedoms :] * change / maximum(clean.dt_s, LEAST_DIVISOR)
    taken_Nm = MOST_ADHESION * robot.wheel.radius_m * model.static_load_N[:n] + wheel_Nm
    given_Nm = robot.motor.wheel_constant_Nm_per_A * abs(clean.current_A)
    possible = np.array([given <= taken for given, taken in zip(given_Nm, taken_Nm, strict=True)])
    unmeasured = logical_not(clean.wheel_measured[:n])
    refused = clean.current_measured & logical_not(possible | unmeasured)
    return clean._replace(current_measured=clean.current_measured & logical_not(refused), current_refused=some(refused))
