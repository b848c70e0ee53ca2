"""Recognition of the floor under each wheel from the forces that the wheels need: Bayes' rule on every combination.

    P(c | F_1..k)  ~  p(F_k | c)^(dt/tau)  *  [ (1 - h dt) P(c) + h dt (others) ]

A combination c names a floor for each wheel; h is how often a wheel meets another floor. Given c, the forces are those
of `demand` to within the uncertainty of the floors. These errors are not white (rollers, floors that differ from place
to place), so a sample counts for the share dt / tau of an observation.

One of the floors is one that was never met, with a wide range of forces: forces that fit no known floor go there.
Robots that cannot tell their wheels apart by their forces have one floor under all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import product

import numpy as np

from ohmward.checks import require_each_positive
from ohmward.errors import InputError
from ohmward.filters.linear_algebra import cholesky, solve_lower
from ohmward.trace import exp, log, maximum, minimum
from ohmward.trace.expression import Scalar
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.demand import drag_columns, inertial_forces, mean_load
from ohmward.traction.terrain.floor import Floor, unseen_floor

#: More combinations than this are refused: every sample weighs each of them.
MOST_COMBINATIONS = 1000
#: Prior odds of a floor that was never met against a known one, and of several floors against one.
UNSEEN_SHARE, MIXED_SHARE = 0.01, 0.1
#: Least probability of a combination: one that was excluded can come back.
_LEAST = 1e-30


@dataclass(frozen=True, eq=False)
class Recognition:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        robot: calibrated.
        floors: that it has learnt, each with its own name.
        crossing_rate: h, rate at which a wheel meets another floor [1/s].
        correlation_s: tau, correlation time of the forces that the floors leave unexplained.
    """

    robot: Robot
    floors: Sequence[Floor] = ()
    crossing_rate: float = 0.1
    correlation_s: float = 0.3

    def __post_init__(self) -> None:
        require_each_positive("", self, "crossing_rate", "correlation_s")
        if len(set(self.names)) < len(self.names):
            raise InputError(f"floors must have different names, and none may be 'unseen'; got {', '.join(self.names)}")
        if len(self.combinations) > MOST_COMBINATIONS:
            raise InputError(
                f"{len(self.floors)} floors under {len(self.robot.places)} wheels are {len(self.combinations)} "
                f"combinations, more than {MOST_COMBINATIONS}; name fewer floors"
            )

    @cached_property
    def all_floors(self) -> tuple[Floor, ...]:
        """The floors, and last the one that was never met."""
        return (*self.floors, unseen_floor(self.floors))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all floors."""
        return tuple(f.name for f in self.all_floors)

    @cached_property
    def combinations(self) -> np.ndarray:
        """Number (C, wheels) of the floor under each wheel."""
        count, wheels = len(self.floors) + 1, len(self.robot.places)
        if self.robot.freedoms == self.robot.driven == wheels:
            return np.array(list(product(range(count), repeat=wheels)))
        return np.repeat(np.arange(count)[:, None], wheels, axis=1)

    @cached_property
    def changes(self) -> np.ndarray:
        """Transition matrix (C, C) of a change: one wheel meets another floor."""
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
        """Belief (C,) before the first sample: one floor under all wheels is likelier than several."""
        same = (self.combinations == self.combinations[:, :1]).all(axis=1)
        belief = self.likeness * np.where(same, 1.0, MIXED_SHARE)
        return belief / belief.sum()

    def step(self, belief: np.ndarray, log_likelihood: np.ndarray, dt_s: Scalar) -> np.ndarray:
        """Belief (C,) after a sample in which the combinations have this log-likelihood (C,)."""
        change = 1.0 - exp(-self.crossing_rate * dt_s)
        prior = (1.0 - change) * belief + change * self.changed(belief)
        counts = minimum(dt_s / self.correlation_s, 1.0)
        log_posterior = log(maximum(prior, _LEAST)) + counts * log_likelihood
        posterior = exp(log_posterior - reduce(maximum, log_posterior))
        return posterior * (1.0 / posterior.sum())

    def changed(self, belief: np.ndarray) -> np.ndarray:
        """Belief (C,) after one wheel has met another floor."""
        return np.array([sparse_dot(shares, belief) for shares in self.changes.T])

    def log_likelihood(
        self, motion: np.ndarray, acceleration: np.ndarray, force_N: np.ndarray, force_std_N: np.ndarray
    ) -> np.ndarray:
        """Logarithm of p(F | c) (C,) of forces (driven,) while the body moves so, (freedoms,).

        With the drag d_w of the floor under wheel w, and the inertial forces F_a:

            F - F_a ~ N(sum_w d_w, sum_w drag_std^2 d_w d_w' + diag(own variances))
        """
        columns = drag_columns(self.robot, motion)
        drag_N = force_N - inertial_forces(self.robot, acceleration)
        drags = [columns @ np.array([f.rolling, f.roller]) for f in self.all_floors]
        covs = [outer_squares(f.drag_std * drag) for f, drag in zip(self.all_floors, drags, strict=True)]
        found = []
        for combination in self.combinations:
            under = list(enumerate(combination))
            mean = sum(drags[floor][:, wheel] for wheel, floor in under)
            own_N = mean_load(self.robot) * max(self.all_floors[floor].force_std for floor in combination)
            S = sum(covs[floor][wheel] for wheel, floor in under) + np.diag(own_N**2 + force_std_N**2)
            found.append(log_density(drag_N - mean, S))
        return np.array(found)

    def by_wheel(self, belief: np.ndarray) -> np.ndarray:
        """Probability (wheels, floors) of each floor under each wheel."""
        floors = range(len(self.all_floors))
        return np.array([[belief[under == floor].sum() for floor in floors] for under in self.combinations.T])


def sparse_dot(weights: np.ndarray, values: np.ndarray) -> Scalar:
    """Product of weights (n,), of which most are 0, and traced values (n,)."""
    used = np.flatnonzero(weights)
    return values[used] @ weights[used]


def outer_squares(columns: np.ndarray) -> list[np.ndarray]:
    """Outer product (n, n) of each column of (n, wheels) with itself."""
    return [np.outer(column, column) for column in columns.T]


def log_density(error: np.ndarray, S: np.ndarray) -> Scalar:
    """Logarithm of the normal density of an error (n,) with covariance (n, n), without its constant."""
    factor, _ = cholesky(S)
    white = solve_lower(factor, error)
    return -0.5 * (white @ white) - log(np.prod(np.diag(factor)))
