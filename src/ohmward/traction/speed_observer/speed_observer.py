"""Speed and slip of a robot from encoders and motor currents, and from whatever else there is; [T] 4.5.

The model predicts (EKF or UKF) with a step that is implicit in the slip, so samples may be 10 ms apart although wheels
settle in 0.5 ms. Every measurement is an update of its own: at its own rate, missing, late or wrong. Matching learns R
of the encoders from the residuals ([T] 3.50); Q is not matched, because matching both finds the size of the noise but
not the ratio of Q to R, which sets the gain (`ohmward.filters.adaptive`), and the Q here is physical.

What shows the speed. The wheels do, as far as they grip: through the slope of traction over slip. A wheel that spins
shows its force and nothing of the speed; friction and speed cannot both be told from a steady spin. Then the speed is
dead-reckoned from the forces, and its sigma grows with what is not known of the grade: 0.17 m/s each second per degree.
A passive wheel, an external speed or a standstill shows it again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.filters import extended, unscented
from ohmward.filters.belief import Belief, PackedBelief, is_healthy, pack, unpack
from ohmward.trace import maximum, where
from ohmward.traction.dynamics.forces import Scene
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample, every, sanitize
from ohmward.traction.speed_observer.conclusions import Known, conclude
from ohmward.traction.speed_observer.encoders import Matched, match, use_encoders
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag, SlipSample
from ohmward.traction.speed_observer.fusion import (
    Fused,
    use_accelerometer,
    use_gyro,
    use_passive_wheels,
    use_pitch,
    use_speed,
    use_standstill,
)
from ohmward.traction.speed_observer.gross_slip import is_ambiguous, test_hypotheses, unexplained_change
from ohmward.traction.speed_observer.late import History, empty_history, remember
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.slip_alarm import SlipAlarm
from ohmward.traction.speed_observer.slip_step import Moved
from ohmward.traction.speed_observer.states import States

METHODS: dict[str, ModuleType] = {"ekf": extended, "ukf": unscented}


class ObserverState(NamedTuple):
    """All that the observer carries from sample to sample: plain numbers.

    belief: mean (n,) and lower triangle of the covariance.
    matched: what R of the encoders is matched to.
    current_A: (driven,) last credible ones.
    history: how the speed has changed lately, for speeds that come late.
    rest_s: how long wheels and motors have been at rest.
    rejected_s: (driven,) how long each encoder has contradicted the model.
    speed_rejected_s: since when the external speed has contradicted the estimate, without a break.
    unexplained_m_s: how much the speed has changed of late without a force, see `let_go`.
    unobserved_s, stuck_s: as in `Known`.
    """

    belief: PackedBelief
    matched: Matched
    current_A: np.ndarray
    history: History
    rest_s: Any
    rejected_s: np.ndarray
    speed_rejected_s: Any
    unexplained_m_s: Any
    unobserved_s: Any
    stuck_s: Any


@dataclass(frozen=True)
class SpeedObserver:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        scene: robot, and the terrain that it is believed to drive on.
        states: what is estimated besides the robot's own state.
        noise: how wrong sensors and model may be, and which sensors there are.
        method: "ekf" or "ukf".
        matching: learn R of the encoders from the residuals (AEKF, AUKF).
        window: effective samples of that; [T] takes 100.
        test: when a wheel slips and the robot is stuck.
        gate: largest NIS of a measurement of the body that is used; 10.8 is 99.9 %.
        surprise: NIS of an encoder beyond which its wheel has met other ground.
        reset_after_s: for so long an encoder or an external speed may contradict everything else. Then the encoder is
            doubted; an external speed is believed.
        gap_s: a longer step says nothing about the current in between.
        rest_hold_s: wheels and motors must be at rest for so long before the speed counts as zero; inf never does.
        rest_wheel_rad_s, rest_current_A: what counts as rest.
        wheel_speed_limit_rad_s, current_limit_A: beyond it a sensor is at fault.
        late_steps: an external speed may be late by so many samples.
    """

    scene: Scene
    states: States = field(default_factory=States)
    noise: ObserverNoise = field(default_factory=ObserverNoise)
    method: str = "ukf"
    matching: bool = False
    window: float = 100.0
    test: SlipAlarm = field(default_factory=SlipAlarm)
    gate: float = 10.8
    surprise: float = 25.0
    reset_after_s: float = 1.0
    gap_s: float = 0.1
    rest_hold_s: float = 0.5
    rest_wheel_rad_s: float = 0.05
    rest_current_A: float = 0.5
    wheel_speed_limit_rad_s: float = 500.0
    current_limit_A: float = 200.0
    late_steps: int = 20

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        if self.scene.robot.chassis.scrubs:
            raise InputError(
                "scene.robot must have wheels that are free sideways; describe a skid-steered robot as "
                'Differential(driven="all"), give it a gyro and raise noise.yaw_rate_walk'
            )
        for name in ("gate", "surprise", "gap_s", "wheel_speed_limit_rad_s", "current_limit_A"):
            require_positive(name, getattr(self, name))
        for name in ("reset_after_s", "rest_wheel_rad_s", "rest_current_A"):
            require_between(name, getattr(self, name), 0.0, math.inf)
        require_between("window", self.window, 1.0, math.inf)
        require_between("late_steps", self.late_steps, 0, 1000)
        if self.states.accelerometer_offset and self.noise.accelerometer_std_m_s2 is None:
            raise InputError(
                "states.accelerometer_offset needs noise.accelerometer_std_m_s2; give it or drop the state"
            )

    @cached_property
    def model(self) -> Model:
        """The robot as the filter sees it."""
        return Model(self.scene, self.states, self.noise)

    @property
    def free_wheels(self) -> bool:
        """Whether nothing is learnt of the ground: then turns are the gyro's first, and what wheels add is slip."""
        return self.states.friction == "known"

    def no_sample(self) -> SlipSample:
        """A sample without any measurement, to be filled with `_replace`."""
        robot = self.scene.robot
        return SlipSample(0.0, np.full(len(robot.places), math.nan), np.full(robot.driven, math.nan))

    def init(self, first: SlipSample) -> ObserverState:
        """State before the first sample, which it looks at: a body that moves as the driven wheels say."""
        n = self.model.driven
        reading = sanitize(first, np.zeros(n), self.gap_s, self.current_limit_A, self.wheel_speed_limit_rad_s)
        belief = self.model.first_belief(np.asarray(reading.wheel_speed_rad_s[:n], dtype=float))
        history = empty_history(0 if self.noise.speed_std_m_s is None else self.late_steps)
        matched = Matched(np.zeros(n), np.zeros(n))
        current_A = np.asarray(reading.current_A, dtype=float)
        return ObserverState(pack(belief), matched, current_A, history, 0.0, np.zeros(n), 0.0, 0.0, 0.0, 0.0)

    def step(self, state: ObserverState, sample: SlipSample) -> tuple[ObserverState, SlipEstimate]:
        """The state after a sample, and what is known then."""
        before = unpack(state.belief)
        reading = sanitize(sample, state.current_A, self.gap_s, self.current_limit_A, self.wheel_speed_limit_rad_s)
        rest_s = where(self.looks_at_rest(reading), state.rest_s + reading.dt_s, 0.0)
        resting = rest_s > self.rest_hold_s
        reading = self.held(reading, resting)
        prior = self.predict(before, reading)
        moved = self.model.moved(before.mean, reading)
        lag = self.model.encoder_lag(before.mean, prior.mean, moved)
        if self.free_wheels:
            prior = use_gyro(Fused(prior, 0.0, 0.0), sample, self.model, self.gate).belief
        fused, wheels = self.use_wheels(state, prior, lag, moved, reading)
        changed_m_s = speed_change(before, prior, fused, reading)
        history = remember(state.history, reading.dt_s, changed_m_s)
        rejected_s = [
            where(w.surprising, t + reading.dt_s, where(measured, 0.0, t))
            for w, t, measured in zip(wheels, state.rejected_s, reading.measured, strict=False)
        ]
        fused, speed_rejected_s = self.use_body(fused, lag, state, sample, reading, history)
        fused = use_standstill(fused, resting, self.model)
        unexplained_m_s = state.unexplained_m_s
        if is_ambiguous(self.model):
            step = before, prior, fused.belief
            unexplained_m_s = unexplained_change(unexplained_m_s, *step, reading, self.model)
            fused, unexplained_m_s = test_hypotheses(fused, unexplained_m_s, reading, self.model, self.gate)

        agrees = np.array([w.agrees for w in wheels])
        estimate, known = conclude(
            fused, agrees, Known(state.unobserved_s, state.stuck_s), reading, self.model, self.test
        )
        healthy = where(is_healthy(before) > 0.5, 0.0, float(SlipFlag.NOT_POSITIVE_DEFINITE))
        matched = match(state.matched, wheels, self.window) if self.matching else state.matched
        after = ObserverState(
            pack(fused.belief),
            matched,
            reading.current_A,
            history,
            rest_s,
            np.array(rejected_s),
            speed_rejected_s,
            unexplained_m_s,
            *known,
        )
        return after, estimate._replace(flags=estimate.flags + reading.flags + healthy)

    def predict(self, belief: Belief, reading: CleanSlipSample) -> Belief:
        """The belief at the end of the step, before its measurements."""
        Q = self.model.process_noise(belief.mean, reading)
        start = self.model.moved(belief.mean, reading).slip_m_s if self.method == "ukf" else None
        return METHODS[self.method].predict(belief, lambda x: self.model.next_state(x, reading, start), Q)

    def looks_at_rest(self, reading: CleanSlipSample) -> Any:
        """Whether the driven wheels stand, as far as they can be seen, and the motors do nothing."""
        n = self.model.driven
        still = [abs(w) <= self.rest_wheel_rad_s for w in reading.wheel_speed_rad_s[:n]]
        idle = [abs(i) <= self.rest_current_A for i in reading.current_A]
        return every([*still, *idle, *reading.measured[:n], *(g < 0.5 for g in reading.guessed)])

    def held(self, reading: CleanSlipSample, resting: Any) -> CleanSlipSample:
        """The reading of a robot that stands: whatever holds it, the model must not push it."""
        return reading._replace(
            moving_s=where(resting, 0.0, reading.moving_s), unknown_s=where(resting, 0.0, reading.unknown_s)
        )

    def use_wheels(
        self, state: ObserverState, prior: Belief, lag: np.ndarray, moved: Moved, reading: CleanSlipSample
    ) -> Any:
        """The prior corrected with the encoders of the driven wheels."""
        jumps_teach = self.method == "ukf" and not self.free_wheels
        settings = self.model, self.surprise, self.reset_after_s, jumps_teach
        noise = self.model.torque_noise_rad_s(moved, reading)
        return use_encoders(prior, lag, noise, reading, state.matched, state.rejected_s, *settings)

    def use_body(
        self,
        fused: Fused,
        lag: np.ndarray,
        state: ObserverState,
        sample: SlipSample,
        reading: CleanSlipSample,
        history: History,
    ) -> tuple[Fused, Any]:
        """With all that measures the body; and how long the external speed has contradicted the estimate."""
        fused = use_passive_wheels(fused, lag, reading, self.model, self.gate)
        if not self.free_wheels:
            fused = use_gyro(fused, sample, self.model, self.gate)
        fused = use_pitch(fused, sample, self.model, self.gate)
        fused = use_accelerometer(fused, sample, reading, self.model, self.gate)
        if self.noise.speed_std_m_s is None:
            return fused, state.speed_rejected_s
        since_s = where(state.speed_rejected_s > 0.0, state.speed_rejected_s + reading.dt_s, 0.0)
        fused, contradicts = use_speed(fused, sample, history, since_s > self.reset_after_s, self.model, self.gate)
        begun_s = where(contradicts > 0.5, maximum(since_s, reading.dt_s), since_s)
        return fused, where(abs(sample.speed_m_s) >= 0.0, where(contradicts > 0.5, begun_s, 0.0), since_s)


def speed_change(before: Belief, prior: Belief, fused: Fused, reading: CleanSlipSample) -> Any:
    """Change [m/s] of the speed in the step: as the forces say; as the wheels say where a motor current is missing."""
    forces_known = every([g < 0.5 for g in reading.guessed])
    return where(forces_known, prior.mean[0], fused.belief.mean[0]) - before.mean[0]
