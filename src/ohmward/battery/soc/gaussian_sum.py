"""State of charge by a Gaussian sum filter: a few extended Kalman filters side by side, weighted by their likelihood.

    p(x) = sum of w_k N(x; m_k, P_k)                                                    (Alspach and Sorenson 1972)
    w_k <- w_k^a N(nu_k; 0, S_k),    a = exp(-moved charge / length)            (Raftery, Karny and Ettler 2010, 2.7)

One Gaussian cannot represent "the value given at the start is right, or it is wrong", nor a flat part of the curve from
an unknown start. Each hypothesis begins in another range of the state of charge (`initial_soc.hypotheses`); all see the
same samples, and the voltage decides between them. Mean and standard deviation are those of the sum.

Evidence fades as charge flows, by the forgetting factor a: the errors of the model by which a hypothesis explains a
voltage persist as far as the level of the curve does, and have changed by the next pass. Without it a small error of
the model, met at every pass, would decide within a day between hypotheses that are all uncertain.

A voltage that every hypothesis rejects leaves the weights as they are; one that some accept changes all of them, at
most by as much as the gate. The voltage contradicts the filter where it contradicts every hypothesis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import and_, or_
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from ohmward.battery.models.noise import CurrentSensor
from ohmward.battery.models.thevenin import pair_decays
from ohmward.battery.soc.augmented_thevenin import SOC, AugmentedThevenin, VoltageError
from ohmward.battery.soc.clean_sample import CleanSocSample
from ohmward.battery.soc.initial_soc import VoltageStart
from ohmward.battery.soc.sample import INITIAL_SOC_STD, STD_OF, SocEstimate, SocSample
from ohmward.battery.soc.start_density import WRONG_SHARE, Hypothesis
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter, TheveninUpdate, forget_soc, with_misfit
from ohmward.checks import require_between
from ohmward.filters.belief import Belief, Innovation, pack, unpack
from ohmward.filters.gate import choose, restarted_at
from ohmward.trace import Scalar, clip, exp, log, maximum, minimum, sqrt, where

#: Default number of hypotheses: "the given value is right" and two cells of "it is wrong", or three cells of an unknown
#: start. With two the interval score of wrong starts on measured LFP doubles, with four nothing is gained.
HYPOTHESES = 3

#: Smallest weight of a hypothesis over that of the most likely one, as a logarithm: no weight underflows, a hypothesis
#: that was ruled out can come back, and at the far end of the curve it adds less than 0.3 % to the standard deviation.
LEAST_LOG_WEIGHT = -12.0


class GaussianSumState(NamedTuple):
    """State between two samples: plain numbers."""

    members: tuple[FilterState, ...]  #: state of the filter of each hypothesis
    log_weights: np.ndarray  #: (K,), ln of the weights over that of the most likely hypothesis, at most 0
    walk_A2: np.ndarray  #: (n,), variance of the current [A^2] that would cause the random walk of each RC voltage

    def with_members(self, members: Sequence[FilterState], log_weights: np.ndarray) -> GaussianSumState:
        """The state whose hypotheses have these states and weights."""
        return self._replace(members=tuple(members), log_weights=log_weights)


@dataclass(frozen=True)
class GaussianSumFilter:
    """Settings; `init` and `step` are pure functions of them."""

    member: TheveninFilter  #: the filter of every hypothesis
    count: int = HYPOTHESES  #: number of hypotheses; one is the filter itself

    def __post_init__(self) -> None:
        require_between("count", self.count, 1, math.inf)

    @property
    def system(self) -> AugmentedThevenin:
        """Model of the battery, the same for every hypothesis."""
        return self.member.system

    @property
    def sensor(self) -> CurrentSensor:
        """Current sensor, the same for every hypothesis."""
        return self.member.sensor

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of a member's mean, in order."""
        return self.member.state_names

    def init(self, first: SocSample, soc: float | None = None, soc_std: float = INITIAL_SOC_STD) -> GaussianSumState:
        """State before the first sample, whose voltage is used; arguments as for `TheveninFilter.init`."""
        return self.start_from(first, *self.voltage_start.hypotheses(first, soc, soc_std))

    @property
    def voltage_start(self) -> VoltageStart:
        """Start from the first voltage."""
        return replace(self.member.voltage_start, count=self.count)

    def start_from(self, first: SocSample, *parts: Hypothesis) -> GaussianSumState:
        """State before the first sample, with one member for each hypothesis; traceable."""
        members = tuple(self.member.start_from(first, part) for part in parts)
        return self.begun(members, [log(maximum(part.weight, _TINY)) for part in parts])

    def start(self, first: SocSample, soc: Scalar, soc_std: Scalar) -> GaussianSumState:
        """State before the first sample at the given SoC, unchecked by its voltage; traceable, for microcontrollers.

        The prior probability that it is wrong is that of `init`, in cells of equal width.
        """
        wrong = equal_cells(self.count - 1)
        members = tuple(self.member.start(first, *part) for part in [(soc, soc_std), *wrong])
        weights = [1.0 - WRONG_SHARE, *(WRONG_SHARE / len(wrong) for _ in wrong)]
        return self.begun(members, [math.log(weight) for weight in weights])

    def begun(self, members: tuple[FilterState, ...], log_weights: Sequence[Any]) -> GaussianSumState:
        """State of a sum that begins with these members."""
        return GaussianSumState(members, relative(log_weights), np.zeros(self.member.model.pairs))

    def step(self, state: GaussianSumState, sample: SocSample) -> tuple[GaussianSumState, SocEstimate]:
        """State and estimate after a sample."""
        taken = self.member.take_in(state.members[0], sample)
        diverged = reduce(and_, map(self.member.has_diverged, state.members)) | taken.misled
        foresights = [
            self.member.foresee(member, taken, diverged, forget)
            for member, forget in zip(state.members, self.restarts, strict=True)
        ]
        judgement = most_likely([foresight.judgement for foresight in foresights], state.log_weights)
        steps = [
            self.member.advance(member, taken, diverged, foresight, judgement)
            for member, foresight in zip(state.members, foresights, strict=True)
        ]
        accepted = reduce(or_, (step.update.accepted for step in steps))
        walk_A2 = self.walk_variance(state.walk_A2, taken.sample)
        noise_V2 = reduce(minimum, (member.level.square_V2 for member in state.members))
        unforeseen_V2 = maximum(noise_V2 - self.member.noise.voltage_std_V**2, 0.0)
        evidence = [
            self.evidence(member, step.update, walk_A2, unforeseen_V2, taken.sample)
            for member, step in zip(state.members, steps, strict=True)
        ]
        _, forgetting = self.system.error_decays(taken.sample.mean.current_A, taken.sample)
        log_weights = relative(
            [
                where(diverged, 0.0, forgetting * log_weight) + where(accepted, log_evidence, 0.0)
                for log_weight, log_evidence in zip(state.log_weights, evidence, strict=True)
            ]
        )
        after = GaussianSumState(tuple(step.state for step in steps), log_weights, walk_A2)
        return after, with_misfit(mixed([step.estimate for step in steps], log_weights), self.sensor)

    def walk_variance(self, before_A2: np.ndarray, clean: CleanSocSample) -> np.ndarray:
        """(n,) variance of the current [A^2] that would cause the random walk of each RC voltage, after this step."""
        decays = pair_decays(clean.mean, self.member.model, clean.dt_s)
        now_A2 = self.system.walk_A(clean) ** 2
        return np.array([now_A2 + a * a * (old - now_A2) for a, old in zip(decays, before_A2, strict=True)])

    def evidence(
        self,
        before: FilterState,
        update: TheveninUpdate,
        walk_A2: np.ndarray,
        unforeseen_V2: Scalar,
        clean: CleanSocSample,
    ) -> Scalar:
        """Log likelihood of the hypothesis of this filter; see `log_likelihood`."""
        fades = pair_decays(clean.mean, self.member.model, self.member.noise.correlation_s)
        ohm = self.system.pair_ohm(before.belief.mean, clean)
        renewed_V2 = sum(r * r * v * (1 - a * a) for r, v, a in zip(ohm, walk_A2, fades, strict=True))
        model_decay, level_decay = self.system.error_decays(clean.mean.current_A, clean)
        staying_V2 = update.error.model_std_V**2 * self.variance_after(before, "model_error", model_decay)
        staying_V2 = staying_V2 + update.error.axis_std_V**2 * self.variance_after(before, "axis_error", model_decay)
        staying_V2 = staying_V2 + update.error.level_std_V**2 * self.variance_after(before, "level_error", level_decay)
        staying_V2 = staying_V2 + update.error.gain_std_V**2 * self.variance_after(before, "voltage_gain_error", 1.0)
        widths = Widths(renewed_V2, staying_V2, moved_on=1.0 - model_decay**2, unforeseen_V2=unforeseen_V2)
        return log_likelihood(update.correction.innovation, update.R, update.error, widths, self.member.gate)

    def variance_after(self, before: FilterState, name: str, decay: Scalar) -> Scalar:
        """Variance of the Gauss-Markov state `name` of a member after a step, 1 where it has no such state."""
        if name not in self.state_names:
            return 1.0
        k = self.state_names.index(name)
        return decay**2 * unpack(before.belief).cov[k, k] + 1.0 - decay**2

    @property
    def restarts(self) -> list[Callable[[Belief], Belief]]:
        """Functions that declare SoC unknown in each hypothesis: each gets one of the cells of equal width."""
        if self.count == 1:
            return [forget_soc]
        return [partial(restarted_at, i=SOC, mean=soc, variance=std**2) for soc, std in equal_cells(self.count)]

    def merged(self, state: GaussianSumState) -> FilterState:
        """State of one filter with the mean and the covariance of the sum; the rest is the most likely member's."""
        beliefs = [unpack(member.belief) for member in state.members]
        weights = normalised(state.log_weights)
        mean = sum(w * b.mean for w, b in zip(weights, beliefs, strict=True))
        cov = sum(w * (b.cov + np.outer(b.mean - mean, b.mean - mean)) for w, b in zip(weights, beliefs, strict=True))
        return most_likely(state.members, state.log_weights)._replace(belief=pack(Belief(mean, cov)))


