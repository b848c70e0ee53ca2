"""Hypothesis that a robot is held while its wheels turn, as one that is stuck: judged by outside speeds alone.

Wheels and gyro cannot tell a robot that is held, or one whose wheels all slide, from one that rolls, so they are no
evidence of it. An outside speed y of standard deviation s is: with the speed v of the rims,

    p(y | held)   = (1 - g) N(y; 0, s^2 + h^2) + g d
    p(y | rolls)  = (1 - g) N(y; v, s^2 + (q v)^2) + g d
    p(y | slides) = min(d, N(2 s; 0, s^2))

and g the share of speeds that are garbage, of density d, as are those of a robot that slides: any, but where s is so
large that d would tell of it within two of them. A robot is met held or sliding, and comes free, as in a Markov chain;
without motor currents it is met sliding the more, the more its wheels change their speed; one whose wheels stand stays
as it is.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ohmward.trace import exp, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.outside_speed import OutsideSpeed

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
    """The hypothesis from sample to sample."""

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
