"""Which floor is under which wheel, from the forces that the wheels need: Bayes' rule on every combination.

    P(c | F_1..k)  ~  p(F_k | c)^(dt/tau)  *  [ (1 - h dt) P(c) + h dt (others) ]

A combination c names a floor for each wheel; h is how often a wheel meets another floor. Given c, the forces are those
of `demand` within what the floors leave open. These errors are not white (rollers, floors that differ from place to
place), so a sample counts for the share dt / tau of an observation.

One of the floors is one that was never met, wide in all it asks for: what fits no known floor goes there. Robots that
cannot tell their wheels apart by their forces have one floor under all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.traction.floors.demand import drag_columns, inertial_forces, static_loads
from ohmward.traction.floors.floor import Floor, unseen_floor
from ohmward.traction.robot import Robot

#: More combinations than this are refused: every sample weighs each of them.
MOST_COMBINATIONS = 1000
#: Before anything is measured: a floor that was never met against a known one, and several floors against one.
UNSEEN_SHARE, MIXED_SHARE = 0.01, 0.1


@dataclass(frozen=True, eq=False)
class Recognition:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        robot: calibrated.
        floors: that it has learnt, each with its own name.
        crossing_rate: h, how often a wheel meets another floor [1/s].
        correlation_s: tau, how long what the floors leave unexplained lasts.
    """

    robot: Robot
    floors: Sequence[Floor] = ()
    crossing_rate: float = 0.1
    correlation_s: float = 0.3

    def __post_init__(self) -> None:
        require_positive("crossing_rate", self.crossing_rate)
        require_positive("correlation_s", self.correlation_s)
        if len(set(self.names)) < len(self.names):
            raise InputError(f"floors must have different names, and none may be 'unseen'; got {', '.join(self.names)}")
        if len(self.combinations) > MOST_COMBINATIONS:
            raise InputError(
                f"{len(self.floors)} floors under {len(self.robot.places)} wheels are {len(self.combinations)} "
                f"combinations, more than {MOST_COMBINATIONS}; name fewer floors"
            )

    @cached_property
    def all_floors(self) -> tuple[Floor, ...]:
        """The floors, and last one that was never met."""
        return (*self.floors, unseen_floor(self.floors))

    @property
    def names(self) -> tuple[str, ...]:
        """Of all floors."""
        return tuple(f.name for f in self.all_floors)

    @cached_property
    def combinations(self) -> np.ndarray:
        """(C, wheels) number of the floor under each wheel."""
        count, wheels = len(self.floors) + 1, len(self.robot.places)
        if self.robot.freedoms == self.robot.driven == wheels:
            return np.array(list(product(range(count), repeat=wheels)))
        return np.repeat(np.arange(count)[:, None], wheels, axis=1)

    @cached_property
    def changes(self) -> np.ndarray:
        """(C, C) share of a changing belief that each combination takes over: one wheel after the other."""
        c = self.combinations
        apart = (c[:, None] != c[None]).sum(axis=-1)
        near = (apart == apart[apart > 0].min()) * self.likeness if len(c) > 1 else np.ones((1, 1))
        return near / near.sum(axis=1, keepdims=True)

    @cached_property
    def likeness(self) -> np.ndarray:
        """Weight (C,) of each combination before anything is measured: known floors are likelier than one never met."""
        share = np.append(np.ones(len(self.floors)), UNSEEN_SHARE if self.floors else 1.0)
        return np.prod(share[self.combinations], axis=1)

    def init(self) -> np.ndarray:
        """Belief (C,) before the first sample: more likely one floor under all wheels than several."""
        same = (self.combinations == self.combinations[:, :1]).all(axis=1)
        belief = self.likeness * np.where(same, 1.0, MIXED_SHARE)
        return belief / belief.sum()

    def step(self, belief: np.ndarray, log_likelihood: np.ndarray, dt_s: float) -> np.ndarray:
        """Belief (C,) after a sample in which the combinations have this log-likelihood (C,)."""
        change = 1.0 - np.exp(-self.crossing_rate * dt_s)
        prior = (1 - change) * belief + change * belief @ self.changes
        weighed = np.log(np.maximum(prior, 1e-300)) + min(dt_s / self.correlation_s, 1.0) * log_likelihood
        after = np.exp(weighed - weighed.max())
        return after / after.sum()

    def log_likelihood(
        self, motion: np.ndarray, acceleration: np.ndarray, force_N: np.ndarray, force_std_N: np.ndarray
    ) -> np.ndarray:
        """Logarithm of p(F | c) (T, C) of forces (T, driven) while the body moves so, (T, freedoms)."""
        columns = drag_columns(self.robot, motion)
        rest = force_N - inertial_forces(self.robot, acceleration)
        load_N = float(static_loads(self.robot)[: self.robot.driven].mean())
        found = np.empty((len(motion), len(self.combinations)))
        for k, chosen in enumerate([[self.all_floors[i] for i in row] for row in self.combinations]):
            shares = np.array([[f.rolling, f.roller] for f in chosen])
            by_wheel = np.einsum("tdws,ws->tdw", columns, shares)
            drag_std = np.array([f.drag_std for f in chosen])
            off = by_wheel * drag_std
            own = (load_N * max(f.force_std for f in chosen)) ** 2 + force_std_N**2
            S = off @ off.transpose(0, 2, 1) + own[:, :, None] * np.eye(own.shape[1])
            found[:, k] = _log_density(rest - by_wheel.sum(axis=-1), S)
        return found

    def by_wheel(self, belief: np.ndarray) -> np.ndarray:
        """Probability (..., wheels, floors) of each floor under each wheel."""
        marks = self.combinations[:, :, None] == np.arange(len(self.all_floors))
        return np.einsum("...c,cwf->...wf", belief, marks.astype(float))


def _log_density(error: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Logarithm of the normal density (T,) of errors (T, n) with covariance (T, n, n)."""
    factor = np.linalg.cholesky(S)
    white = np.linalg.solve(factor, error[..., None])[..., 0]
    return -0.5 * np.sum(white**2, axis=-1) - np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=-1)