def carries_errors(settings: Any) -> TypeGuard[TheveninFilter | GaussianSumFilter]:
    """True for a filter that carries the errors of sensor and model as states.

    So its estimates show whether the battery file fits, it learns on board, and takes a state of charge from outside.
    """
    return isinstance(settings, TheveninFilter | GaussianSumFilter)


def equal_cells(count: int) -> list[tuple[float, float]]:
    """Mean and standard deviation of each of `count` cells of SoC of equal width."""
    return [((k + 0.5) / count, 1.0 / (count * math.sqrt(12.0))) for k in range(count)]


def relative(log_weights: Sequence[Any] | np.ndarray) -> np.ndarray:
    """(K,) log weights relative to the largest of them, none below `LEAST_LOG_WEIGHT`."""
    largest = reduce(maximum, log_weights)
    return np.array([maximum(log_weight - largest, LEAST_LOG_WEIGHT) for log_weight in log_weights])


def normalised(log_weights: Iterable[Any]) -> list[Any]:
    """Weights that sum to one."""
    weights = [exp(log_weight) for log_weight in log_weights]
    total = sum(weights)
    return [weight / total for weight in weights]


def most_likely(members: Sequence[Any], log_weights: Sequence[Any] | np.ndarray) -> Any:
    """The member with the largest weight, the first of several."""
    best, largest = members[0], log_weights[0]
    for member, log_weight in zip(members[1:], log_weights[1:], strict=True):
        best = choose(log_weight > largest, member, best)
        largest = maximum(largest, log_weight)
    return best


