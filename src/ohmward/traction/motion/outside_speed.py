"""Outside speed beside the rims: from GNSS, visual or lidar odometry, optical flow; its noise, and how late it may be.

It may be late: the rims that it is held against are whatever they have been of late that lies nearest to it. What is
left are its errors e, from which its noise is learnt. Slip and a wrong radius make errors that last, which no
difference shows, and filters and satellites make ones that fade from speed to speed, by rho:

    D_1 = E (e_k - e_(k-1))^2 / 2 = V (1 - rho),   D_2 = E (e_k - e_(k-2))^2 / 2 = V (1 - rho^2)

A mean of many is as good as one of uncorrelated errors of the variance

    V (1 + rho) / (1 - rho) = D_1 (1 + rho) / (1 - rho)^2,   1 + rho = D_2 / D_1

The roots of D_1 and D_2 are means of the sizes of differences, for which one that jumps is no noise. The standard
deviation that the source gives, or a usual one, counts for a number n of differences, and what a source gives is its
least. A standard deviation that rests upon n is that of Student's distribution, larger by sqrt(n / (n - 2)).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.quantities import FASTEST_M_S
from ohmward.trace import clip, isfinite, maximum, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample

#: Standard deviation [m/s] of a source that gives none, where its errors are not learnt: of GNSS, and of odometry of
#: cameras at a walking pace.
ASSUMED_STD_M_S = 0.05

#: The usual one where they are, and the least one that they show.
USUAL_STD_M_S, LEAST_STD_M_S = 0.1, 0.02

#: Number of differences that the given standard deviation, and the usual one, count for (> 2), and the most in a mean.
GIVEN_COUNTS, USUAL_COUNTS, MEAN_OF = 20.0, 3.0, 100.0

#: Standard deviation of white noise over the mean size of its differences; a difference counts up to so many times.
OF_DIFFERENCES, MOST_TIMES = math.sqrt(math.pi) / 2.0, 4.0

#: Most correlation from each error to the next.
MOST_CORRELATION = 0.9

#: Rims are remembered for once to twice so long [s].
RIMS_SPAN_S = 0.6


class SpeedErrors(NamedTuple):
    """Rims and errors of outside speeds from sample to sample."""

    #: (2,) least and greatest speed of the rims [m/s] in the running span of `RIMS_SPAN_S` and the one before
    low_m_s: np.ndarray = np.full(2, FASTEST_M_S)
    high_m_s: np.ndarray = np.full(2, -FASTEST_M_S)
    span_s: Any = 0.0  #: since the running span began
    #: (2,) the last errors, newest first, and the roots of D_1 and D_2, all over the standard deviation as given
    errors: np.ndarray = np.zeros(2)
    differences: np.ndarray = np.ones(2)
    count: Any = 0.0  #: number of differences in these


class OutsideSpeed(NamedTuple):
    """An outside speed."""

    measured: Any  #: the condition that there is one
    speed_m_s: Scalar  #: as measured; 0 where there is none
    std_m_s: Scalar  #: its standard deviation
    rims_m_s: Scalar  #: speed of the rims that it is held against
    late_m_s: Scalar  #: what they have changed by since; 0 where there is none
    white_std_m_s: Scalar = math.nan  #: standard deviation of what does not last from speed to speed


def receive(
    before: SpeedErrors, rim_m_s: Any, clean: CleanSample, rolls: Any, std_m_s: float
) -> tuple[SpeedErrors, OutsideSpeed]:
    """The state after a step, and the outside speed with which it ends, if there is one.

    rim_m_s: forward speed as the wheels show it.
    rolls: the condition that this is the robot's, so that noise is learnt.
    std_m_s: usual standard deviation of a source that does not give its own.
    """
    over = before.span_s + clean.dt_s >= RIMS_SPAN_S
    low = where(over, np.array([rim_m_s, before.low_m_s[0]]), minimum(before.low_m_s, np.array([rim_m_s, np.inf])))
    high = where(over, np.array([rim_m_s, before.high_m_s[0]]), maximum(before.high_m_s, np.array([rim_m_s, -np.inf])))
    measured, given = isfinite(clean.speed_m_s), isfinite(clean.speed_std_m_s)
    y = where(measured, clean.speed_m_s, 0.0)
    rims_m_s = minimum(maximum(y, minimum(low[0], low[1])), maximum(high[0], high[1]))
    unit_m_s = where(given, clean.speed_std_m_s, std_m_s)
    error = (y - rims_m_s) / unit_m_s
    counts = minimum(before.count + where(given, GIVEN_COUNTS, USUAL_COUNTS), MEAN_OF)
    share = 1.0 / (counts + 1.0)
    seen = minimum(abs(error - before.errors) * OF_DIFFERENCES, MOST_TIMES * before.differences)
    differences = before.differences + share * (seen - before.differences)
    learns = measured & rolls
    after = SpeedErrors(
        low_m_s=low,
        high_m_s=high,
        span_s=where(over, 0.0, before.span_s + clean.dt_s),
        errors=where(measured, np.array([error, before.errors[0]]), before.errors),
        differences=where(learns, differences, before.differences),
        count=where(learns, minimum(before.count + 1.0, MEAN_OF), before.count),
    )
    least = where(given, 1.0, LEAST_STD_M_S / unit_m_s)
    unsure_m_s = unit_m_s * sqrt(counts / (counts - 2.0))
    received = OutsideSpeed(
        measured=measured,
        speed_m_s=y,
        std_m_s=unsure_m_s * maximum(effective_std(after.differences), least),
        white_std_m_s=unsure_m_s * maximum(after.differences[0], least),
        rims_m_s=rims_m_s,
        late_m_s=where(measured, rim_m_s - rims_m_s, 0.0),
    )
    return after, received


def effective_std(differences: np.ndarray) -> Scalar:
    """Root of D_1 (1 + rho) / (1 - rho)^2."""
    rho = clip((differences[1] / differences[0]) ** 2 - 1.0, 0.0, MOST_CORRELATION)
    return differences[0] * sqrt(1.0 + rho) / (1.0 - rho)
