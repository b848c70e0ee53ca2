"""Evidence of an outside speed: GNSS, visual or lidar odometry, optical flow, beside wheels that slip.

    l = (w_x - v_x) / u = b' lambda,    b the forward row of G_d^+, u the travel speed of the rims

The loss l is averaged since the last event. An error of the speed lasts, in part, from sample to sample, so the mean of
n speeds of variance r has more than r / n:

    var l = r (s + (1 - s) / n) / u^2

Each combination of floors expects b' m with variance b' C b of it, and is weighed by the normal density of what is
seen. The slip of the wheels is then corrected by it, as a Kalman filter would.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import every, some
from ohmward.trace import exp, isfinite, log, logical_not, maximum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.outside_speed import ASSUMED_STD_M_S
from ohmward.traction.motion.sample import LEAST_DIVISOR, CleanSample
from ohmward.traction.terrain.crossing import MEMORY_S
from ohmward.traction.terrain.floor import SlipBelief

#: An older speed says nothing of now [s].
OLDEST_LOSS_S = 1.0
#: s. Share of the variance of a speed that lasts: its scale and mounting are off by about a third of its noise.
LASTING_SHARE = 0.1
#: A speed off by more sigmas than this from the mean of those before, which fade with the time constant of the mean
#: force, begins a new mean: the slip has changed.
CHANGED = 3.0


class LossState(NamedTuple):
    """Mean loss since the last event, the mean variance of one such loss, and the number of speeds in them, fading."""

    mean: Any
    variance: Any
    count: Any


class SeenLoss(NamedTuple):
    """A loss as the outside speeds show it: known where there is one, its value and its variance."""

    known: Any
    value: Any
    variance: Any


class LossSample(NamedTuple):
    """Loss of one sample with its variance, nan where there is none, and whether a speed was there and refused."""

    value: Any
    variance: Any
    refused: Any


def no_loss() -> LossState:
    """State before the first outside speed."""
    return LossState(0.0, 1.0, 0.0)


def loss_sample(clean: CleanSample, rim: np.ndarray, rim_std: np.ndarray, rate: np.ndarray, u: Scalar) -> LossSample:
    """Loss that the speed of a sample shows, u = |w| > 0.

    A wheel that slips loses no more than all of its rim's motion, nor gains more: another speed is refused. What the
    rims changed by since an old speed was true counts as its error.
    """
    std_m_s = where(isfinite(clean.speed_std_m_s), clean.speed_std_m_s, ASSUMED_STD_M_S)
    lost_m_s = rim[0] - clean.speed_m_s
    variance = std_m_s**2 + rim_std[0] ** 2 + (rate[0] * clean.speed_age_s) ** 2
    beyond = maximum(abs(lost_m_s) - u, 0.0)
    there = isfinite(clean.speed_m_s)
    used = every([there, clean.speed_age_s <= OLDEST_LOSS_S, beyond * beyond <= CHANGED**2 * variance])
    return LossSample(
        where(used, lost_m_s / u, math.nan),
        where(used, variance / (u * u), math.nan),
        some([clean.speed_refused, every([there, logical_not(used)])]),
    )


def averaged(state: LossState, sample: LossSample, ended: Scalar, dt_s: Scalar) -> LossState:
    """State after a sample; `ended`: the condition that the motion or the floor has changed."""
    new = isfinite(sample.value)
    value, variance = where(new, sample.value, state.mean), where(new, sample.variance, state.variance)
    before = where(ended, 0.0, state.count * exp(-dt_s / MEMORY_S))
    off = value - state.mean
    changed = off * off > CHANGED**2 * (variance + seen(state).variance)
    count = where(new, where(changed, 0.0, before) + 1.0, before)
    share = where(new, 1.0 / maximum(count, LEAST_DIVISOR), 0.0)
    return LossState(state.mean + share * off, state.variance + share * (variance - state.variance), count)


def seen(state: LossState) -> SeenLoss:
    """The mean loss with its variance."""
    variance = state.variance * (LASTING_SHARE + (1 - LASTING_SHARE) / maximum(state.count, LEAST_DIVISOR))
    return SeenLoss(state.count > LEAST_DIVISOR, state.mean, variance)


def log_likelihood(loss: SeenLoss, combinations: np.ndarray, slips: Sequence[SlipBelief], b: np.ndarray) -> list[Any]:
    """Logarithm of p(l | c) of each combination (C, wheels), without its constant; 0 where no speed was seen.

    slips: belief in the slip of the driven wheels on each of all floors.
    b: (driven,) loss of the robot for a slip of each wheel.
    """
    found = []
    for under in combinations[:, : len(b)]:
        expected, variance = 0.0, loss.variance
        for floor in sorted(set(under)):
            part = np.where(under == floor, b, 0.0)
            expected = expected + part @ slips[floor].mean
            variance = variance + part @ slips[floor].cov @ part
        off = loss.value - expected
        found.append(where(loss.known, -0.5 * (off * off / variance + log(variance)), 0.0))
    return found


def corrected(slip: SlipBelief, loss: SeenLoss, b: np.ndarray) -> SlipBelief:
    """Slip of the driven wheels after the loss, K = C b / (b' C b + var l).

    lambda+ = lambda + K (l - b' lambda),    C+ = C - K b' C
    """
    along = slip.cov @ b
    gain = along * where(loss.known, 1.0 / (b @ along + loss.variance), 0.0)
    return SlipBelief(slip.mean + gain * (loss.value - b @ slip.mean), slip.cov - np.outer(gain, along))