def mixed(estimates: Sequence[SocEstimate], log_weights: Sequence[Any] | np.ndarray) -> SocEstimate:
    """Estimate of the sum: means and standard deviations of the states; voltage and flags of the most likely."""
    weights = normalised(log_weights)
    states: dict[str, Scalar] = {}
    for name, name_std in STD_OF.items():
        means = [getattr(estimate, name) for estimate in estimates]
        mean = sum(w * m for w, m in zip(weights, means, strict=True))
        stds = [getattr(estimate, name_std) for estimate in estimates]
        variance = sum(w * (s * s + (m - mean) * (m - mean)) for w, m, s in zip(weights, means, stds, strict=True))
        states |= {name: mean, name_std: sqrt(variance)}
    return most_likely(estimates, log_weights)._replace(**states)


#: Smallest variance of the part of a voltage error that does not stay with SoC [V^2]: no sensor is better.
_LEAST_V2 = 1e-8

#: Mass of a hypothesis that the first voltage rules out.
_TINY = float(np.finfo(float).tiny)


class Widths(NamedTuple):
    """Parts of the variance of a voltage that the likelihood treats separately."""

    renewed_V2: Scalar = 0.0  #: from the state, what the process noise restores after every update [V^2]
    staying_V2: Scalar = 0.0  #: from the errors of the model, which stay while SoC stays [V^2]
    moved_on: Scalar = 1.0  #: share of that error which is new with this sample, in [0, 1]
    unforeseen_V2: Scalar = 0.0  #: of the noise from sample to sample beyond the one that the model expects [V^2]


