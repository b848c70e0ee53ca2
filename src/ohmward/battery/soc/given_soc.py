"""State of charge from another source than a sample, such as a charger that reports a full battery.

    SoC ~ N(s, std^2)    where the belief is less certain, with all correlated states;    unchanged elsewhere

That is the Kalman update by s with the information that the belief lacks, 1 / R = 1 / std^2 - 1 / P: a repetition
changes nothing, since it has the same error as the first time. A belief that s contradicts beyond the gate forgets its
SoC first: charger and user know better.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmward.battery.models.noise import SOC_UNKNOWN_STD, USUAL_C
from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.anchor_rule import SocNormal
from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.capacity_evidence import count_once
from ohmward.battery.soc.clean_sample import first_input, sanitize
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter, carries_errors, mixed, relative
from ohmward.battery.soc.initial_soc import axis_error_V
from ohmward.battery.soc.sample import SocEstimate, SocFlag, SocSample
from ohmward.battery.soc.start_density import Hypothesis
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter, TheveninUpdate, forget_soc
from ohmward.battery.soc.voltage_faults import HeldVoltage, LevelJudgement, VoltageLevel
from ohmward.errors import InputError
from ohmward.filters.belief import Belief, pack, unpack
from ohmward.filters.gate import inflate
from ohmward.filters.kalman import correct_state
from ohmward.quantities import SECONDS_PER_HOUR

#: After a longer gap the battery may be full or empty [s]: by then a usual current makes SoC as uncertain as it can be.
NOTHING_KNOWN_AFTER_S = SECONDS_PER_HOUR * SOC_UNKNOWN_STD / USUAL_C

#: Prior probability that the charge differs from that before such a gap: a logger or a computer that was off says
#: nothing about a charger.
WRONG_AFTER_GAP = 0.5

#: Standby draw of electronics that are off, as a share of the capacity per hour: ten times a good protection board's.
STANDBY_PER_HOUR = 0.01

#: A voltage contradicts the charge before an absence if it moves it by this many of its standard deviations, or
#: differs by as many of its own from the voltage expected.
CONTRADICTS_STD = 3.0

#: Least weight of the hypotheses that expect it.
LEAST_AGREEING = 0.05


def full_charge(settings: TheveninFilter | GaussianSumFilter) -> SocNormal:
    """State of charge when a charger reports full, with a standard deviation by chemistry."""
    return SocNormal(1.0, settings.member.anchor_rule.limits.full_std)


def after_absence(settings: Any, state: Any, away_s: float, moved_std: float) -> Any:
    """State after `away_s` [s] without samples or current, in which SoC moved with standard deviation `moved_std`.

    The errors of the curve stay with SoC as they were: the first voltage afterwards has the error of the last one. It
    is no jump, and the filter uses none before a second one is like it.
    """

    def rested(member: FilterState) -> FilterState:
        belief = settings.system.at_rest(unpack(member.belief), away_s, float(member.temperature_degC))
        return member._replace(
            belief=pack(inflate(belief, SOC, moved_std**2)),
            current_A=0.0,
            rest_s=0.0,
            held=HeldVoltage(),
            level=VoltageLevel(),
        )

    return state.with_members([rested(member) for member in state.members], state.log_weights)


def after_first_voltage(settings: Any, state: Any, sample: SocSample, before: SocNormal) -> Any:
    """State after the first voltage that follows an absence, one more update; `sample` has the time away as its step.

    Call it when a second voltage is like the first: the first one may not be the battery's.

    Where it contradicts the charge `before` it, or the voltage before it, which had the same error of the curve,
    somebody has charged, used or changed the battery: the voltage alone counts.
    """
    filter_ = settings.member
    (whole,) = filter_.voltage_start.hypotheses(sample, *before)
    u = first_input(sample, filter_.limits.current_A)
    clean = sanitize(sample, u, filter_.limits._replace(gap_s=sample.dt_s))
    weights = np.exp(relative(state.log_weights))
    foresights = [filter_.compare(member, unpack(member.belief), clean) for member in state.members]
    updates = [
        filter_.correct(member, foresight, clean, LevelJudgement(np.False_, np.False_))
        for member, foresight in zip(state.members, foresights, strict=True)
    ]
    like = np.array([_is_like_before(update, u, filter_) for update in updates], dtype=float)
    agree = float(weights @ like)
    if abs(whole.start.soc - before.soc) > CONTRADICTS_STD * before.std or agree < LEAST_AGREEING * weights.sum():
        return _restarted(settings, state, sample, settings.voltage_start.hypotheses(sample))
    seen = [
        member._replace(belief=pack(update.belief), evidence=update.evidence)
        for member, update in zip(state.members, updates, strict=True)
    ]
    return state.with_members(seen, state.log_weights)


def _is_like_before(update: TheveninUpdate, u: CircuitInput, filter_: TheveninFilter) -> bool:
    """True where the voltage is that of the charge before: the axis of a label's curve errs as it did then."""
    nu, S, system = update.correction.innovation.value[0], update.correction.innovation.cov[0, 0], filter_.system
    axis_V = 0.0 if system.axis_is_shift else axis_error_V(update.belief.mean[SOC], u, system.model, system.noise)
    same_V2 = update.error.weight * min(axis_V**2, update.error.uncertain_V2)
    return bool(nu * nu < CONTRADICTS_STD**2 * (S - same_V2))


