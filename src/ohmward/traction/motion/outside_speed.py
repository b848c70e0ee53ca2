"""Outside speed besides the rims', from GNSS, visual or lidar odometry, optical flow: its noise, age and evidence.

It may be late: it is compared with the speed of the rims at its age, or where its source gives none, with the recent
one that lies nearest to it. The remainder is its error e, from which its noise is learnt. Slip and a wrong radius cause
lasting errors, which differences do not show; filters and satellites cause errors that are correlated from speed to
speed, by rho:

    D_1 = E (e_k - e_(k-1))^2 / 2 = V (1 - rho),   D_2 = E (e_k - e_(k-2))^2 / 2 = V (1 - rho^2)

A mean of many is as accurate as one of uncorrelated errors with the variance

    V (1 + rho) / (1 - rho) = D_1 (1 + rho) / (1 - rho)^2,   1 + rho = D_2 / D_1

The roots of D_1 and D_2 come from mean absolute differences, in which a single jump counts little. The standard
deviation given by the source, or a usual one, counts for a number n of differences, and the source's own is a minimum.
A standard deviation estimated from n is that of Student's distribution, larger by sqrt(n / (n - 2)).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Scalar, clip, exp, isfinite, maximum, minimum, sqrt, where
from ohmward.traction.motion.sample import CleanSample, History, empty_history, sum_since

#: Standard deviation [m/s] of a source that gives none, if its errors are not learnt: that of GNSS, and of camera
#: odometry at a walking pace.
ASSUMED_STD_M_S = 0.05

#: Usual standard deviation [m/s] if they are learnt, and the smallest learnt one.
USUAL_STD_M_S, LEAST_STD_M_S = 0.1, 0.02

#: Number of differences that the given standard deviation, and the usual one, count for (> 2), and the most in a mean.
GIVEN_COUNTS, USUAL_COUNTS, MEAN_OF = 20.0, 3.0, 100.0

#: Standard deviation of white noise over the mean size of its differences; largest difference that counts, over the
#: mean.
OF_DIFFERENCES, MOST_TIMES = math.sqrt(math.pi) / 2.0, 4.0

#: Largest correlation of successive errors.
MOST_CORRELATION = 0.9

#: Rims are remembered for one to two times this time [s]; share of an age that their known changes must cover.
RIMS_SPAN_S, KNOWN_SHARE = 0.6, 0.99

#: Changes of rims that are not recorded.
UNKNOWN_CHANGES = empty_history(0)


class SpeedErrors(NamedTuple):
    """Rims and errors of outside speeds from sample to sample."""

    #: (2,) least speed of the rims [m/s] in the running span and in the one before
    low_m_s: np.ndarray = np.full(2, FASTEST_M_S)
    high_m_s: np.ndarray = np.full(2, -FASTEST_M_S)  #: (2,) greatest speed of the rims [m/s], likewise
    span_s: Any = 0.0  #: since the running span began
    errors: np.ndarray = np.zeros(2)  #: (2,) the last errors, newest first, over the standard deviation as given
    differences: np.ndarray = np.ones(2)  #: (2,) roots of D_1 and D_2, over the standard deviation as given
    count: Any = 0.0  #: number of differences in these


class OutsideSpeed(NamedTuple):
    """An outside speed."""

    measured: Any  #: the condition that there is one
    speed_m_s: Scalar  #: as measured; 0 where there is none
    std_m_s: Scalar  #: its standard deviation
    rims_m_s: Scalar  #: speed of the rims that it is compared with
    late_m_s: Scalar  #: change of the rims since then; 0 without a speed
    white_std_m_s: Scalar = math.nan  #: standard deviation of the part that is uncorrelated from speed to speed
    since_m_s: Scalar = 0.0  #: `late_m_s` where the source gives its age, else 0


def receive(
    before: SpeedErrors,
    rim_m_s: Any,
    clean: CleanSample,
    rolls: Any,
    std_m_s: float,
    rims: History = UNKNOWN_CHANGES,
) -> tuple[SpeedErrors, OutsideSpeed]:
    """The state after a step, and the outside speed with which it ends, if there is one.

    rim_m_s: forward speed by the wheels.
    rolls: the condition that the robot moves at it, so that noise is learnt.
    std_m_s: usual standard deviation of a source that does not give its own.
    rims: changes of `rim_m_s` until now; an age beyond them counts as not given.
    """
    over = before.span_s + clean.dt_s >= RIMS_SPAN_S
    low = where(over, np.array([rim_m_s, before.low_m_s[0]]), minimum(before.low_m_s, np.array([rim_m_s, np.inf])))
    high = where(over, np.array([rim_m_s, before.high_m_s[0]]), maximum(before.high_m_s, np.array([rim_m_s, -np.inf])))
    measured, given = isfinite(clean.speed_m_s), isfinite(clean.speed_std_m_s)
    y = where(measured, clean.speed_m_s, 0.0)
    since_m_s, known_s = sum_since(rims.dt_s, rims.change_m_s, clean.speed_age_s)
    aged = (clean.speed_age_s > 0.0) & (known_s >= KNOWN_SHARE * clean.speed_age_s)
    nearest_m_s = minimum(maximum(y, minimum(low[0], low[1])), maximum(high[0], high[1]))
    rims_m_s = where(aged, rim_m_s - since_m_s, nearest_m_s)
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
        since_m_s=where(measured & aged, since_m_s, 0.0),
    )
    return after, received


def effective_std(differences: np.ndarray) -> Scalar:
    """Root of D_1 (1 + rho) / (1 - rho)^2."""
    rho = clip((differences[1] / differences[0]) ** 2 - 1.0, 0.0, MOST_CORRELATION)
    return differences[0] * sqrt(1.0 + rho) / (1.0 - rho)


#: Probabilities from which the robot counts as held, and from which an alarm is raised. A single outside speed of zero
#: may be a fault of its source, and raises none.
IS_HELD, ALARM = 0.5, 0.9

#: Rim speed [m/s] from which the wheels turn, and share of it below which a robot is stuck.
TURNS_M_S, STUCK_SHARE = 0.1, 0.2

#: Mean time [s] until a robot is held or slides, mean time for which it is held, and for which it slides.
MET_S, HELD_S, SLIDES_S = 500.0, 60.0, 10.0

#: Mean change of wheel speed [m/s] until the wheels slide: slides begin where it changes.
MET_M_S = 15.0

#: Standard deviation h [m/s] of the speed of a held robot, which rocks. Slip q of a rolling one, over its speed.
ROCKS_M_S, ROLLS_SHARE = 0.05, 0.05

#: Share g of outside speeds that are garbage, and their density d [s/m].
GARBAGE, GARBAGE_S_PER_M = 0.01, 0.5

#: Density of the standard normal distribution at two standard deviations.
TWO_SIGMA = math.exp(-2.0) / math.sqrt(2.0 * math.pi)


class Held(NamedTuple):
    """Hypothesis that the robot is held while its wheels turn, as if stuck: judged by outside speeds alone.

    Wheels and gyro cannot distinguish a robot that is held, or whose wheels all slide, from one that rolls, so they are
    no evidence. An outside speed y with standard deviation s is: with the speed v of the rims,

        p(y | held)   = (1 - g) N(y; 0, s^2 + h^2) + g d
        p(y | rolls)  = (1 - g) N(y; v, s^2 + (q v)^2) + g d
        p(y | slides) = min(d, N(2 s; 0, s^2))

    and g the share of speeds that are garbage, of density d. A sliding robot has that density too, unless s is so large
    that d would favour sliding within two standard deviations. Holding and sliding begin and end as in a Markov chain;
    without motor currents a slide is likelier to begin the more the wheels change their speed; while the wheels stand,
    the state stays.
    """

    probability: Any = 0.0  #: that the robot is held
    slides: Any = 0.0  #: that the robot slides


def weigh_held(before: Held, y: OutsideSpeed, rim_m_s: Any, dt_s: Scalar, changed_m_s: Scalar = 0.0) -> Held:
    """The hypothesis after a step.

    rim_m_s: forward speed by the wheels.
    changed_m_s: size of its change; 0 if motor currents show the friction of the wheels.
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
    """Density [s/m] of an outside speed with this error, garbage included."""
    normal = exp(-0.5 * error_m_s * error_m_s / variance) / sqrt(2.0 * math.pi * variance)
    return (1.0 - GARBAGE) * normal + GARBAGE * GARBAGE_S_PER_M
