"""State of charge in one sentence: its band, or its bounds with the reasons and what would settle it.

Rehearsal of a remedy: the band that the filter will show after a rest or a full charge, computed beforehand. The truth
is placed at two points of the belief along SoC, one standard deviation below and above the mean, with every other state
moved along by its correlation. From each of them the model gives the voltage that the remedy would show, and the filter
itself runs on it from its present state. The mean of the two variances is the one to expect.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.thevenin import CircuitInput
from ohmward.battery.soc.augmented_thevenin import SOC
from ohmward.battery.soc.causes import (
    KNOWN_HALF_WIDTH,
    TESTED,
    Cause,
    causes_of,
    conditions,
    points,
    reasons,
    time_in_words,
)
from ohmward.battery.soc.charge_history import ChargeHistory
from ohmward.battery.soc.clean_sample import sanitize
from ohmward.battery.soc.gaussian_sum import GaussianSumFilter
from ohmward.battery.soc.sample import NO_SAMPLE, SocEstimate, SocSample
from ohmward.battery.soc.thevenin_filter import FilterState, TheveninFilter
from ohmward.battery.soc.voltage_faults import HeldVoltage
from ohmward.filters.belief import Belief, unpack
from ohmward.filters.consistency import BAND_95
from ohmward.filters.estimator import MOST_KERNELS
from ohmward.trace import Kernel

#: Time between two samples of a rehearsal [s], that of slow telemetry.
REHEARSAL_STEP_S = 30.0
#: Current of a full charge, in multiples of the capacity per hour: a usual charger of a robot.
CHARGE_C = 0.25
#: Rest after a full charge [s], in which the charger still holds the battery.
AFTER_CHARGE_S = 1800.0
#: Assumed truths, in standard deviations from the mean: the two-point Gauss-Hermite rule, equal weights.
POINTS = (-1.0, 1.0)


def std_along_rest(settings: TheveninFilter, kernel: Kernel, state: FilterState, duration_s: float) -> np.ndarray:
    """(T,) standard deviation of SoC to expect along a rest, every `REHEARSAL_STEP_S`.

    kernel: the filter's step, compiled.
    """
    variance = 0.0
    for point in POINTS:
        x = truth_at(settings, unpack(state.belief), point)
        samples = _steady(state, _measured_A(settings, x, settings.idle_current_A or 0.0), duration_s)
        variance = variance + filtered(settings, kernel, state, x, samples).soc_std ** 2 / len(POINTS)
    return np.sqrt(variance)


def std_after_full_charge(settings: TheveninFilter, kernel: Kernel, state: FilterState) -> float:
    """Standard deviation of SoC to expect some time after a full charge."""
    charge_A, idle_A = CHARGE_C * settings.model.capacity_Ah, settings.idle_current_A or 0.0
    variance = 0.0
    for point in POINTS:
        x = truth_at(settings, unpack(state.belief), point)
        stored_A = charge_A * settings.model.coulombic_efficiency * settings.system.split(x).charge_gain
        missing_s = (1.0 - float(x[SOC])) * settings.model.capacity_As / float(stored_A)
        steady = _steady(state, 0.0, missing_s + AFTER_CHARGE_S)
        true_A = np.where(np.cumsum(steady.dt_s) <= missing_s, charge_A, idle_A)
        samples = steady._replace(current_A=_measured_A(settings, x, true_A))
        variance += float(filtered(settings, kernel, state, x, samples).soc_std[-1]) ** 2 / len(POINTS)
    return float(np.sqrt(variance))


def filtered(
    settings: TheveninFilter, kernel: Kernel, state: FilterState, x: np.ndarray, samples: SocSample
) -> SocEstimate:
    """Estimates (T,) of the filter, continuing from a state while the battery is in the true state x."""
    voltage_V = true_voltage(settings, state, x, samples)
    _, estimates = kernel.scan(state, samples._replace(voltage_V=voltage_V))
    return estimates


def truth_at(settings: TheveninFilter, belief: Belief, point: float) -> np.ndarray:
    """State whose SoC is `point` standard deviations from the mean, the others moved along by their correlation."""
    direction = belief.cov[:, SOC] / np.sqrt(max(belief.cov[SOC, SOC], 1e-12))
    x = belief.mean + point * direction
    hysteresis = settings.system.hysteresis_index
    x[SOC] = min(max(x[SOC], 0.0), 1.0)
    x[hysteresis] = min(max(x[hysteresis], -1.0), 1.0)
    return x


def true_voltage(settings: TheveninFilter, state: FilterState, x: np.ndarray, samples: SocSample) -> np.ndarray:
    """(T,) voltage [V] of the model along the samples, starting in state x."""
    before_A = np.concatenate([[state.current_A], samples.current_A[:-1]])
    before = CircuitInput(before_A, state.temperature_degC, state.unknown_K)
    _, voltage_V = _voltage_kernel(settings).scan(x, (samples, before, state.unknown_s))
    return voltage_V


@lru_cache(maxsize=MOST_KERNELS)
def _voltage_kernel(settings: TheveninFilter) -> Kernel:
    """The step of `true_voltage`, compiled: from the state, and the sample with the input before it."""
    unknown = np.zeros(len(settings.state_names))
    no_variance = np.diag(unknown)

    def step(x: np.ndarray, inputs: tuple[SocSample, CircuitInput, float]) -> tuple[np.ndarray, float]:
        sample, before, unknown_s = inputs
        clean = sanitize(sample, before, settings.limits, unknown_s)
        x = settings.system.next_state(x, clean)
        error = settings.system.voltage_error(Belief(x, no_variance), clean)
        return x, settings.system.voltage(x, clean, error)[0]

    return Kernel(step, unknown, (NO_SAMPLE, CircuitInput(0.0, 0.0), 0.0), lowering="python")


def _measured_A(settings: TheveninFilter, x: np.ndarray, true_A: Any) -> Any:
    """Reading of the sensor at a true current, where the true state is x."""
    return true_A + float(x[settings.system.offset_index])


def _steady(state: FilterState, current_A: float, duration_s: float) -> SocSample:
    """Samples (T,) of a steady current at the present temperature, without a voltage."""
    count = int(np.ceil(duration_s / REHEARSAL_STEP_S))
    temperature_degC = np.full(count, math.nan if state.unknown_K else float(state.temperature_degC))
    return SocSample(
        np.full(count, REHEARSAL_STEP_S), np.full(count, current_A), np.full(count, np.nan), temperature_degC
    )


#: Lengths of a rest that are proposed [min].
REST_MINUTES = (10, 20, 30, 45, 60, 90, 120)
#: Bounds that reach from below 1 - this to above this say nothing.
ANYWHERE = 0.98
#: A longer rest is worth its time if it narrows the band by more than this factor.
_ABOUT = 1.1
#: A remedy is worth its time if it narrows the band to this share.
WORTHWHILE = 0.7


class Remedy(NamedTuple):
    """Something that the user can do now, and the half width of the 95 % band to expect then, in points."""

    text: str
    points: float


class Explanation(NamedTuple):
    """State of charge in words; `str()` is the sentence."""

    soc: float
    #: ends of the 95 % band, in [0, 1]
    low: float
    high: float
    known: bool  #: True where the half width is at most `KNOWN_HALF_WIDTH`
    sentence: str  #: SoC with its band, or its bounds with the reasons and the remedy
    causes: tuple[Cause, ...] = ()  #: of the width, the largest first; () where the filter does not say
    #: rest and full charge, rehearsed; () where SoC is known or the filter cannot be rehearsed
    remedies: tuple[Remedy, ...] = ()

    def __str__(self) -> str:
        return self.sentence

    def as_dict(self) -> dict[str, Any]:
        """The explanation for JSON."""
        causes = [cause._asdict() for cause in self.causes]
        return self._asdict() | {"causes": causes, "remedies": [remedy._asdict() for remedy in self.remedies]}


def explain(settings: Any, kernel: Kernel, state: Any, estimate: SocEstimate, history: ChargeHistory) -> Explanation:
    """The explanation of an estimate.

    settings, kernel, state: of the estimator, its compiled step, its state after the sample of the estimate.
    """
    soc, half = float(estimate.soc), BAND_95 * float(estimate.soc_std)
    if not math.isfinite(soc + half):
        return Explanation(soc, 0.0, 1.0, False, "SoC not known: the estimate is no number")
    low, high, known = max(soc - half, 0.0), min(soc + half, 1.0), half <= KNOWN_HALF_WIDTH
    why: tuple[str, ...] = ()
    causes: tuple[Cause, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    if isinstance(settings, GaussianSumFilter):  # explained as one filter whose belief has the moments of the sum
        settings, state = settings.member, settings.merged(state)
        kernel = _member_kernel(settings, kernel.lowering)
    if isinstance(settings, TheveninFilter):
        now = conditions(settings, state, history)
        causes = causes_of(now, unpack(state.belief))
        why = reasons(now, causes)
        remedies = () if known else rehearsed(settings, kernel, state)
    advice = best_remedy(50 * (high - low), causes, remedies)
    if isinstance(settings, TheveninFilter) and state.held.voltage_V == HeldVoltage().voltage_V:
        limits = settings.limits
        why = ("no voltage was used",)
        advice = f"none like {limits.lowest_ocv_V:.3g} to {limits.highest_ocv_V:.3g} V came: is it measured, and in V?"
    sentence = known_sentence(soc, half) if known else unknown_sentence(low, high, why, advice)
    return Explanation(soc, low, high, known, sentence, causes, remedies)


@lru_cache(maxsize=MOST_KERNELS)
def _member_kernel(settings: TheveninFilter, lowering: str) -> Kernel:
    """The step of one filter of a Gaussian sum, compiled."""
    return Kernel(settings.step, settings.init(NO_SAMPLE), NO_SAMPLE, lowering=lowering)


def known_sentence(soc: float, half: float) -> str:
    """SoC with the half width of its band, "SoC 62 % ± 3 points"."""
    digits = 0 if half >= 0.01 else 1
    return f"SoC {100 * soc:.{digits}f} % ± {100 * half:.2g} points"


def unknown_sentence(low: float, high: float, why: tuple[str, ...], advice: str) -> str:
    """Bounds of SoC, the reasons, and what would settle it."""
    anywhere = low <= 1 - ANYWHERE and high >= ANYWHERE
    bounds = "SoC not known" if anywhere else f"SoC between {100 * low:.0f} and {100 * high:.0f} %"
    sentence = f"{bounds}: {', '.join(why)}" if why else bounds
    return f"{sentence}; {advice}" if advice else sentence


def best_remedy(half_points: float, causes: tuple[Cause, ...], remedies: tuple[Remedy, ...]) -> str:
    """The first remedy that settles SoC, else the one that narrows the band most, "" where none is worth its time."""
    for remedy in remedies:
        if remedy.points <= 100 * KNOWN_HALF_WIDTH:
            return f"{remedy.text} would settle it"
    tests = (Remedy(cause.remedy, cause.points_without) for cause in causes if cause.name in TESTED)
    best = min((*remedies, *tests), key=lambda r: r.points, default=None)
    if best is None or best.points > WORTHWHILE * half_points:
        return ""
    return f"{best.text} would narrow it to ± {best.points:.0f} points"


def rehearsed(settings: TheveninFilter, kernel: Kernel, state: FilterState) -> tuple[Remedy, ...]:
    """A rest of the shortest length that settles SoC, or that is about as good as any longer one, and a full charge."""
    std = std_along_rest(settings, kernel, state, 60.0 * REST_MINUTES[-1])
    rests = [
        Remedy(f"{time_in_words(60.0 * m)} of rest", points(std[int(60 * m / REHEARSAL_STEP_S) - 1] ** 2))
        for m in REST_MINUTES
    ]
    enough = max(100 * KNOWN_HALF_WIDTH, _ABOUT * min(rest.points for rest in rests))
    rest = next(rest for rest in rests if rest.points <= enough)
    return rest, Remedy("a full charge", points(std_after_full_charge(settings, kernel, state) ** 2))