def longest_known_gap_s(settings: Any) -> float:
    """Longest step [s] after which the charge is still known without `after_gap`; inf where that cannot help."""
    return max(settings.member.gap_s, NOTHING_KNOWN_AFTER_S) if carries_errors(settings) else math.inf


def after_gap(settings: TheveninFilter | GaussianSumFilter, state: Any, first: SocSample, gap_s: float) -> Any:
    """State before the first sample after a gap of `gap_s` [s] with unknown current.

    Either the robot was off, and the charge is the previous one to within what its electronics drew, or it can be any.
    So a gap is a start with a given value that is as likely wrong as right, and its first voltage is used in the same
    way. The estimates of capacity and resistances belong to the battery and are kept.
    """
    before = unpack(settings.merged(state).belief)
    soc, variance = min(max(float(before.mean[SOC]), 0.0), 1.0), float(before.cov[SOC, SOC])
    drawn = STANDBY_PER_HOUR * gap_s / SECONDS_PER_HOUR
    known = settings.voltage_start.hypotheses(first, soc, math.sqrt(variance + drawn * drawn), WRONG_AFTER_GAP)
    return _restarted(settings, state, first, known)


def _restarted(
    settings: TheveninFilter | GaussianSumFilter, state: Any, first: SocSample, known: tuple[Hypothesis, ...]
) -> Any:
    """State that starts from the hypotheses of a first sample with what was learnt of capacity and resistances."""
    whole = settings.merged(state)
    before = unpack(whole.belief)
    learnt = [settings.state_names.index(name) for name in ("charge_gain", "ohmic_log_ratio", "pair_log_ratio")]

    def with_learnt(member: FilterState) -> FilterState:
        belief = unpack(member.belief)
        mean, cov = belief.mean.copy(), belief.cov.copy()
        mean[learnt] = before.mean[learnt]
        cov[learnt, :] = cov[:, learnt] = 0.0
        cov[np.ix_(learnt, learnt)] = before.cov[np.ix_(learnt, learnt)]
        return member._replace(belief=pack(Belief(mean, cov)), evidence=whole.evidence)

    began = settings.start_from(first, *known)
    return began.with_members([with_learnt(member) for member in began.members], began.log_weights)


def correct_soc(settings: Any, state: Any, estimate: SocEstimate, given: SocNormal) -> tuple[Any, SocEstimate]:
    """State and estimate after a state of charge was given; estimate: the last one.

    Raises:
        InputError: the estimator takes no state of charge from outside.
    """
    if not carries_errors(settings):
        raise InputError(
            f"{type(settings).__name__} takes no state of charge from outside; choose the filter gsf, ekf, ukf or rc"
        )
    # the hypotheses are weighted by how well each predicted it
    foreseen = [_log_density(unpack(member.belief), given) for member in state.members]
    log_weights = relative(np.asarray(state.log_weights, dtype=float) + foreseen)
    parts = [_corrected(settings.member, member, estimate, given) for member in state.members]
    members, estimates = zip(*parts, strict=True)
    return state.with_members(members, log_weights), mixed(estimates, log_weights)


def _corrected(
    settings: TheveninFilter, state: FilterState, estimate: SocEstimate, given: SocNormal
) -> tuple[FilterState, SocEstimate]:
    """State and estimate of one filter."""
    before = unpack(state.belief)
    corrected = with_given_soc(before, given, settings.gate)
    belief, evidence = count_once(state.evidence, before, corrected, settings.system.gain_index)
    belief, _ = settings.within_limits(belief)
    known = {name: float(value) for name, value in settings.system.known(belief).items()}
    anchors = state.anchors._replace(discharged=0.0)
    after = state._replace(
        belief=pack(belief), rejected_s=0.0, anchors=anchors, evidence=evidence, level=VoltageLevel()
    )
    return after, estimate._replace(**known, flags=SocFlag(int(estimate.flags)) | SocFlag.ANCHORED)


def with_given_soc(belief: Belief, given: SocNormal, gate: float = math.inf) -> Belief:
    """The belief after its SoC was given; the first equation."""
    P, R = float(belief.cov[SOC, SOC]), given.std**2
    if (given.soc - belief.mean[SOC]) ** 2 > gate * (P + R):
        belief = forget_soc(belief)
        P = float(belief.cov[SOC, SOC])
    if P <= R:
        return belief
    return correct_state(belief, SOC, given.soc, 1.0 / (1.0 / R - 1.0 / P))


def _log_density(belief: Belief, given: SocNormal) -> float:
    """Ln N(s; mean, P + std^2) up to a constant; a repetition does not change the weights of equal hypotheses."""
    S = float(belief.cov[SOC, SOC]) + given.std**2
    return -0.5 * (float(given.soc - belief.mean[SOC]) ** 2 / S + math.log(S))
