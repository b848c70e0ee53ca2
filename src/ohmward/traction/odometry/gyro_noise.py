"""Noise of a gyro as it shows in use: the random walk of its angle, and that of its offset."""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import TINY
from ohmward.trace import Scalar, exp, log, logical_not, maximum, minimum, where
from ohmward.traction.odometry.model import OFFSET, YAW, X, Y, vector

#: Weights of the third difference, and the sum of their squares.
WEIGHTS = np.array([1.0, -3.0, 3.0, -1.0])
SUM_OF_SQUARES = float(WEIGHTS @ WEIGHTS)

#: Time [s] in which noise is forgotten: it changes with vibration.
FORGOTTEN_S = 5.0

#: Number of samples that the data sheet counts for.
SHEET_SAMPLES = 20.0

#: Samples farther apart than this [s] have motion in their third difference, unless the robot stands.
LONGEST_INTERVAL_S = 0.1

#: Largest square, in variances: five sigmas, so that one spike is not learnt as noise.
MOST_VARIANCES = 25.0


class GyroNoise(NamedTuple):
    """Angle random walk of a gyro, learnt from its own samples: third differences contain its noise and no motion.

        e_i = g_i - 3 g_(i-1) + 3 g_(i-2) - g_(i-3),   E[e^2] = 20 s^2,   N^2 = s^2 dt

    s is the standard deviation of a sample's white noise, N^2 the variance of the angle over time (the random walk of
    IEEE Std 952). A motion up to a quadratic in time leaves nothing in e. Vibration of a heavy robot is in e and counts
    as white, though its angle does not walk: the band is too wide there rather than too narrow.
    """

    variance: Any  #: of the angle over time [rad2/s]
    samples: Any  #: number of samples behind the variance
    last_rad_s: np.ndarray  #: (3,) previous samples, newest first
    since_s: Any  #: time since the newest
    in_row: Any  #: number of them without a pause


def gyro_noise_of_sheet(gyro_walk: float) -> GyroNoise:
    """Noise before the first sample, from the angle random walk of the data sheet."""
    return GyroNoise(gyro_walk**2, SHEET_SAMPLES, np.zeros(3), 0.0, 0.0)


def learn_gyro_noise(
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
    """Variance of the angle over time [rad2/s]: from the samples, and at least the data sheet's."""
    return maximum(known.variance, gyro_walk**2)


#: Random walks of a gyro's offset over that of the data sheet, from a calm gyro to one that warms up, and their
#: probabilities before a drive; time [s] in which a gyro changes from one to another.
OFFSET_WALKS = np.array([0.3, 1.0, 4.0, 15.0])
WALK_PRIOR, WALK_LASTS_S = 1.0 / OFFSET_WALKS / sum(1.0 / OFFSET_WALKS), 100.0

#: Gain K of the offset's corrections from which a span ends.
SPAN_GAIN = 0.5


class OffsetWalk(NamedTuple):
    """Random walk of a gyro's offset b: probabilities p_k of `OFFSET_WALKS`, by the changes of b over spans of time T.

        q = sum p_k q_k,   K = 1 - P_1 / (P_0 + q T),   nu = (b_1 - b_0) / K,   S_k = (P_0 + q T) / K + (q_k - q) T
        p_k ~ p_k N(nu; 0, S_k)

    P_0 and P_1 are the variances of b at the ends of a span, q_k is the variance of a walk over time, q that which the
    odometry uses. The corrections in a span count as one of the gain K. A span ends once they have shown the offset, so
    that a time in which nothing does tells nothing of the walk.
    """

    probability: np.ndarray = WALK_PRIOR  #: (walks,)
    time_s: Any = 0.0  #: since the start of the span
    offset_variance: Any = 0.0  #: variance of the offset at that start
    offset_rad_s: Any = 0.0  #: estimate of the offset at that start
    x_m: Any = 0.0  #: position at that start
    y_m: Any = 0.0  #: its other coordinate

    def variance(self, offset_walk: float) -> Any:
        """Variance q of the offset over time [rad2/s3]; offset_walk: that of the data sheet."""
        return self.probability @ (offset_walk * OFFSET_WALKS) ** 2


def learn_offset_walk(known: OffsetWalk, belief: Belief, dt_s: Scalar, offset_walk: float) -> tuple[OffsetWalk, Belief]:
    """The walk after a step, and the belief of the odometry with the turn by a walk that turns out to be larger.

    An offset that is known at both ends of a span, and walks by the variance dq over time more than was known, turns
    the yaw by dq T^3 / 12 more, as a Brownian bridge, and the way of the span by half of that angle.
    """
    x, P = belief
    time_s, q = known.time_s + dt_s, known.variance(offset_walk)
    predicted = maximum(known.offset_variance + q * time_s, TINY)
    gain = 1.0 - P[OFFSET, OFFSET] / predicted
    ends = gain >= SPAN_GAIN
    gain = maximum(gain, SPAN_GAIN)
    nu = (x[OFFSET] - known.offset_rad_s) / gain
    S = maximum(predicted / gain + ((offset_walk * OFFSET_WALKS) ** 2 - q) * time_s, TINY)
    logs = -0.5 * (log(S) + nu * nu / S)
    changes = 1.0 - exp(-time_s / WALK_LASTS_S)
    likely = (known.probability + changes * (WALK_PRIOR - known.probability)) * exp(logs - reduce(maximum, logs))
    found = OffsetWalk(likely / likely.sum(), 0.0, P[OFFSET, OFFSET], x[OFFSET], x[X], x[Y])
    larger = where(ends, maximum(found.variance(offset_walk) - q, 0.0), 0.0)
    turned = vector({X: (known.y_m - x[Y]) / 2.0, Y: (x[X] - known.x_m) / 2.0, YAW: 1.0})
    widened = Belief(x, P + larger * time_s * time_s * time_s / 12.0 * np.outer(turned, turned))
    return choose(ends, found, known._replace(time_s=time_s)), widened
