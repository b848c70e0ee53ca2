"""When a wheel comes to another floor: Page's CUSUM test on the drag of the whole robot, both ways.

    g+ = max(0, g+ + (dt/tau) (step/sigma^2) (delta - mu - step/2)),   g- likewise with mu - delta
    sigma^2 = ripple^2 + (growth mu)^2

delta is the share of its weight that the robot needs to keep moving, mu its mean since the last change, step the
smallest change that counts, sigma its ripple from rollers and currents, which lasts tau. An alarm is g > h; h follows
from how often it may be false. For Brownian motion the mean time between false alarms is (Page 1954, Siegmund 1985)

    T = (2 tau / k^2) (e^h - h - 1),   k = step/ripple              and half of it for both ways together

The test starts anew after an alarm, after a stop, and where the motion changes: drag depends on its direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.traction.floors.demand import drag_share
from ohmward.traction.floors.floor import Floor
from ohmward.traction.robot import Robot

#: Smallest change that counts, ripple and its growth with the drag, where no floors are known; shares of the weight.
STEP, RIPPLE, GROWTH = 0.05, 0.01, 0.07
#: Floors whose drags differ less are one floor to this test.
ALIKE = 0.02
#: A motion that differs from that at the start of the test by more than this share of it starts it anew.
_OTHER_MOTION = 0.3
#: mu is the mean over at most so long [s], and its first value counts for so long.
_MEMORY_S, _FIRST_S = 3.0, 0.3


class Crossing(NamedTuple):
    """A wheel has come to another floor, or several have: when it was known, and the drag before and after."""

    time_s: float
    drag_before: float
    drag_after: float


class CrossingState(NamedTuple):
    """The test so far.

    rose, fell: g+, g-.
    mean: mu.
    tested_s: since the test began, < 0 while it waits.
    motion: (freedoms - 1,) then, without the rotation.
    """

    rose: float
    fell: float
    mean: float
    tested_s: float
    motion: np.ndarray


@dataclass(frozen=True)
class CrossingTest:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        step_share: smallest change of the drag that counts, share of the weight, > 0.
        ripple_share: of the drag on a floor without drag, share of the weight, > 0.
        ripple_growth: of the ripple with the drag, >= 0.
        ripple_s: tau, > 0.
        false_alarms_per_hour: of driving, both ways together, > 0, if the ripple were as assumed.
        settling_s: so long after a start nothing is tested, >= 0: the robot accelerates.
    """

    step_share: float = STEP
    ripple_share: float = RIPPLE
    ripple_growth: float = GROWTH
    ripple_s: float = 0.3
    false_alarms_per_hour: float = 1.0
    settling_s: float = 0.8

    def __post_init__(self) -> None:
        for name in ("step_share", "ripple_share", "ripple_s", "false_alarms_per_hour"):
            require_positive(name, getattr(self, name))
        for name in ("ripple_growth", "settling_s"):
            require_between(name, getattr(self, name), 0.0, math.inf)

    @cached_property
    def threshold(self) -> float:
        """h, by Newton's method on e^h - h - 1 = T k^2 / (2 tau)."""
        k = self.step_share / self.ripple_share
        wanted = 2 * 3600 / self.false_alarms_per_hour * k * k / (2 * self.ripple_s)
        h = math.log(wanted + 2)
        for _ in range(50):
            h -= (math.exp(h) - h - 1 - wanted) / (math.exp(h) - 1)
        return h

    def init(self, freedoms: int) -> CrossingState:
        """Before the first sample."""
        return CrossingState(0.0, 0.0, 0.0, 0.0, np.zeros(freedoms - 1))

    def step(
        self, state: CrossingState, drag: float, motion: np.ndarray, moving: bool, dt_s: float
    ) -> tuple[CrossingState, Crossing | None]:
        """The state after a sample, and the alarm where it raises one, its time counted from this sample.

        Args:
            state: before the sample.
            drag: share of the weight, see `demand.drag_share`.
            motion: (freedoms,) of the rims.
            moving: whether the wheels turn.
            dt_s: since the sample before.
        """
        motion = np.array(motion[:-1])
        change = np.linalg.norm(motion - state.motion)
        if not moving or change > _OTHER_MOTION * np.linalg.norm(state.motion):
            return CrossingState(0.0, 0.0, drag, -self.settling_s, motion), None
        excess, tested_s = drag - state.mean, state.tested_s + dt_s
        if tested_s < 0:
            mean = state.mean + min(0.5 * dt_s / _FIRST_S, 1.0) * excess
            return CrossingState(0.0, 0.0, mean, tested_s, motion), None
        rose, fell = (
            self._raised(state.rose, state.mean, excess, dt_s),
            self._raised(state.fell, state.mean, -excess, dt_s),
        )
        if max(rose, fell) > self.threshold:
            return CrossingState(0.0, 0.0, drag, 0.0, motion), Crossing(0.0, state.mean, drag)
        mean = state.mean + dt_s / (min(tested_s, _MEMORY_S) + _FIRST_S) * excess
        return CrossingState(rose, fell, mean, tested_s, state.motion), None

    def run(
        self, robot: Robot, time_s: np.ndarray, motion: np.ndarray, force_N: np.ndarray, moving: np.ndarray
    ) -> list[Crossing]:
        """All alarms of a drive, from motion (T, freedoms), forces (T, driven) and whether the wheels turn (T,)."""
        state, found = self.init(motion.shape[1]), []
        drag, dt_s = drag_share(robot, motion, force_N), np.diff(time_s, prepend=time_s[0])
        for k, t in enumerate(time_s):
            state, crossing = self.step(state, float(drag[k]), motion[k], bool(moving[k]), float(dt_s[k]))
            if crossing:
                found.append(crossing._replace(time_s=float(t)))
        return found

    def _raised(self, g: float, mean: float, excess: float, dt_s: float) -> float:
        variance = self.ripple_share**2 + (self.ripple_growth * mean) ** 2
        return max(0.0, g + dt_s / self.ripple_s * self.step_share / variance * (excess - self.step_share / 2))


def crossing_test(robot: Robot, floors: Sequence[Floor], false_alarms_per_hour: float = 1.0) -> CrossingTest:
    """The test for a robot that knows these floors: what counts is the change of its lightest wheel."""
    apart = np.diff(np.sort([f.drag for f in floors]))
    apart = apart[apart > ALIKE]
    step = float(apart.min() * robot.loads[:, 0].min()) if len(apart) else STEP
    return CrossingTest(step_share=step, false_alarms_per_hour=false_alarms_per_hour)
