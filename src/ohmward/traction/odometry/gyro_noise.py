"""Angle random walk of a gyro, learnt from its own samples: third differences hold its noise and no motion.

    e_i = g_i - 3 g_(i-1) + 3 g_(i-2) - g_(i-3),   E[e^2] = 20 s^2,   N^2 = s^2 dt

s is the standard deviation of a sample's white noise, N^2 the variance of the angle over time (the random walk of IEEE
Std 952). A motion up to a quadratic in time leaves nothing in e. Vibration of a heavy robot is in e and counts as
white, though its angle does not walk: the band is too wide there rather than too narrow.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import logical_not, maximum, minimum, where
from ohmward.trace.expression import Scalar

#: Weights of the third difference, and the sum of their squares.
WEIGHTS = np.array([1.0, -3.0, 3.0, -1.0])
SUM_OF_SQUARES = float(WEIGHTS @ WEIGHTS)

#: Noise changes with what vibrates: it is forgotten in so many seconds.
FORGOTTEN_S = 5.0

#: The data sheet counts as much as so many samples.
SHEET_SAMPLES = 20.0

#: Samples farther apart than this [s] hold motion in their third difference, but those of a robot that stands.
LONGEST_INTERVAL_S = 0.1

#: A square larger than so many variances counts as that many: five sigmas, so that one spike is no noise.
MOST_VARIANCES = 25.0


class GyroNoise(NamedTuple):
    """Noise of a gyro as its samples have shown it so far."""

    variance: Any  #: of the angle over time [rad2/s]
    samples: Any  #: how many it rests upon
    last_rad_s: np.ndarray  #: (3,) samples before, newest first
    since_s: Any  #: time since the newest
    in_row: Any  #: how many of them came without a pause


def of_sheet(gyro_walk: float) -> GyroNoise:
    """Noise before the first sample, from the angle random walk of the data sheet."""
    return GyroNoise(gyro_walk**2, SHEET_SAMPLES, np.zeros(3), 0.0, 0.0)


def learn(
    known: GyroNoise, rate_rad_s: Scalar, new: Scalar, stands: Scalar, dt_s: Scalar, gyro_walk: float
) -> GyroNoise:
    """The noise after a step.

    new: the condition that it ended with a sample of the gyro.
    stands: the condition that no wheel turned in it.
    """
    interval_s = known.since_s + dt_s
    in_row = where((interval_s > LONGEST_INTERVAL_S) & logical_not(stands), 0.0, known.in_row)
    rate_rad_s = where(new, rate_rad_s, 0.0)
    window = np.array([rate_rad_s, *known.last_rad_s])
    difference = WEIGHTS @ window
    most = MOST_VARIANCES * maximum(known.variance, gyro_walk**2)
    seen = minimum(difference * difference / SUM_OF_SQUARES * interval_s, most)
    counts = new & (in_row >= len(known.last_rad_s))
    samples = minimum(known.samples + 1.0, FORGOTTEN_S / maximum(interval_s, FORGOTTEN_S / 1e6))
    learnt = known.variance + (seen - known.variance) / maximum(samples, 1.0)
    return GyroNoise(
        variance=where(counts, learnt, known.variance),
        samples=where(counts, samples, known.samples),
        last_rad_s=where(new, window[:-1], known.last_rad_s),
        since_s=where(new, 0.0, interval_s),
        in_row=where(new, minimum(in_row + 1.0, float(len(known.last_rad_s))), in_row),
    )


def walk_variance(known: GyroNoise, gyro_walk: float) -> Scalar:
    """Variance of the angle over time [rad2/s]: what the samples show, and no less than the data sheet's."""
    return maximum(known.variance, gyro_walk**2)
