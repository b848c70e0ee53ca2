"""Sudden changes of the capacity that ageing cannot explain, classified by what changed with them.

A battery loses capacity within months. Where it seems to fall (or to grow) between two logs, the cause is one of

    a wrong counter     the current reads high or low by a factor g: capacity g times, resistance 1/g times as large
    cold                the logs after it were colder, and the resistance of the file may not grow enough
    broken-off charges  no log after it shows the battery full
    the battery         damage, a bad contact, or another battery
    an exchange         the capacity grew while the resistance fell, by more than a counter explains

or is unknown. The step has a normal distribution of its own on top of the trend; its evidence decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.health.ageing import AgeingFit, HealthPoint, Track, observed_covariance

#: Prior standard deviation of a step of ln(capacity): wrong gains and broken cells reach 10 to 30 %.
STEP_STD = 0.15
#: Smaller steps cannot be distinguished from reversible changes.
LEAST_LASTING_STEP = 0.04
#: One log in a thousand is followed by a step; the evidence has to outweigh that.
_LOG_ODDS = math.log(1000.0)
#: Standard deviations within which two numbers agree.
_AGREE = 2.0
#: A log this much colder than those before [K] is cold.
_COLDER_K = 8.0
#: Standard deviations from the trend at which a single log is worth a remark.
OUTLYING_LOG = 3.0

Cause = Literal["counter", "cold", "not full", "battery", "exchange", "unknown"]


class SuddenChange(NamedTuple):
    """A sudden change of the capacity."""

    #: names of the logs between which it lies
    before: str
    after: str
    days: float  #: of the first log after it
    #: change of the logarithm of each
    capacity: Normal
    resistance: Normal
    cause: Cause  #: most likely


class Outlier(NamedTuple):
    """A single log whose capacity is off the trend, by how many standard deviations, and the likely cause."""

    log: str
    deviation: float
    cause: Cause


def find_change(fit: AgeingFit, points: Sequence[HealthPoint]) -> SuddenChange | None:
    """The most evident step of the capacity; None where there is none.

    points: those that say something about the capacity, one for each sample of the track.
    """
    found = _most_evident(fit)
    if found is None:
        return None
    at, capacity = found
    days = float(fit.track.days[at])
    before, after = _mean_resistance(points[max(at - 5, 0) : at]), _mean_resistance(points[at : at + 5])
    resistance = Normal(after.mean - before.mean, math.hypot(before.std, after.std))
    cause = _cause(capacity, resistance, points, at)
    return SuddenChange(points[at - 1].log, points[at].log, days, capacity, resistance, cause)


def without_change(track: Track, step: SuddenChange) -> Track:
    """Remove a step from the track: from the logs before it if the battery itself changed, else from those after."""
    after = track.days >= step.days
    of_battery = step.cause in ("battery", "exchange", "unknown")
    shift = np.where(after, 0.0, step.capacity.mean) if of_battery else np.where(after, -step.capacity.mean, 0)
    return track._replace(value=track.value + shift, std=np.hypot(track.std, np.where(shift, step.capacity.std, 0.0)))


def outliers(fit: AgeingFit, points: Sequence[HealthPoint]) -> list[Outlier]:
    """Single logs that the trend does not explain."""
    far = np.flatnonzero(np.abs(fit.residual) > OUTLYING_LOG).tolist()
    return [Outlier(points[k].log, float(fit.residual[k]), _cause_of_one(points, k)) for k in far]


def _most_evident(fit: AgeingFit) -> tuple[int, Normal] | None:
    """Index of the first log after the step and its size.

    With K the covariance, h = 1 after the step, P = h' K^-1 h + 1/s^2: evidence (h' K^-1 r)^2 / (2 P) - ln(s^2 P) / 2.
    """
    track, best = fit.track, int(np.argmax(fit.weight))
    n = len(track.days)
    if n < 4:
        return None
    after = np.tril(np.ones((n, n)))[:, 1:]  # column k: 1 from log k + 1 on
    inverse = np.linalg.inv(observed_covariance(fit.uncertainty, track))
    r = track.value + fit.laws.chosen(np.array([best])).loss(track.days, track.cycles)[0]
    pull, precision = after.T @ inverse @ r, np.einsum("nk,nm,mk->k", after, inverse, after)
    total = precision + STEP_STD**-2
    evidence = 0.5 * pull**2 / total - 0.5 * np.log(STEP_STD**2 * total)
    k = int(np.argmax(evidence))
    size = Normal(float(pull[k] / total[k]), float(total[k] ** -0.5))
    if evidence[k] < _LOG_ODDS + math.log(n) or abs(size.mean) < LEAST_LASTING_STEP:
        return None
    return k + 1, size


def _mean_resistance(points: Sequence[HealthPoint]) -> Normal:
    known = [point.log_resistance for point in points if point.shows_resistance]
    if not known:
        return Normal(0.0, math.inf)
    precision = sum(r.std**-2 for r in known)
    return Normal(sum(r.mean * r.std**-2 for r in known) / precision, precision**-0.5)


def _cause(capacity: Normal, resistance: Normal, points: Sequence[HealthPoint], at: int) -> Cause:
    before, after = points[:at], points[at:]
    if _colder(before, after):
        return "cold"
    std = math.hypot(capacity.std, resistance.std)
    if abs(resistance.mean) > _AGREE * resistance.std and abs(capacity.mean + resistance.mean) < _AGREE * std:
        return "counter"
    if any(p.full for p in before) and not any(p.full for p in after):
        return "not full"
    if capacity.mean * resistance.mean > 0.0 or abs(resistance.mean) <= _AGREE * resistance.std:
        return "unknown"
    return "battery" if capacity.mean < 0.0 else "exchange"


def _cause_of_one(points: Sequence[HealthPoint], at: int) -> Cause:
    others = [*points[:at], *points[at + 1 :]]
    if _colder(others, points[at : at + 1]):
        return "cold"
    return "unknown" if points[at].full else "not full"


def _colder(before: Sequence[HealthPoint], after: Sequence[HealthPoint]) -> bool:
    """True where the logs after were colder by more than `_COLDER_K`."""
    degC = [np.array([p.temperature_degC for p in part]) for part in (before, after)]
    if any(np.isnan(part).all() for part in degC):
        return False
    return float(np.nanmedian(degC[0]) - np.nanmedian(degC[1])) > _COLDER_K
