"""When a wheel comes to another floor: Page's CUSUM test on the forces of the wheels, one for each wheel and both ways.

    g+ = max(0, g+ + (dt/tau) e' (f - mu - e/2) / sigma^2),          g- likewise with mu - f
    sigma^2 = ripple^2 + (growth |mu|)^2,   tau = ripple_m / speed

f are the forces of the driven wheels over their mean load, mu their mean since the last change, e what they change by
when the floor under one wheel does (`demand`): it depends on the direction of the motion, and tells a crossing from the
ripple of the rollers, which goes with the way and not with the time. An alarm is g > h; h follows from how often it may
be false. For Brownian motion the mean time between false alarms of one test is (Page 1954, Siegmund 1985)

    T = (2 tau / k^2) (e^h - h - 1),   k^2 = e'e / sigma^2            and of n tests together the n-th part of it

The test starts anew after an alarm, after a stop, and where the motion changes: drag depends on its direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.traction.floors.demand import drag_columns, drag_share, static_loads
from ohmward.traction.floors.floor import Floor
from ohmward.traction.robot import Robot

#: Floors whose drags differ less are one floor to this test.
ALIKE = 0.02
#: Of the difference between two floors: a floor differs from place to place, and a wheel may stand on both.
COUNTS = 0.7
#: A motion that differs from that at the start of the test by more than this share of it starts it anew.
_OTHER_MOTION = 0.3
#: mu is the mean over at most so long [s], and its first value counts for so long.
_MEMORY_S, _FIRST_S = 3.0, 0.3
#: Ripple lasts no shorter than this [s]: the filter of the forces.
_SHORTEST_S = 0.1


class Crossing(NamedTuple):
    """A wheel has come to another floor, or several have: when it was known, and the drag before and after."""

    time_s: float
    drag_before: float
    drag_after: float


class CrossingSample(NamedTuple):
    """What the test sees at one time.

    force_share: (driven,) forces over the mean load.
    change: (driven, wheels) of these when the floor under each wheel changes by as much as counts.
    motion: (freedoms,) of the rims.
    moving: whether the wheels turn.
    dt_s: since the sample before.
    """

    force_share: np.ndarray
    change: np.ndarray
    motion: np.ndarray
    moving: bool
    dt_s: float


class CrossingState(NamedTuple):
    """The test so far.

    sums: (2, wheels) g+, g-.
    mean: (driven,) mu.
    tested_s: since the test began, < 0 while it waits.
    motion: (freedoms - 1,) then, without the rotation.
    """

    sums: np.ndarray
    mean: np.ndarray
    tested_s: float
    motion: np.ndarray


@dataclass(frozen=True)
class CrossingTest:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        rolling_step, roller_step: smallest change of the floor under a wheel that counts, share of its load, > 0.
        ripple_share: of a wheel's force without drag, share of the mean load, > 0.
        ripple_growth: of the ripple with the forces, >= 0.
        ripple_m: way that a ripple lasts, about the passage of a roller, > 0.
        false_alarms_per_hour: of driving, all wheels and both ways together, > 0, if the ripple were as assumed.
        settling_s: so long after a start nothing is tested, >= 0: the robot accelerates.
    """

    rolling_step: float = 0.07
    roller_step: float = 0.13
    ripple_share: float = 0.018
    ripple_growth: float = 0.05
    ripple_m: float = 0.03
    false_alarms_per_hour: float = 1.0
    settling_s: float = 1.2

    def __post_init__(self) -> None:
        for name in ("rolling_step", "roller_step", "ripple_share", "ripple_m", "false_alarms_per_hour"):
            require_positive(name, getattr(self, name))
        for name in ("ripple_growth", "settling_s"):
            require_between(name, getattr(self, name), 0.0, math.inf)

    def threshold(self, k2: np.ndarray, tau_s: float) -> np.ndarray:
        """Each h (n,) of n changes with these k^2 (n,), tested both ways: h = ln(T k^2/(2 tau) + 1 + h), iterated."""
        between_s = 3600 / self.false_alarms_per_hour * 2 * len(k2)
        wanted = between_s * k2 / (2 * tau_s)
        h = np.log(wanted + 2)
        for _ in range(10):
            h = np.log(wanted + 1 + h)
        return h

    def init(self, robot: Robot) -> CrossingState:
        """Before the first sample."""
        wheels = len(robot.places)
        return CrossingState(np.zeros((2, wheels)), np.zeros(robot.driven), 0.0, np.zeros(robot.freedoms - 1))

    def step(self, state: CrossingState, sample: CrossingSample) -> tuple[CrossingState, bool]:
        """The state after a sample, and whether it raises an alarm."""
        force, motion, none = sample.force_share, sample.motion[:-1], np.zeros_like(state.sums)
        change = np.linalg.norm(motion - state.motion)
        if not sample.moving or change > _OTHER_MOTION * np.linalg.norm(state.motion):
            return CrossingState(none, force, -self.settling_s, motion), False
        excess, tested_s = force - state.mean, state.tested_s + sample.dt_s
        if tested_s < 0:
            mean = state.mean + min(0.5 * sample.dt_s / _FIRST_S, 1.0) * excess
            return CrossingState(none, mean, tested_s, motion), False
        sums, threshold = self._raised(state, sample)
        if (sums > threshold).any():
            return CrossingState(none, force, 0.0, motion), True
        mean = state.mean + sample.dt_s / (min(tested_s, _MEMORY_S) + _FIRST_S) * excess
        return CrossingState(sums, mean, tested_s, state.motion), False

    def run(
        self, robot: Robot, time_s: np.ndarray, motion: np.ndarray, force_N: np.ndarray, moving: np.ndarray
    ) -> list[Crossing]:
        """All alarms of a drive, from motion (T, freedoms), forces (T, driven) and whether the wheels turn (T,)."""
        state, found = self.init(robot), []
        load_N = static_loads(robot)[: robot.driven].mean()
        change = drag_columns(robot, motion) @ np.array([self.rolling_step, self.roller_step]) / load_N
        dt_s = np.diff(time_s, prepend=time_s[0])
        for k, t in enumerate(time_s):
            before = state
            sample = CrossingSample(force_N[k] / load_N, change[k], motion[k], bool(moving[k]), float(dt_s[k]))
            state, crossed = self.step(state, sample)
            if crossed:
                drag = (drag_share(robot, motion[k], force) for force in (before.mean * load_N, force_N[k]))
                found.append(Crossing(float(t), *(float(d) for d in drag)))
        return found

    def _raised(self, state: CrossingState, sample: CrossingSample) -> tuple[np.ndarray, np.ndarray]:
        """The sums (2, wheels) after a sample, and the threshold (wheels,) of each."""
        e, speed = sample.change, float(np.linalg.norm(sample.motion[:-1]))
        tau_s = max(self.ripple_m / speed, _SHORTEST_S)
        variance = self.ripple_share**2 + self.ripple_growth**2 * (state.mean @ state.mean)
        k2, seen = np.sum(e * e, axis=0) / variance, (sample.force_share - state.mean) @ e / variance
        gain = sample.dt_s / tau_s * (np.stack([seen, -seen]) - k2 / 2)
        return np.maximum(0.0, state.sums + gain), self.threshold(k2, tau_s)


def crossing_test(floors: Sequence[Floor], false_alarms_per_hour: float = 1.0) -> CrossingTest:
    """The test for a robot that knows these floors: what counts is the difference of the two that are nearest."""
    pairs = pairwise(sorted(floors, key=lambda f: f.drag))
    apart = [(b.drag - a.drag, a, b) for a, b in pairs if b.drag - a.drag > ALIKE]
    if not apart:
        return CrossingTest(false_alarms_per_hour=false_alarms_per_hour)
    _, a, b = min(apart, key=lambda pair: pair[0])
    rolling, roller = (max(COUNTS * abs(y - x), 1e-3) for x, y in ((a.rolling, b.rolling), (a.roller, b.roller)))
    return CrossingTest(rolling, roller, false_alarms_per_hour=false_alarms_per_hour)
