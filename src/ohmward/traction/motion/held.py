"""Hypothesis that a robot is held while its wheels turn, as one that is stuck: judged by outside speeds alone.

Wheels and gyro cannot tell a robot that is held, or one whose wheels all slide, from one that rolls, so they are no
evidence of it. An outside speed y of standard deviation s is: with the speed v of the rims,

    p(y | held)   = (1 - g) N(y; 0, s^2 + h^2) + g d
    p(y | rolls)  = (1 - g) N(y; v, s^2 + (q v)^2) + g d
    p(y | slides) = d

and g the share of speeds that are garbage, of density d, as are those of a robot that slides: any. A robot is met held
or sliding, and comes free, as in a Markov chain; one whose wheels stand stays as it is. An outside speed may be late: v
is whatever the rims have shown of late that lies nearest to y. Noise that is larger than s is learnt from the
differences of the errors y - v, as slip makes ones that last.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.quantities import FASTEST_M_S
from ohmward.trace import exp, isfinite, maximum, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample

#: The robot counts as held from this probability on. A single outside speed of zero may be a fault of its source, and
#: makes no alarm.
IS_HELD, ALARM = 0.5, 0.9

#: The wheels turn from this speed [m/s] of their rims on.
TURNS_M_S = 0.1

#: A robot is met held, or sliding, once in so long on average [s], is held for so long, and slides for so long.
MET_S, HELD_S, SLIDES_S = 500.0, 60.0, 10.0

#: Standard deviation h [m/s] of the speed of a robot that is held: it rocks. Slip q of one that rolls, over its speed.
ROCKS_M_S, ROLLS_SHARE = 0.05, 0.05

#: Share g of outside speeds that are garbage, and their density d [s/m].
GARBAGE, GARBAGE_S_PER_M = 0.01, 0.5

#: Standard deviation of white noise over the mean size of its differences; number of them in the mean, and the most
#: times the mean that one counts for.
OF_DIFFERENCES, MEAN_OF, MOST_TIMES = math.sqrt(math.pi) / 2.0, 20.0, 4.0

#: Rims are remembered for once to twice so long [s].
RIMS_SPAN_S = 0.6


class Held(NamedTuple):
    """The hypothesis from sample to sample."""

    probability: Any = 0.0  #: that it is held
    slides: Any = 0.0  #: that it slides
    #: (2,) least and greatest speed of the rims [m/s] in the running span of `RIMS_SPAN_S` and the one before
    low_m_s: np.ndarray = np.full(2, FASTEST_M_S)
    high_m_s: np.ndarray = np.full(2, -FASTEST_M_S)
    span_s: Any = 0.0  #: since the running span began
    #: the last outside speed less what the rims had shown, over s, and the noise of such values in the same unit
    error: Any = 0.0
    noise: Any = 1.0
    late_m_s: Any = 0.0  #: what the rims have changed by since they were as fast as the outside speed of this step


def weigh_held(before: Held, rim_m_s: Any, clean: CleanSample, speed_std_m_s: float) -> Held:
    """The hypothesis after a step.

    rim_m_s: forward speed as the wheels show it.
    speed_std_m_s: of an outside speed without a standard deviation of its own.
    """
    over = before.span_s + clean.dt_s >= RIMS_SPAN_S
    low = where(over, np.array([rim_m_s, before.low_m_s[0]]), minimum(before.low_m_s, np.array([rim_m_s, np.inf])))
    high = where(over, np.array([rim_m_s, before.high_m_s[0]]), maximum(before.high_m_s, np.array([rim_m_s, -np.inf])))
    turns = abs(rim_m_s) > TURNS_M_S
    met, ends, stops = (1.0 - exp(-clean.dt_s / time_s) for time_s in (MET_S, HELD_S, SLIDES_S))
    was_held, slid = before.probability, before.slides
    held = was_held * (1.0 - ends) + (1.0 - was_held) * met
    slides = slid * (1.0 - stops) * (1.0 - met) + (1.0 - was_held - slid) * met + 0.5 * was_held * ends
    rolls = 1.0 - held - slides
    measured = isfinite(clean.speed_m_s)
    y = where(measured, clean.speed_m_s, 0.0)
    given_std = where(isfinite(clean.speed_std_m_s), clean.speed_std_m_s, speed_std_m_s)
    std_m_s = given_std * before.noise
    rolls_m_s = minimum(maximum(y, minimum(low[0], low[1])), maximum(high[0], high[1]))
    slip_m_s = ROLLS_SHARE * rolls_m_s
    likely_held = held * where(measured, likelihood(y, std_m_s * std_m_s + ROCKS_M_S**2), 1.0)
    likely_rolls = rolls * where(measured, likelihood(y - rolls_m_s, std_m_s * std_m_s + slip_m_s * slip_m_s), 1.0)
    likely_slides = slides * where(measured, GARBAGE_S_PER_M, 1.0)
    total = likely_held + likely_rolls + likely_slides
    error = (y - rolls_m_s) / given_std
    seen = minimum(abs(error - before.error) * OF_DIFFERENCES, MOST_TIMES * before.noise)
    noise = maximum(before.noise + (seen - before.noise) / MEAN_OF, 1.0)
    rolled = measured & (before.probability <= IS_HELD)
    return Held(
        probability=where(turns, likely_held / total, was_held),
        slides=where(turns, likely_slides / total, slid),
        low_m_s=low,
        high_m_s=high,
        span_s=where(over, 0.0, before.span_s + clean.dt_s),
        late_m_s=where(measured, rim_m_s - rolls_m_s, 0.0),
        error=where(measured, error, before.error),
        noise=where(rolled, noise, before.noise),
    )


def likelihood(error_m_s: Scalar, variance: Scalar) -> Scalar:
    """Density [s/m] of an outside speed that is off by so much, which may be garbage."""
    normal = exp(-0.5 * error_m_s * error_m_s / variance) / sqrt(2.0 * math.pi * variance)
    return (1.0 - GARBAGE) * normal + GARBAGE * GARBAGE_S_PER_M
