"""Crossings of a wheel to another floor: Page's CUSUM test on the wheel forces, for each wheel and both directions.

    g+ = max(0, g+ + (dt/tau) e' (f - mu - e/2) / sigma^2),          g- likewise with mu - f
    sigma^2 = ripple^2 + (growth |mu|)^2,   tau = ripple_m / speed

f are the forces of the driven wheels over their mean load, mu their mean since the last change, e their change when the
floor under one wheel changes (`floor.drag_columns`): it depends on the direction of the motion, and distinguishes a
crossing from the ripple of the rollers, which depends on distance and not on time. An alarm is g > h; h follows from
the false-alarm rate. For Brownian motion the mean time between false alarms of one test is (Page 1954, Siegmund 1985)

    T = (2 tau / k^2) (e^h - h - 1),   k^2 = e'e / sigma^2            and of n tests together the n-th part of it

The test restarts after an alarm, after a stop, and when the motion changes: drag depends on its direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_each_not_negative, require_each_positive
from ohmward.filters.sanitize import some
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Scalar, exp, log, logical_not, maximum, minimum, where
from ohmward.traction.motion.sample import LEAST_DIVISOR
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.floor import Floor, drag_columns, mean_load, travel_speed

#: Floors whose drags differ by less count as one floor in this test.
SAME_DRAG = 0.02
#: Share of the difference between two floors that counts: a floor varies from place to place, and a wheel may stand on
#: both.
DIFFERENCE_SHARE = 0.7
#: A motion that differs from that at the start of the test by more than this share of it restarts the test.
_OTHER_MOTION = 0.3
#: Longest time [s] that mu is the mean over, and time that its first value counts for.
MU_MEMORY_S, _FIRST_VALUE_S = 3.0, 0.3
#: Shortest correlation time of the ripple [s]: that of the force filter.
_SHORTEST_RIPPLE_S = 0.1
#: Least change of a drag that counts, share of the load.
_LEAST_DRAG_STEP = 1e-3
_CROSSING_STEPS = 4
#: x a little before the maximum of 1 - e^-x - x/2 at ln 2, and that maximum.
_LAST, _MOST_NEEDED = math.log(2) - 1e-3, 0.5 - math.log(2) / 2


class Crossing(NamedTuple):
    """A wheel, or several, on another floor: time of its detection, and the drag before and after."""

    time_s: float
    drag_before: float
    drag_after: float


class CrossingSample(NamedTuple):
    """Sample of the test."""

    force_share: np.ndarray  #: f (driven,) forces over the mean load
    change: np.ndarray  #: e (driven, wheels) change of f at the smallest change of each wheel's floor that counts
    motion: np.ndarray  #: (freedoms,) of the rims
    moving: Scalar  #: the condition that the wheels turn
    dt_s: Scalar  #: since the previous sample


class CrossingState(NamedTuple):
    """State of the test."""

    sums: np.ndarray  #: (2, wheels) g+, g-
    mean: np.ndarray  #: mu (driven,)
    tested_s: Scalar  #: since the test began, < 0 while it waits
    motion: np.ndarray  #: (freedoms - 1,) at the start of the test, without the rotation


class CrossingResult(NamedTuple):
    """Result of the test for a sample."""

    alarm: Scalar  #: the condition that a wheel has moved to another floor
    restart: Scalar  #: the condition that the test restarts, as the motion has changed or the robot stands
    #: (wheels,) mean time from the crossing of each wheel to its alarm at the present motion; inf while the test waits,
    #: and for a wheel whose floor hardly affects the forces
    delay_s: np.ndarray


class Evidence(NamedTuple):
    """Evidence of a sample."""

    increment: np.ndarray  #: (2, wheels) of g+ and g-
    k2: np.ndarray  #: k^2 (wheels,), square of the signal over the ripple
    tau_s: Scalar  #: correlation time of the ripple


@dataclass(frozen=True)
class CrossingTest:
    """Settings; `init` and `step` are pure functions of them."""

    #: smallest change of the floor under a wheel that counts, share of its load, > 0
    rolling_step: float = 0.07
    roller_step: float = 0.13
    ripple_share: float = 0.018  #: of a wheel's force without drag, share of the mean load, > 0
    ripple_growth: float = 0.05  #: of the ripple with the forces, >= 0
    ripple_m: float = 0.03  #: distance that a ripple lasts, about the passage of a roller, > 0
    #: of driving, all wheels and both ways together, > 0, if the ripple were as assumed
    false_alarms_per_hour: float = 1.0
    settling_s: float = 1.2  #: time after a start in which nothing is tested, >= 0: the robot accelerates

    def __post_init__(self) -> None:
        require_each_positive(
            "", self, "rolling_step", "roller_step", "ripple_share", "ripple_m", "false_alarms_per_hour"
        )
        require_each_not_negative("", self, "ripple_growth", "settling_s")

    def init(self, robot: Robot) -> CrossingState:
        """State before the first sample."""
        wheels = len(robot.places)
        return CrossingState(np.zeros((2, wheels)), np.zeros(robot.driven), 0.0, np.zeros(robot.freedoms - 1))

    def sample(
        self, robot: Robot, motion: np.ndarray, force_N: np.ndarray, moving: Scalar, dt_s: Scalar
    ) -> CrossingSample:
        """Sample of the test from forces (driven,) at a motion (freedoms,) of the rims."""
        load_N = mean_load(robot)
        change = drag_columns(robot, motion) @ np.array([self.rolling_step, self.roller_step]) / load_N
        return CrossingSample(force_N / load_N, change, motion, moving, dt_s)

    def step(self, state: CrossingState, sample: CrossingSample) -> tuple[CrossingState, CrossingResult]:
        """State and result after a sample."""
        # even after a gap, a sample counts for no more than the memory of the force filter
        sample = sample._replace(dt_s=minimum(sample.dt_s, _SHORTEST_RIPPLE_S))
        force, motion = sample.force_share, sample.motion[:-1]
        restart = logical_not(sample.moving) | is_other_motion(motion, state.motion)
        tested_s = state.tested_s + sample.dt_s
        settling = restart | (tested_s < 0)

        evidence = self.evidence(state, sample)
        sums = maximum(0.0, state.sums + evidence.increment)
        threshold = self.threshold(evidence.k2, evidence.tau_s)
        delay_s = self.delay_s(evidence.k2, evidence.tau_s, memory(state.tested_s))
        exceeds = [g > h for row in sums for g, h in zip(row, threshold, strict=True)]
        alarm = logical_not(settling) & some(exceeds)

        first_share = minimum(0.5 * sample.dt_s / _FIRST_VALUE_S, 1.0)
        share = where(settling, first_share, minimum(sample.dt_s / memory(tested_s), 1.0))
        after = CrossingState(
            sums=where(settling | alarm, 0.0, sums),
            mean=where(restart | alarm, force, state.mean + share * (force - state.mean)),
            tested_s=where(restart, -self.settling_s, where(alarm, 0.0, tested_s)),
            motion=where(settling | alarm, motion, state.motion),
        )
        return after, CrossingResult(alarm, restart, where(settling, math.inf, delay_s))

    def evidence(self, state: CrossingState, sample: CrossingSample) -> Evidence:
        """Increments (dt/tau) (+-e' (f - mu) - e'e / 2) / sigma^2 of the sums."""
        e = sample.change
        tau_s = maximum(self.ripple_m / maximum(travel_speed(sample.motion), LEAST_DIVISOR), _SHORTEST_RIPPLE_S)
        variance = self.ripple_share**2 + self.ripple_growth**2 * (state.mean @ state.mean)
        k2 = (e * e).sum(axis=0) / variance
        seen = (sample.force_share - state.mean) @ e / variance
        increment = sample.dt_s / tau_s * (np.stack([seen, -seen]) - k2 / 2)
        return Evidence(increment, k2, tau_s)

    def threshold(self, k2: np.ndarray, tau_s: Scalar) -> np.ndarray:
        """Threshold h (n,) of each of n changes, tested both ways: h = ln(T k^2/(2 tau) + 1 + h), by Newton."""
        between_s = SECONDS_PER_HOUR / self.false_alarms_per_hour * 2 * len(k2)
        wanted = k2 * (between_s / (2 * tau_s))
        h = log(wanted + 2.0)
        for _ in range(_CROSSING_STEPS):
            inside = wanted + 1.0 + h
            h = h - (h - log(inside)) / (1.0 - 1.0 / maximum(inside, 1.0 + LEAST_DIVISOR))
        return h

    def delay_s(self, k2: np.ndarray, tau_s: Scalar, memory_s: Scalar) -> np.ndarray:
        """Mean time (n,) [s] from a change that counts to its alarm; inf if mu follows it first.

        Siegmund's (2 tau / k^2)(e^-h + h - 1) holds for a known mu. A mean over T = `memory_s` follows the change: the
        sum grows by (k^2 / tau)(e^(-t/T) - 1/2), so the alarm comes at x = t/T with

            1 - e^-x - x/2 = (tau / (T k^2)) (e^-h + h - 1)
        """
        h = self.threshold(k2, tau_s)
        needed = tau_s / memory_s / maximum(k2, LEAST_DIVISOR) * (exp(-h) + h - 1.0)
        possible = np.array([n < _MOST_NEEDED for n in needed])
        return where(possible, memory_s * time_of_alarm(needed), math.inf)


def time_of_alarm(needed: np.ndarray) -> np.ndarray:
    """Smaller root x (n,) of 1 - e^-x - x/2 = needed, by Newton from below; at most `_LAST`."""
    x = minimum(2.0 * needed, _LAST)
    for _ in range(_CROSSING_STEPS):
        x = minimum(x + (needed - 1.0 + exp(-x) + x / 2) / (exp(-x) - 0.5), _LAST)
    return x


def is_other_motion(motion: np.ndarray, tested: np.ndarray) -> Scalar:
    """True where a motion differs too much from the one at the start of the test."""
    change = motion - tested
    return change @ change > _OTHER_MOTION**2 * (tested @ tested)


def memory(tested_s: Scalar) -> Scalar:
    """Time [s] over which mu is the mean."""
    return minimum(maximum(tested_s, 0.0), MU_MEMORY_S) + _FIRST_VALUE_S


def crossing_test(floors: Sequence[Floor]) -> CrossingTest:
    """The test for a robot that knows these floors: the difference of the nearest two sets the change that counts."""
    pairs = pairwise(sorted(floors, key=lambda f: f.drag))
    different = [(a, b) for a, b in pairs if b.drag - a.drag > SAME_DRAG]
    if not different:
        return CrossingTest()
    a, b = min(different, key=lambda pair: pair[1].drag - pair[0].drag)
    rolling = max(DIFFERENCE_SHARE * abs(b.rolling - a.rolling), _LEAST_DRAG_STEP)
    roller = max(DIFFERENCE_SHARE * abs(b.roller - a.roller), _LEAST_DRAG_STEP)
    return CrossingTest(rolling, roller)
