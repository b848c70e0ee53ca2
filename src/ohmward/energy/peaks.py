"""Peaks of power along a route: how often a robot demands more than a given power from its battery.

The peak of a stretch, the highest power sustained for some seconds, is its mean power under way times a lognormal
ratio; the robot learns the mean and spread of its logarithm from the stretches that it drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.energy.consumption import Consumption, design_row, moving_time_s
from ohmward.energy.leg import STRETCH_S, Stretch, total_time_s
from ohmward.energy.points import normal_tail

#: Prior of the ratio of peak to mean, that of a stretch of three minutes over uneven ground with starts; standard
#: deviation of its logarithm; weight of this prior in stretches.
_USUAL_RATIO, _RATIO_LOG_STD, _RATIO_COUNT = 1.6, 0.35, 1.0
#: Shortest stretch with a peak of its own [s].
PEAKED_S = 10.0
#: Smallest time [s] used as a divisor.
_LEAST_S = 1e-9
#: Step of the grid of powers, in their logarithm.
_LOG_STEP = 0.02
#: Upper end of the grid above the highest expected peak, in standard deviations.
_HIGHEST_SIGMA = 5.0


class PeakRatio(NamedTuple):
    """Logarithm of the ratio of peak to mean power, over the stretches driven so far."""

    stretches: float = 0.0  #: number of stretches
    mean: float = 0.0
    squares: float = 0.0  #: sum of squared deviations from the mean

    def with_stretch(self, peak_W: float, mean_W: float) -> PeakRatio:
        """Statistics after one more stretch; one without power is ignored."""
        if not (peak_W > 0.0 and mean_W > 0.0):
            return self
        deviation = math.log(peak_W / mean_W) - self.mean
        stretches = self.stretches + 1.0
        mean = self.mean + deviation / stretches
        return PeakRatio(stretches, mean, self.squares + deviation * (math.log(peak_W / mean_W) - mean))

    @property
    def expected(self) -> tuple[float, float]:
        """Mean and standard deviation for the stretches ahead, from the prior and the stretches driven."""
        usual, count = math.log(_USUAL_RATIO), self.stretches + _RATIO_COUNT
        mean = (self.stretches * self.mean + _RATIO_COUNT * usual) / count
        between = self.stretches * _RATIO_COUNT / count * (self.mean - usual) ** 2
        return mean, math.sqrt((self.squares + between + _RATIO_COUNT * _RATIO_LOG_STD**2) / count)


class Peaks(NamedTuple):
    """Rate of peaks above a power along a route."""

    power_W: np.ndarray  #: (M,) increasing
    per_s: np.ndarray  #: (M,) peaks above it per second, decreasing

    def above(self, power_W: np.ndarray) -> np.ndarray:
        """Rate [1/s] of peaks above powers of any shape; constant below the first of the grid, 0 above the last."""
        return np.interp(power_W, self.power_W, self.per_s, right=0.0)


def peaks_of_way(c: Consumption, way: Sequence[Stretch], ratio: PeakRatio) -> Peaks:
    """Peaks along a route; none where the robot only stands."""
    moving = [s for s in way if s.distance_m > 0.0]
    means_W = np.array([mean_power_W(c, s) for s in moving])
    counts = np.array([max(moving_time_s(s) / STRETCH_S, 1.0) for s in moving])  # a long leg is several
    if not (means_W > 0.0).any():
        return Peaks(np.zeros(1), np.zeros(1))
    ratio_mean, ratio_std = ratio.expected
    logs = np.log(means_W[means_W > 0.0]) + ratio_mean
    grid = np.arange(logs.min() - ratio_std, logs.max() + _HIGHEST_SIGMA * ratio_std, _LOG_STEP)
    exceeded = normal_tail((grid[:, None] - logs) / ratio_std) @ counts[means_W > 0.0]
    return Peaks(np.exp(grid), exceeded / max(total_time_s(way), _LEAST_S))


def mean_power_W(c: Consumption, stretch: Stretch) -> float:
    """Expected mean power [W] of a stretch under way."""
    return float(design_row(c, stretch) @ c.mean) / max(moving_time_s(stretch), PEAKED_S)
