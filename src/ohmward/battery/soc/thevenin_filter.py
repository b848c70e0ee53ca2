"""State of charge by a Kalman filter on the Thevenin model and the errors of sensors and model.

The states are those of `AugmentedThevenin`: the circuit's, and the errors that have to be states for an honest sigma.

The same step serves the extended and the unscented filter, with or without matching R to the residuals ([T] 3.49-3.50).
Q is not matched: matching both finds the size of the noise but not the ratio of Q to R, which sets the gain
(`ohmward.filters.adaptive`), and the Q here is physical.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.noise import SOC_UNKNOWN_STD, BatteryNoise, CurrentSensor
from ohmward.battery.models.thevenin import CircuitInput, Thevenin
from ohmward.battery.soc.anchor_rule import NO_EVENT, AnchorEvent, AnchorMemory, AnchorRule
from ohmward.battery.soc.augmented_thevenin import SOC, AugmentedThevenin, VoltageError
from ohmward.battery.soc.capacity_evidence import CapacityEvidence, count_once
from ohmward.battery.soc.clean_sample import (
    CURRENT_GAP_S,
    CleanSocSample,
    SampleLimits,
    first_input,
    sample_limits,
    sanitize,
)
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import INITIAL_SOC_STD, SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.battery.soc.voltage_faults import (
    JUMP_S,
    HeldVoltage,
    LevelJudgement,
    LevelLimits,
    VoltageLevel,
    beside_current,
    stands_for,
    without_frozen,
)
from ohmward.checks import require_between, require_finite, require_one_of, require_positive
from ohmward.filters import adaptive, extended, unscented
from ohmward.filters.belief import Belief, Correction, Innovation, PackedBelief, pack, unpack
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import apply_gain, choose, inflate, passes, require_gate, restarted_at, time_rejected
from ohmward.filters.kalman import correct_state
from ohmward.filters.linear_algebra import mirror_lower
from ohmward.trace import Scalar, clip, logical_not, maximum, minimum, where

#: Range of plausible capacities, relative to the file's: a battery that has lost half is at the end of its second
#: life, and none gains half.
LEAST_CAPACITY, MOST_CAPACITY = 0.5, 1.5


METHODS: dict[str, ModuleType] = {"ekf": extended, "ukf": unscented}


class FilterState(NamedTuple):
    """State of the filter between two samples: plain numbers."""

    belief: PackedBelief  #: mean, as `TheveninFilter.state_names`, and lower triangle of the covariance
    noise: adaptive.NoiseEstimate  #: moments for covariance matching [V^2]
    current_A: Scalar  #: last credible current
    temperature_degC: Scalar  #: last credible temperature
    rest_s: Scalar  #: time for which the current has looked like rest
    rejected_s: Scalar  #: time for which the voltage has contradicted the belief
    unknown_s: Scalar  #: time for which the current has not been known
    anchors: AnchorMemory  #: memory for the events that anchor SoC
    unknown_K: Scalar = 0.0  #: standard deviation of the temperature, 0 once it has been measured
    held: HeldVoltage = HeldVoltage()  #: memory for a voltage that stands still
    evidence: CapacityEvidence = CapacityEvidence()  #: what voltages and events have shown of the capacity
    level: VoltageLevel = VoltageLevel()  #: memory for a voltage that jumps

    @property
    def members(self) -> tuple[FilterState]:
        """States of the hypotheses, as of a Gaussian sum of one."""
        return (self,)

    @property
    def log_weights(self) -> np.ndarray:
        """(1,) their weights."""
        return np.zeros(1)

    def with_members(self, members: Sequence[FilterState], log_weights: np.ndarray) -> FilterState:
        """The state whose hypotheses have these states and weights."""
        return members[0]


class CleanInput(NamedTuple):
    """Sanitised sample, the event that it completes, and the memories after it."""

    sample: CleanSocSample
    event: AnchorEvent
    anchors: AnchorMemory
    held: HeldVoltage
    misled: Any  #: the condition that SoC was learnt from a dead sensor


class Foresight(NamedTuple):
    """The prior of a step beside its voltage, which has not been used yet."""

    prior: Belief  #: before the voltage
    event: AnchorEvent  #: used in place of the voltage, if there is one
    rest_s: Scalar  #: time for which the current has looked like rest
    error: VoltageError  #: of the voltage, or of the event
    R: Scalar  #: measurement noise variance of the update [V^2]
    correction: Correction  #: by the voltage, or by the SoC of the event
    level: VoltageLevel  #: before the voltage
    measured: Any  #: the condition that there is a voltage, and no event in its place
    judgement: LevelJudgement  #: of the voltage beside its level


class TheveninUpdate(NamedTuple):
    """The belief after a voltage, or the prior where it was not used."""

    belief: Belief
    correction: Correction  #: by the voltage, whether it was used or not, or by the SoC of an anchor event
    #: expected before it, and the standard deviation of the innovation as a single sample, nan at an anchor event
    voltage_V: Scalar
    voltage_std_V: Scalar
    noise: adaptive.NoiseEstimate  #: moments for covariance matching
    accepted: Any  #: the condition that the voltage was used
    contradicts: Any  #: the condition that the voltage contradicts the belief
    R: Scalar  #: measurement noise variance of the update [V^2]
    error: VoltageError  #: of the voltage, or of the anchor event used in its place
    evidence: CapacityEvidence  #: about the capacity, after it
    level: VoltageLevel  #: after it


class TheveninStep(NamedTuple):
    """One step: the state after it, the estimate, and the update by its voltage."""

    state: FilterState
    estimate: SocEstimate
    update: TheveninUpdate


def forget_soc(belief: Belief) -> Belief:
    """The belief with the standard deviation of an unknown SoC; the mean stays."""
    return inflate(belief, SOC, SOC_UNKNOWN_STD**2 - belief.cov[SOC, SOC])


@dataclass(frozen=True)
class TheveninFilter:
    """Settings; `init` and `step` are pure functions of them."""

    model: Thevenin  #: the circuit
    noise: BatteryNoise = field(default_factory=BatteryNoise)  #: noise of voltage and model
    sensor: CurrentSensor = field(default_factory=CurrentSensor)  #: current sensor
    method: str = "ekf"  #: "ekf" or "ukf" (redrawn sigma points)
    matching: bool = False  #: learn R from the residuals (AEKF, AUKF), `noise` being the floor
    window: float = 100.0  #: effective number of samples for that; [T] uses 100
    #: true current of a rest (0 in a laboratory, minus the idle draw on a robot); None when unknown, then a rest says
    #: nothing about the current sensor
    idle_current_A: float | None = None
    rest_hold_s: float = 30.0  #: time for which the current must look like rest first
    gap_s: float = CURRENT_GAP_S  #: a longer step between two samples says nothing about the current in between
    #: largest NIS of a voltage that is used, and largest square of a persistent error, relative to its variance
    gate: float = 25.0
    reset_after_s: float = 60.0  #: time of contradiction after which the filter has diverged: SoC is declared unknown
    anchors: bool = False  #: let full charges and cut-offs correct SoC, not only the steep end of a flat curve

    def __post_init__(self) -> None:
        require_one_of("method", self.method, METHODS)
        require_positive("gap_s", self.gap_s)
        require_gate(self.gate, self.reset_after_s)
        require_between("window", self.window, 1.0, math.inf)
        require_between("rest_hold_s", self.rest_hold_s, 0.0, math.inf)
        if self.idle_current_A is not None:
            require_finite("idle_current_A", self.idle_current_A)

    @cached_property
    def system(self) -> AugmentedThevenin:
        """Model of the battery with the errors of sensors and model as states."""
        return AugmentedThevenin(self.model, self.noise, self.sensor)

    @property
    def member(self) -> TheveninFilter:
        """The filter of every hypothesis, as of a Gaussian sum of one."""
        return self

    def merged(self, state: FilterState) -> FilterState:
        """State of one filter with the mean and the covariance of all hypotheses."""
        return state

    @cached_property
    def anchor_rule(self) -> AnchorRule:
        """Rule for the events that anchor SoC."""
        return AnchorRule(self.model, self.noise, self.sensor)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the belief's mean, in order."""
        return self.system.state_names

    @property
    def limits(self) -> SampleLimits:
        """Plausibility limits of a sample."""
        return sample_limits(self.model, self.gap_s)

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> FilterState:
        """State before the first sample, whose voltage is used: it overrules a SoC that it contradicts.

        soc: initial state of charge, None when unknown.  soc_std: standard deviation of that value.
        """
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return VoltageStart(self.model, self.noise, self.sensor, self.limits.current_A)

    def start_from(self, first: SocSample, part: Hypothesis) -> FilterState:
        """State before the first sample, with the correlation of SoC and the model's voltage error; traceable.

        That error e, of unit variance, is the sum of the model error, the level error and that of the voltage sensor's
        gain, as far as there are such states, each times its share. The voltage says nothing about other sums of them.
        """
        start = part.start
        state = self.start(first, start.soc, start.std)
        belief = unpack(state.belief)
        mean, cov = belief.mean.copy(), belief.cov.copy()
        shares = self.system.error_shares(start.soc, first_input(first, self.limits.current_A))
        errors = {self.state_names.index(name): share for name, share in shares.items()}
        news = start.model_error_std**2 - 1.0
        for j, a in errors.items():
            mean[j], cov[j, SOC], cov[SOC, j] = a * start.model_error, a * start.covariance, a * start.covariance
            for k, b in errors.items():
                cov[j, k] = cov[j, k] + a * b * news
        held = state.held._replace(voltage_V=where(self.limits.is_voltage(first.voltage_V), first.voltage_V, -1.0))
        return state._replace(belief=pack(Belief(mean, cov)), held=held)

    def start(self, first: SocSample, soc: Scalar, soc_std: Scalar) -> FilterState:
        """State before the first sample at the given SoC, unchecked by its voltage; traceable, for microcontrollers."""
        u = first_input(first, self.limits.current_A)
        belief = pack(self.system.start(soc, soc_std, u))
        moments = adaptive.NoiseEstimate(np.zeros((1, 1)), np.zeros((1, 1)), 0.0)
        held = HeldVoltage(load_A=minimum(u.current_A, 0.0), current_A=u.current_A)
        return FilterState(
            belief, moments, u.current_A, u.temperature_degC, 0.0, 0.0, 0.0, AnchorMemory(), u.unknown_K, held
        )

    def step(self, state: FilterState, sample: SocSample) -> tuple[FilterState, SocEstimate]:
        """State and estimate after a sample."""
        taken = self.take_in(state, sample)
        diverged = self.has_diverged(state) | taken.misled
        foresight = self.foresee(state, taken, diverged)
        done = self.advance(state, taken, diverged, foresight, foresight.judgement)
        return done.state, with_misfit(done.estimate, self.sensor)

    def with_new_curve_errors(self, belief: Belief) -> Belief:
        """The belief with the errors of the curve as at a start: a contradicting voltage has driven them away."""
        stds = {"hysteresis_log_ratio": self.noise.hysteresis_std}
        for name in ("model_error", "axis_error", "level_error", "voltage_gain_error", *stds):
            if name in self.state_names:
                belief = restarted_at(belief, self.state_names.index(name), 0.0, stds.get(name, 1.0) ** 2)
        return belief

    def has_diverged(self, state: FilterState) -> Any:
        """True where the voltage has contradicted the belief for too long, and is not held to be false."""
        return (state.rejected_s > self.reset_after_s) & logical_not(state.level.is_away)

    def foresee(
        self,
        state: FilterState,
        taken: CleanInput,
        diverged: Any,
        forget_soc: Callable[[Belief], Belief] = forget_soc,
    ) -> Foresight:
        """The prior beside the voltage; where the filter has diverged, SoC is declared unknown by `forget_soc`."""
        clean, prior = taken.sample, self.predict(state, taken.sample)
        rest_s = self.rest_s(state, prior, clean)
        prior = self.zero_current_update(prior, clean, self.is_resting(rest_s))
        prior = choose(diverged, self.with_new_curve_errors(forget_soc(prior)), prior)
        other = diverged | taken.event.gives_soc | (clean.dt_s > JUMP_S)  # the belief moves, not the voltage
        level = choose(other, VoltageLevel(used_V=state.level.used_V), state.level)
        return self.compare(state._replace(level=level), prior, clean, taken.event)._replace(rest_s=rest_s)

    def advance(
        self, state: FilterState, taken: CleanInput, diverged: Any, foresight: Foresight, judgement: LevelJudgement
    ) -> TheveninStep:
        """The step on a clean sample; judgement: of its voltage, by the most likely hypothesis."""
        clean, rest_s = taken.sample, foresight.rest_s
        resting = self.is_resting(rest_s)
        update = self.correct(state, foresight, clean, judgement)
        posterior, limited = self.within_limits(update.belief)

        contradicts_still = update.contradicts & logical_not(diverged)  # a reset restarts the timer
        stands_for_s = stands_for(clean)
        rejected_s = time_rejected(state.rejected_s, stands_for_s, contradicts_still, clean.voltage_measured)
        after = FilterState(
            pack(posterior),
            update.noise,
            clean.latest_A,
            clean.now.temperature_degC,
            rest_s,
            where(judgement.returns, self.reset_after_s + 1.0, rejected_s),
            clean.unknown_s,
            taken.anchors,
            clean.now.unknown_K,
            taken.held,
            update.evidence,
            update.level,
        )
        flags = clean.flags + flags_of(
            {
                SocFlag.VOLTAGE_REJECTED: clean.voltage_measured & logical_not(update.accepted),
                SocFlag.REST: resting,
                SocFlag.SOC_LIMITED: limited,
                SocFlag.DIVERGED: clean.voltage_measured & diverged,
                SocFlag.ANCHORED: taken.event.gives_soc,
            }
        )
        return TheveninStep(after, self.estimate(posterior, update, clean, flags), update)

    def take_in(self, state: FilterState, sample: SocSample) -> CleanInput:
        """The sanitised sample, and the event that it completes; voltages while gassing still count for events."""
        waiting, paired = beside_current(state.held, self.sanitize(state, sample), state.unknown_s)
        held, misled, clean = without_frozen(waiting, paired, self.model, self.noise)
        find = self.anchor_rule.step if self.anchors else self.anchor_rule.reach_end
        anchors, event = find(state.anchors, clean)
        return CleanInput(self.without_gassing(clean, anchors), event, anchors, held, misled)

    def sanitize(self, state: FilterState, sample: SocSample) -> CleanSocSample:
        """The sample with impossible values replaced and flagged."""
        before = CircuitInput(state.current_A, state.temperature_degC, state.unknown_K)
        return sanitize(sample, before, self.limits, state.unknown_s, state.held.age_s)

    def without_gassing(self, clean: CleanSocSample, anchors: AnchorMemory) -> CleanSocSample:
        """The sample of a gassing battery without the parts that say nothing about its charge.

        These are its voltage while it gases, and any further charge after a full charge.
        """
        if self.model.gassing_V is None:
            return clean
        overcharged = (anchors.discharged <= 0.0) & (clean.mean.current_A > 0.0)
        return clean._replace(
            mean=clean.mean._replace(current_A=where(overcharged, 0.0, clean.mean.current_A)),
            voltage_measured=clean.voltage_measured & (clean.voltage_V < self.model.gassing_V),
        )

    def predict(self, state: FilterState, clean: CleanSocSample) -> Belief:
        """The belief after the step, before its voltage."""
        before = unpack(state.belief)
        Q = self.system.process_noise(before.mean, clean)
        return METHODS[self.method].predict(before, lambda x: self.system.next_state(x, clean), Q)

    def compare(
        self, state: FilterState, prior: Belief, clean: CleanSocSample, event: AnchorEvent = NO_EVENT
    ) -> Foresight:
        """The voltage of the step beside the one that the prior expects, or the SoC of an anchor event.

        R counts an error of the model for minutes, so it is never far below H P H': the plain difference P - K S K'
        keeps its digits.
        """
        system, anchored = self.system, event.gives_soc
        error = self.voltage_error(prior, clean)
        error = choose(anchored, error._replace(variance=event.std * event.std, weight=1.0), error)
        R = np.array([[error.variance * error.weight]])
        R = R + where(anchored, 0.0, state.noise.residual[0, 0]) if self.matching else R
        y = np.array([where(anchored, event.soc, clean.voltage_V)])

        def measured(x: np.ndarray) -> np.ndarray:
            return np.array([where(anchored, x[SOC], system.voltage(x, clean, error)[0])])

        correction = METHODS[self.method].correct(prior, y, measured, R)
        has_voltage = clean.voltage_measured & logical_not(anchored)
        nu, sample_V2 = correction.innovation.value[0], correction.innovation.cov[0, 0] - (R[0, 0] - error.variance)
        change_A = maximum(abs(clean.change_A), abs(clean.now.current_A - state.held.current_A))
        leaves, returns = state.level.judge(nu, sample_V2, error.total_ohm * change_A, self.level_limits)
        leaves = leaves | (state.held.voltage_V < 0.0)  # the first one may be false
        judgement = LevelJudgement(has_voltage & leaves, has_voltage & returns)
        return Foresight(prior, event, 0.0, error, R[0, 0], correction, state.level, has_voltage, judgement)

    @cached_property
    def level_limits(self) -> LevelLimits:
        """Limits for the steps of the innovation."""
        return LevelLimits.of(self.model, self.noise)

    def correct(
        self, state: FilterState, foresight: Foresight, clean: CleanSocSample, judgement: LevelJudgement
    ) -> TheveninUpdate:
        """The belief after the voltage of the step; at a full charge or a cut-off, SoC is measured in its place.

        judgement: of the voltage, by the most likely hypothesis.

        Charger and protection define full and empty, so these events pass without a gate.
        """
        prior, event, _, error, R, correction, *_ = foresight
        system, anchored = self.system, event.gives_soc
        y = np.array([where(anchored, event.soc, clean.voltage_V)])
        (nu,), repeated = correction.innovation.value, R - error.variance
        used_now = foresight.measured & passes(correction.innovation, self.gate) & logical_not(judgement.leaves)
        noise = self.learn(state, correction, y - system.voltage(correction.belief.mean, clean, error))
        updated = apply_gain(prior, correction.innovation, where(used_now | anchored, correction.gain, 0.0))
        belief, evidence = count_once(self.evidence_before(state, prior, clean), prior, updated, system.gain_index)
        return TheveninUpdate(
            belief=belief,
            correction=correction,
            voltage_V=where(anchored, system.voltage(prior.mean, clean, error)[0], clean.voltage_V - nu),
            voltage_std_V=where(anchored, math.nan, np.sqrt(correction.innovation.cov[0, 0] - repeated)),
            noise=choose(used_now, noise, state.noise),
            accepted=used_now | anchored,
            contradicts=self.contradicts(correction.innovation, repeated) & logical_not(anchored),
            R=R,
            error=choose(anchored, VoltageError(0.0, error.variance, error.weight), error),
            evidence=evidence,
            level=foresight.level.after(
                nu,
                nu * R / correction.innovation.cov[0, 0],
                stands_for(clean),
                foresight.measured,
                judgement,
                self.level_limits,
            ),
        )

    def evidence_before(self, state: FilterState, prior: Belief, clean: CleanSocSample) -> CapacityEvidence:
        """Evidence about the capacity after the prediction of the step."""
        k = self.system.gain_index
        moved = self.system.moved(clean.mean.current_A, clean)
        return state.evidence.after_step(moved, unpack(state.belief).cov[k, k], prior.cov[k, k])

    def voltage_error(self, prior: Belief, clean: CleanSocSample) -> VoltageError:
        """Errors of the voltage; sigma points already contain what a tangent leaves out of the mean."""
        error = self.system.voltage_error(prior, clean)
        return error._replace(tangent_V=0.0) if self.method == "ukf" else error

    def contradicts(self, innovation: Innovation, repeated: Scalar) -> Any:
        """True where the voltage contradicts the belief by more than a persistent error can explain.

        The gate on NIS finds single outliers. R is large because an error may persist; one that persists and exceeds
        what its own variance allows is a contradiction although every single sample passes that gate.

        repeated: part of R that is there only because samples are not independent.
        """
        nu, S = innovation.value[0], innovation.cov[0, 0]
        return nu * nu > self.gate * (S - repeated)

    def rest_s(self, state: FilterState, prior: Belief, clean: CleanSocSample) -> Scalar:
        """Time [s] for which the current has looked like rest.

        It looks like rest if the current is the declared one to within three sigma of its noise plus two of the offset.
        A wider gate would mistake another steady current for the declared one, and learn the difference as an offset.
        """
        if self.idle_current_A is None:
            return 0.0
        k = self.system.offset_index
        excess_A = clean.now.current_A - self.idle_current_A - prior.mean[k]
        tolerance_A = 2.0 * np.sqrt(maximum(prior.cov[k, k], 0.0)) + 3.0 * self.sensor.noise_std_A
        looks_like_rest = (abs(excess_A) < tolerance_A) & clean.current_known
        return where(looks_like_rest, state.rest_s + clean.dt_s, 0.0)

    def is_resting(self, rest_s: Scalar) -> Any:
        """True where the current has looked like rest for long enough to count as the declared one."""
        return rest_s > self.rest_hold_s

    def zero_current_update(self, belief: Belief, clean: CleanSocSample, resting: Any) -> Belief:
        """The belief after the current of a rest: its difference from the declared one is the sensor's offset."""
        if self.idle_current_A is None:
            return belief
        offset_A = clean.now.current_A - self.idle_current_A
        return correct_state(belief, self.system.offset_index, offset_A, self.sensor.noise_std_A**2, resting)

    def within_limits(self, belief: Belief) -> tuple[Belief, Scalar]:
        """The belief with SoC and hysteresis in their ranges, and the condition that SoC was out of range.

        SoC is projected into [0, 1] along its covariance, hysteresis clipped into [-1, 1]; their standard deviations
        stay at most those of an unknown state. The capacity stays as it is: a projection at every sample of an empty
        battery is no new evidence about it.
        """
        mean, P = belief
        hysteresis = self.system.hysteresis_index
        soc = clip(mean[SOC], 0.0, 1.0)
        projected = mean - P[:, SOC] * ((mean[SOC] - soc) / maximum(P[SOC, SOC], 1e-12))
        projected[SOC] = soc
        projected[self.system.gain_index] = mean[self.system.gain_index]
        projected[hysteresis] = clip(projected[hysteresis], -1.0, 1.0)
        scale: list[Any] = [1.0] * len(mean)
        scale[SOC] = _at_most(SOC_UNKNOWN_STD, P[SOC, SOC])
        scale[hysteresis] = _at_most(1.0, P[hysteresis, hysteresis])
        return Belief(projected, mirror_lower(P * np.outer(scale, scale))), abs(mean[SOC] - soc) > 0.0

    def learn(self, state: FilterState, correction: Correction, residual: np.ndarray) -> adaptive.NoiseEstimate:
        """Moments that R is matched to, after this voltage."""
        if not self.matching:
            return state.noise
        return adaptive.remember(state.noise, correction.innovation.value, residual, self.window)

    def estimate(self, posterior: Belief, update: TheveninUpdate, clean: CleanSocSample, flags: Scalar) -> SocEstimate:
        """Estimate after the sample."""
        used = clean.voltage_measured & (update.voltage_std_V > 0.0)  # nan at an anchor event
        return SocEstimate(
            **self.system.known(posterior),
            voltage_V=update.voltage_V,
            voltage_std_V=update.voltage_std_V,
            innovation_V=where(used, clean.voltage_V - update.voltage_V, math.nan),
            flags=flags,
        )


def _at_most(std: float, variance: Scalar) -> Scalar:
    """Factor that brings a standard deviation down to `std`; 1 where it is below."""
    return std / np.sqrt(maximum(variance, std**2))


def implausible_capacity(soh_capacity: Scalar) -> Any:
    """True where this capacity, relative to the file's, is not plausible."""
    return (soh_capacity < LEAST_CAPACITY) | (soh_capacity > MOST_CAPACITY)


def with_misfit(estimate: SocEstimate, sensor: CurrentSensor) -> SocEstimate:
    """The estimate, flagged where sensor and battery cannot have its offset or capacity."""
    misfit = sensor.contradicts(estimate.current_offset_A) | implausible_capacity(estimate.soh_capacity)
    return estimate._replace(flags=estimate.flags + flags_of({SocFlag.MISFIT: misfit}))