def log_likelihood(
    innovation: Innovation, R: Scalar, error: VoltageError, widths: Widths, largest_nis: float
) -> Scalar:
    """Log density of a voltage before it was used, up to a constant that is the same for every belief.

    With A = S - R the variance of the voltage from the state, f the part of it that the process noise restores after
    every update, v the variance of one sample and w its weight:

        -(nu^2 / S' + ln(S' / R') + ln(v + f) / w) / 2,    R' = R + w f,    S' = R' + A - f

    The density of one sample to the power of 1/w, averaged over the part of the state that stays: one observation in
    every w samples, as in the update. As a part of the state f would be penalised at every sample, and favour the
    hypothesis with the least resistance. With w = 1 it is ln N(nu; 0, S).

    White noise beyond v is in nu^2 at every sample, not once in w, and would favour the hypothesis with the largest S:
    its variance, as the innovations show it, is subtracted from nu^2.

    The errors that stay while SoC stays, e in S and b in v, make the voltage uncertain where the curve is steep, and
    that is no new information as long as SoC stays. Penalised at every observation they would rule out any hypothesis
    there; they are penalised as SoC moves on, by the share m that is new:

        ln(S' / R') + ln(v + f) / w   becomes
        ln((S' - e) / R') + ln(v - b + f) / w + m (ln(S' / (S' - e)) + ln((v + f) / (v - b + f)))

    Args:
        innovation: nu (1,) and S (1, 1), [V] and [V^2].
        R: of the update [V^2], w v or more.
        error: v, b and w.
        widths: f, e and m; f and e together are limited to A.
        largest_nis: of one sample: an outlier counts no more.
    """
    nu, S, w = innovation.value[0], innovation.cov[0, 0], error.weight
    f = clip(widths.renewed_V2, 0.0, S - R)
    S, R = S + (w - 1.0) * f, R + w * f
    e = clip(widths.staying_V2, 0.0, S - R)
    passing_V2 = maximum(error.variance - error.uncertain_V2 - error.tangent_V2, _LEAST_V2) + f
    passing = log((S - e) / R) + log(passing_V2) / w
    staying = log(S / (S - e)) + log((error.variance + f) / passing_V2)
    return -0.5 * (minimum((nu * nu - widths.unforeseen_V2) / S, largest_nis) + passing + widths.moved_on * staying)
