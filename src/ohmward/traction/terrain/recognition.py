"""Recognition of the floor under each wheel from the forces that the wheels need: Bayes' rule on every combination.

    P(c | F)  ~  N(mean F; sum_w d_cw, S_c(T)) P(c),   S_c(T) = drag's own + sigma^2 [ b + (1 - b) tau / T ] + sensor's

A combination c names a floor for each wheel. Given c, the forces are those of `drag_columns` to within the uncertainty
of the floors. F is their mean over the time T since the last event: a start, a change of motion, a crossing. A share b
of the variance that the floors leave unexplained lasts as long as the motion stays the same (the drag model is simple),
so more samples of one motion soon add nothing: evidence is not the sum over the samples. At an event the posterior
becomes the next prior; between events the prior is forgotten at the rate of crossings.

Similar forces do not mean similar slip: for each known floor there is a new one that needs similar forces, and last
comes any other new floor. Robots whose forces do not distinguish their wheels have one floor under all of them.

An outside speed shows slip, so it is evidence too: GNSS, visual or lidar odometry, optical flow.

    l = (w_x - v_x) / u = b' lambda,    b the forward row of G_d^+, u the travel speed of the rims

The loss l is averaged since the last event. Errors of the speed partly last from sample to sample, so the mean of n
speeds of variance r has more than r / n:

    var l = r (s + (1 - s) / n) / u^2

Each combination of floors predicts l = b' m with variance b' C b, and is weighted by the normal density of the measured
one. The slip of the wheels is then corrected by it, as in a Kalman filter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_each_positive
from ohmward.errors import InputError
from ohmward.filters.linear_algebra import cholesky, solve_lower
from ohmward.filters.sanitize import every, some
from ohmward.trace import Scalar, exp, isfinite, log, logical_not, maximum, minimum, where
from ohmward.traction.motion.outside_speed import ASSUMED_STD_M_S
from ohmward.traction.motion.sample import LEAST_DIVISOR, CleanSample
from ohmward.traction.robot.robot import Robot
from ohmward.traction.terrain.crossing import MU_MEMORY_S
from ohmward.traction.terrain.floor import Floor, SlipBelief, drag_columns, like, mean_load, new_floor

#: Largest number of combinations: every sample weighs each of them.
MOST_COMBINATIONS = 1000
#: Prior odds of a new floor against a known one: a robot comes to new floors as often as to each known one. With 0.5, a
#: carpet left out of three floors was covered by the band in 63 % of its runs, with 1 in all.
NEW_FLOOR_ODDS = 1.0
#: Share of the time in which the wheels are on several floors: a robot's length over some metres of a floor.
MIXED_SHARE = 0.05
#: Share of new floors that need about the forces of a known one; the rest may need any. The carpets of the three
#: campaigns with Robotino do (0.21 to 0.25 of the weight), with slips of 0.2 to 0.5.
LIKE_SHARE = 0.8
#: Settling time [s] of the forces after a start: the filter's force begins at 0, and bodies and rollers accelerate.
#: Then they are averaged over at most `MU_MEMORY_S`, so that a missed crossing is forgotten.
SETTLING_S = 0.5
#: b. The mean force of a run is off by 0.03 of the load, most of it from the spread of a floor's drag.
PERSISTENT_SHARE = 0.1
#: Approximate share of true alarms of the crossing test, for a robot that crosses every few minutes.
RIGHT_SHARE = 0.5
#: Smallest probability of a combination: an excluded one can return.
_LEAST_PROBABILITY = 1e-30


class FloorForces(NamedTuple):
    """Forces of the wheels at a sample."""

    motion: np.ndarray  #: (freedoms,) of the rims
    drag_N: np.ndarray  #: (driven,) without the inertial forces
    noise_N: np.ndarray  #: (driven,) standard deviation of the filter
    friction_N: np.ndarray  #: (driven,) standard deviation of the forces that the friction of standing motors may hold


class RecognitionState(NamedTuple):
    """State from sample to sample."""

    #: (C,) probability of the combinations, before and after the forces since the last event
    prior: np.ndarray
    combinations: np.ndarray
    mean_N: np.ndarray  #: (driven,) mean of these forces
    averaged_s: Scalar  #: time that the mean covers, < 0 while the forces settle after a start


@dataclass(frozen=True, eq=False)
class Recognition:
    """Settings; `init` and `step` are pure functions of them."""

    robot: Robot  #: calibrated
    floors: Sequence[Floor] = ()  #: that it has learnt, each with its own name
    known_only: bool = False  #: the robot drives on these floors only
    crossing_rate: float = 0.1  #: rate at which a wheel meets another floor [1/s]
    correlation_s: float = 0.3  #: tau, correlation time of the varying part of the unexplained forces

    def __post_init__(self) -> None:
        require_each_positive("", self, "crossing_rate", "correlation_s")
        if self.known_only and not self.floors:
            raise InputError("known_only needs the floors that the robot drives on; floors is empty")
        if len(set(self.names)) < len(self.names):
            raise InputError(f"floors must have different names, and none may be 'unseen'; got {', '.join(self.names)}")
        if len(self.combinations) > MOST_COMBINATIONS:
            raise InputError(
                f"{len(self.floors)} floors under {len(self.robot.places)} wheels are {len(self.combinations)} "
                f"combinations, more than {MOST_COMBINATIONS}; name fewer floors"
            )

    @cached_property
    def all_floors(self) -> tuple[Floor, ...]:
        """The floors; unless `known_only`, also a new one like each of them, and last any new floor."""
        if self.known_only:
            return tuple(self.floors)
        return (*self.floors, *map(like, self.floors), new_floor(self.floors))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the floors, and last the one of all new floors."""
        known = tuple(f.name for f in self.floors)
        return known if self.known_only else (*known, self.all_floors[-1].name)

    @cached_property
    def combinations(self) -> np.ndarray:
        """Index (C, wheels) of the floor under each wheel; first each floor under all of them."""
        count, wheels = len(self.all_floors), len(self.robot.places)
        alike = [(floor,) * wheels for floor in range(count)]
        if not self.robot.freedoms == self.robot.driven == wheels:
            return np.array(alike)
        single = sorted({*range(len(self.floors)), count - 1})
        return np.array([*alike, *(c for c in product(single, repeat=wheels) if len(set(c)) > 1)])

    @cached_property
    def changes(self) -> np.ndarray:
        """Transition matrix (C, C) of a change: one wheel moves to another floor, or all do where one alone cannot."""
        c = self.combinations
        apart = (c[:, None] != c[None]).sum(axis=-1)
        least = np.where(apart > 0, apart, len(self.robot.places)).min(axis=1, keepdims=True)
        near = (apart == least) * self.likeness if len(c) > 1 else np.ones((1, 1))
        return near / near.sum(axis=1, keepdims=True)

    @cached_property
    def likeness(self) -> np.ndarray:
        """Weight (C,) of each combination before anything is measured: known floors are likelier than new ones."""
        known = len(self.floors)
        of_floor = np.ones(max(known, 1))
        if known and not self.known_only:
            like_each = NEW_FLOOR_ODDS * LIKE_SHARE / known
            of_floor = np.repeat([1.0, like_each, NEW_FLOOR_ODDS * (1 - LIKE_SHARE)], [known, known, 1])
        same = (self.combinations == self.combinations[:, :1]).all(axis=1)
        weights = of_floor[self.combinations]
        return np.where(same, weights[:, 0], np.prod(weights, axis=1))

    @cached_property
    def usual(self) -> np.ndarray:
        """Probability (C,) of the combinations before anything is measured: mostly one floor under all wheels."""
        same = (self.combinations == self.combinations[:, :1]).all(axis=1)
        alike, mixed = (self.likeness * part for part in (same, ~same))
        if not mixed.any():
            return alike / alike.sum()
        return (1 - MIXED_SHARE) * alike / alike.sum() + MIXED_SHARE * mixed / mixed.sum()

    def init(self) -> RecognitionState:
        """State before the first sample."""
        return RecognitionState(self.usual, self.usual, np.zeros(self.robot.driven), -SETTLING_S)

    def step(
        self,
        state: RecognitionState,
        forces: FloorForces,
        alarm: Scalar,
        restart: Scalar,
        dt_s: Scalar,
        slip_evidence: Sequence[Scalar] | None = None,
    ) -> RecognitionState:
        """State after a sample.

        alarm: the condition that a wheel has moved to another floor.
        restart: the condition that the motion has changed.
        slip_evidence: (C,) log-likelihood of the slip that outside speeds have shown since the last event.
        """
        mean_N, averaged_s = self.averaged(state, forces.drag_N, alarm, restart, dt_s)
        ended = every([restart, state.averaged_s > 0])
        prior = self.prior(state, alarm, ended, dt_s)
        log_likelihood = self.log_likelihood(forces._replace(drag_N=mean_N), averaged_s)
        if slip_evidence is not None:
            log_likelihood = log_likelihood + np.array(slip_evidence)
        return RecognitionState(prior, self.posterior(prior, log_likelihood), mean_N, averaged_s)

    def averaged(
        self, state: RecognitionState, drag_N: np.ndarray, alarm: Scalar, restart: Scalar, dt_s: Scalar
    ) -> tuple[np.ndarray, Scalar]:
        """Mean of the forces (driven,) and the time that it covers."""
        dt_s = minimum(dt_s, self.correlation_s)  # a sample after a gap counts once
        averaged_s = where(alarm, 0.0, where(restart, -SETTLING_S, minimum(state.averaged_s + dt_s, MU_MEMORY_S)))
        share = where(averaged_s > dt_s, dt_s / maximum(averaged_s, LEAST_DIVISOR), 1.0)
        return state.mean_N + share * (drag_N - state.mean_N), averaged_s

    def prior(self, state: RecognitionState, alarm: Scalar, ended: Scalar, dt_s: Scalar) -> np.ndarray:
        """Probability (C,) of the combinations before the forces since the last event.

        ended: the condition that the motion of the forces before this sample has ended.
        """
        before = state.combinations
        crossed = (1 - RIGHT_SHARE) * before + RIGHT_SHARE * self.changed(before)
        prior = where(alarm, crossed, where(ended, before, state.prior))
        forgotten = 1.0 - exp(-self.crossing_rate * dt_s)
        return (1.0 - forgotten) * prior + forgotten * self.usual

    def posterior(self, prior: np.ndarray, log_likelihood: np.ndarray) -> np.ndarray:
        """Probability (C,) by Bayes' rule."""
        log_posterior = log(maximum(prior, _LEAST_PROBABILITY)) + log_likelihood
        posterior = exp(log_posterior - reduce(maximum, log_posterior))
        return posterior * (1.0 / posterior.sum())

    def changed(self, belief: np.ndarray) -> np.ndarray:
        """Belief (C,) after one wheel has moved to another floor."""
        return np.array([belief[row > 0.0] @ row[row > 0.0] for row in self.changes.T])  # most are 0

    def log_likelihood(self, forces: FloorForces, averaged_s: Scalar) -> np.ndarray:
        """Logarithm of p(F | c) (C,) of forces that are the mean over `averaged_s`.

        With the drag d_w of the floor under wheel w:

            F ~ N(sum_w d_w, sum_w drag_std^2 d_w d_w' + diag(own variances))

        The own variance of a wheel has a lasting part, and one that the mean over T reduces by tau / T.
        """
        white = self.correlation_s / maximum(averaged_s, self.correlation_s)
        persistent = PERSISTENT_SHARE + (1 - PERSISTENT_SHARE) * white
        columns = drag_columns(self.robot, forces.motion)
        drags = [columns @ np.array([f.rolling, f.roller]) for f in self.all_floors]
        by_floor = zip(self.all_floors, drags, strict=True)
        covs = [[np.outer(column, column) for column in (f.drag_std * drag).T] for f, drag in by_floor]
        sensor = white * forces.noise_N**2 + forces.friction_N**2
        found = []
        for combination in self.combinations:
            under = list(enumerate(combination))
            mean = sum(drags[floor][:, wheel] for wheel, floor in under)
            own_N = mean_load(self.robot) * max(self.all_floors[floor].force_std for floor in combination)
            S = sum(covs[floor][wheel] for wheel, floor in under) + np.diag(persistent * own_N**2 + sensor)
            found.append(log_density(forces.drag_N - mean, S))
        return np.array(found)

    def by_wheel(self, belief: np.ndarray) -> np.ndarray:
        """Probability (wheels, F) of each of all floors under each wheel."""
        floors = range(len(self.all_floors))
        return np.array([[belief[under == floor].sum() for floor in floors] for under in self.combinations.T])

    def by_name(self, by_wheel: np.ndarray) -> np.ndarray:
        """Probability (wheels, floors) of the floors as in `names`: all new floors are one."""
        known = len(self.floors)
        return by_wheel if self.known_only else np.array([[*row[:known], row[known:].sum()] for row in by_wheel])


