"""Peaks of power along a way: how often a robot asks its battery for more than a power.

The peak of a stretch, the highest power that holds for some seconds, is its mean power under way times a ratio, whose
logarithm is normal; the robot learns mean and spread from the stretches that it drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.energy.consumption import Consumption, design_row, moving_time_s
from ohmward.energy.leg import Stretch
from ohmward.energy.points import normal_tail

#: Ratio of peak and mean before any was seen: what a stretch of three minutes over uneven ground with starts has, the
#: standard deviation of its logarithm, and for how many stretches that counts.
_USUAL_RATIO, _RATIO_LOG_STD, _RATIO_COUNT = 1.6, 0.35, 1.0
#: What a planned leg has longer than this [s] are further stretches.
_STRETCH_S = 180.0
#: A shorter stretch has no peak of its own [s].
PEAKED_S = 10.0
#: Powers at which a way is looked at lie so far apart in their logarithm.
_LOG_STEP = 0.02
#: The highest of them over the highest that is expected, in standard deviations.
_HIGHEST_SIGMA = 5.0


class PeakRatio(NamedTuple):
    """Logarithm of the ratio of the peak of a stretch to its mean power, as far as it was seen."""

    stretches: float = 0.0  #: so many were seen
    mean: float = 0.0
    squares: float = 0.0  #: sum of squared deviations from the mean

    def with_stretch(self, peak_W: float, mean_W: float) -> PeakRatio:
        """The same after one stretch more; one that took no power tells nothing."""
        if not (peak_W > 0.0 and mean_W > 0.0):
            return self
        deviation = math.log(peak_W / mean_W) - self.mean
        stretches = self.stretches + 1.0
        mean = self.mean + deviation / stretches
        return PeakRatio(stretches, mean, self.squares + deviation * (math.log(peak_W / mean_W) - mean))

    @property
    def expected(self) -> tuple[float, float]:
        """Mean and standard deviation for the stretches ahead, the usual ones counting beside those that were seen."""
        usual, count = math.log(_USUAL_RATIO), self.stretches + _RATIO_COUNT
        mean = (self.stretches * self.mean + _RATIO_COUNT * usual) / count
        between = self.stretches * _RATIO_COUNT / count * (self.mean - usual) ** 2
        return mean, math.sqrt((self.squares + between + _RATIO_COUNT * _RATIO_LOG_STD**2) / count)


class Peaks(NamedTuple):
    """How often a way asks for more than a power."""

    power_W: np.ndarray  #: (M,) increasing
    per_s: np.ndarray  #: (M,) peaks above it in a second, decreasing

    def above(self, power_W: np.ndarray) -> np.ndarray:
        """Rate [1/s] of peaks above powers of any shape: below the first as at the first, above the last none."""
        return np.interp(power_W, self.power_W, self.per_s, right=0.0)


def peaks_of_way(c: Consumption, way: Sequence[Stretch], ratio: PeakRatio) -> Peaks:
    """Peaks of a way; none where the robot only stands."""
    moving = [s for s in way if s.distance_m > 0.0]
    means_W = np.array([mean_power_W(c, s) for s in moving])
    counts = np.array([max(moving_time_s(s) / _STRETCH_S, 1.0) for s in moving])
    if not (means_W > 0.0).any():
        return Peaks(np.zeros(1), np.zeros(1))
    ratio_mean, ratio_std = ratio.expected
    logs = np.log(means_W[means_W > 0.0]) + ratio_mean
    grid = np.arange(logs.min() - ratio_std, logs.max() + _HIGHEST_SIGMA * ratio_std, _LOG_STEP)
    exceeded = normal_tail((grid[:, None] - logs) / ratio_std) @ counts[means_W > 0.0]
    return Peaks(np.exp(grid), exceeded / sum(s.time_s for s in way))


def mean_power_W(c: Consumption, stretch: Stretch) -> float:
    """Power [W] that a stretch is expected to take under way."""
    return float(design_row(c, stretch) @ c.mean) / max(moving_time_s(stretch), PEAKED_S)
