"""Outside speed beside the rims, from GNSS, visual or lidar odometry, optical flow: its noise, age and evidence.

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
from ohmward.trace import clip, exp, isfinite, maximum, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sample import CleanSample

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


#: The robot counts as held from this probability on. A single outside speed of zero may be a fault of its source, and
#: makes no alarm.
IS_HELD, ALARM = 0.5, 0.9

#: The wheels turn from this speed [m/s] of their rims on; a robot below this share of it is stuck.
TURNS_M_S, STUCK_SHARE = 0.1, 0.2

#: A robot is met held, or sliding, once in so long on average [s], is held for so long, and slides for so long.
MET_S, HELD_S, SLIDES_S = 500.0, 60.0, 10.0

#: Wheels begin to slide where they change their speed: once in so much change [m/s] on average.
MET_M_S = 15.0

#: Standard deviation h [m/s] of the speed of a robot that is held: it rocks. Slip q of one that rolls, over its speed.
ROCKS_M_S, ROLLS_SHARE = 0.05, 0.05

#: Share g of outside speeds that are garbage, and their density d [s/m].
GARBAGE, GARBAGE_S_PER_M = 0.01, 0.5

#: Density at two standard deviations from the mean, over that of one standard deviation of one.
TWO_SIGMA = math.exp(-2.0) / math.sqrt(2.0 * math.pi)


class Held(NamedTuple):
    """Hypothesis that the robot is held while its wheels turn, as one that is stuck: judged by outside speeds alone.

    Wheels and gyro cannot tell a robot that is held, or one whose wheels all slide, from one that rolls, so they are no
    evidence of it. An outside speed y of standard deviation s is: with the speed v of the rims,

        p(y | held)   = (1 - g) N(y; 0, s^2 + h^2) + g d
        p(y | rolls)  = (1 - g) N(y; v, s^2 + (q v)^2) + g d
        p(y | slides) = min(d, N(2 s; 0, s^2))

    and g the share of speeds that are garbage, of density d, as are those of a robot that slides: any, but where s is
    so large that d would tell of it within two of them. A robot is met held or sliding, and comes free, as in a Markov
    chain; without motor currents it is met sliding the more, the more its wheels change their speed; one whose wheels
    stand stays as it is.
    """

    probability: Any = 0.0  #: that it is held
    slides: Any = 0.0  #: that it slides


def weigh_held(before: Held, y: OutsideSpeed, rim_m_s: Any, dt_s: Scalar, changed_m_s: Scalar = 0.0) -> Held:
    """The hypothesis after a step.

    rim_m_s: forward speed as the wheels show it.
    changed_m_s: size of its change; 0 where motor currents tell what the wheels' friction does.
    """
    turns = abs(rim_m_s) > TURNS_M_S
    met, ends, stops = (1.0 - exp(-dt_s / time_s) for time_s in (MET_S, HELD_S, SLIDES_S))
    begins = 1.0 - exp(-dt_s / MET_S - changed_m_s / MET_M_S)
    was_held, slid = before.probability, before.slides
    held = was_held * (1.0 - ends) + (1.0 - was_held) * met
    slides = slid * (1.0 - stops) * (1.0 - met) + (1.0 - was_held - slid) * begins + 0.5 * was_held * ends
    rolls = 1.0 - held - slides
    variance, slip_m_s = y.std_m_s * y.std_m_s, ROLLS_SHARE * y.rims_m_s
    likely_held = held * where(y.measured, likelihood(y.speed_m_s, variance + ROCKS_M_S**2), 1.0)
    by_rolling = likelihood(y.speed_m_s - y.rims_m_s, variance + slip_m_s * slip_m_s)
    likely_rolls = rolls * where(y.measured, by_rolling, 1.0)
    any_speed = minimum(GARBAGE_S_PER_M, TWO_SIGMA / y.std_m_s)
    likely_slides = slides * where(y.measured, any_speed, 1.0)
    total = likely_held + likely_rolls + likely_slides
    return Held(where(turns, likely_held / total, was_held), where(turns, likely_slides / total, slid))


def likelihood(error_m_s: Scalar, variance: Scalar) -> Scalar:
    """Density [s/m] of an outside speed that is off by so much, which may be garbage."""
    normal = exp(-0.5 * error_m_s * error_m_s / variance) / sqrt(2.0 * math.pi * variance)
    return (1.0 - GARBAGE) * normal + GARBAGE * GARBAGE_S_PER_M