def log_density(error: np.ndarray, S: np.ndarray) -> Scalar:
    """Logarithm of the normal density of an error (n,) with covariance (n, n), without its constant."""
    factor, _ = cholesky(S)
    white = solve_lower(factor, error)
    return -0.5 * (white @ white) - log(np.prod(np.diag(factor)))


#: Age [s] from which a speed is not used.
OLDEST_LOSS_S = 1.0
#: s. Lasting share of the variance of a speed: its scale and mounting are off by about a third of its noise.
LASTING_SHARE = 0.1
#: A speed more sigmas than this away from the mean of the previous ones, which fade with the time constant of the mean
#: force, begins a new mean: the slip has changed.
CHANGED = 3.0


class LossState(NamedTuple):
    """Mean loss since the last event, the mean variance of one such loss, and the number of speeds in them, fading."""

    mean: Any = 0.0
    variance: Any = 1.0
    count: Any = 0.0


class SeenLoss(NamedTuple):
    """Loss by outside speeds: whether there is one, its value and its variance."""

    known: Any
    value: Any
    variance: Any


class LossSample(NamedTuple):
    """Loss of one sample with its variance, nan where there is none, and whether a speed was given and refused."""

    value: Any
    variance: Any
    refused: Any


def loss_sample(clean: CleanSample, rim: np.ndarray, rim_std: np.ndarray, rate: np.ndarray, u: Scalar) -> LossSample:
    """Loss by the speed of a sample, u = |w| > 0.

    A slipping wheel loses or gains at most all of its rim's motion: any other speed is refused. The change of the rims
    since an old speed counts as its error.
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
    before = where(ended, 0.0, state.count * exp(-dt_s / MU_MEMORY_S))
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
