"""The maximum of a likelihood that is rough, and its interval.

An extended Kalman filter that is told less noise than there is goes astray, a little differently for every factor:
beside its smooth maximum the likelihood has steps of hundreds. A search by populations (the cross-entropy method,
Rubinstein 1999) walks over them, from more noise to less; a parabola through many points of the last one, without those
that went astray, gives the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ohmward.battery.soc.estimator import samples_of
from ohmward.battery.soc.sample import SocSample
from ohmward.battery.tuning.noise_model import FACTORS, NoiseModel, ScoredSample
from ohmward.logs.log import Log
from ohmward.trace import Kernel
from ohmward.trace.structure import side_by_side

#: Slopes of the likelihood over stretches of this length are independent of each other.
BLOCK_S = 3600.0


@dataclass(frozen=True)
class Likelihood:
    """The logs, their starts, and the noise whose factors are wanted."""

    model: NoiseModel  #: noise of the battery file, with factors
    logs: Sequence[Log]
    initial_soc: Mapping[str, float]  #: of logs by their names, where it is known

    @cached_property
    def kernel(self) -> Kernel:
        """The step of the filter, traced."""
        nothing = SocSample(0.0, np.nan, np.nan, np.nan)
        return Kernel(self.model.step, self.model.init(nothing, np.zeros(len(FACTORS))), nothing)

    def scored(self, log: Log, log_factors: np.ndarray) -> ScoredSample:
        """Every sample of a log under ln factors (P, 3): arrays (T, P)."""
        samples = samples_of(log)
        first = SocSample(*(float(column[0]) for column in samples))
        soc = self.initial_soc.get(log.name)
        states = [self.model.init(first, factors, soc) for factors in log_factors]
        _, found = self.kernel.scan_lanes(side_by_side(states), samples)
        return found

    def blocks(self, log_factors: np.ndarray) -> np.ndarray:
        """(B, P) ln of the likelihood of ln factors (P, 3) in each stretch of `BLOCK_S`, up to a constant.

        -inf where a filter with these factors has lost itself.
        """
        stretches = []
        for log in self.logs:
            density = self.scored(log, log_factors).log_density
            starts = np.unique((log.time_s - log.time_s[0]) // BLOCK_S, return_index=True)[1]
            stretches.append(np.add.reduceat(density, starts, axis=0))
        found = np.vstack(stretches)
        return np.where(np.isfinite(found), found, -np.inf)


#: A factor is looked for within this factor of 1.
WIDEST = 300.0
#: Members of a population, those of them that make the next one, and populations.
_MEMBERS, _BEST, _GENERATIONS = 64, 16, 16
#: First population: thirty times the noise of the file, or less; a correlation time near the file's.
_FIRST_MEAN, _FIRST_STD = np.log([30.0, 30.0, 1.0]), np.array([1.5, 1.5, 0.7])
#: Least standard deviations of a population: a narrower one would fall into one of the steps.
_LEAST_STD = np.array([0.02, 0.1, 0.1])
#: Later populations keep this share of the covariance before.
_KEPT_SHARE = 0.3
#: Points whose distance from the parabola is more than this multiple of its median have gone astray.
_ASTRAY = 4.0
#: Fewer stretches tell no scatter.
_LEAST_BLOCKS = 6
_SEED = 1

Progress = Callable[[int, int], None]


class Maximum(NamedTuple):
    """The most likely factors, as logarithms."""

    log_factors: np.ndarray  #: (3,)
    #: (3, 3) covariance of it: of the logs (sandwich, White 1982), of the steps of the likelihood, and of the search.
    #: nan where the logs are too short to tell it.
    cov: np.ndarray


def maximum(likelihood: Likelihood, progress: Progress | None = None) -> Maximum:
    """The most likely factors."""
    rng, rank = np.random.default_rng(_SEED), np.log((_BEST + 1) / np.arange(1, _BEST + 1))
    mean, cov = _FIRST_MEAN, np.diag(_FIRST_STD**2)
    limit = np.log(WIDEST)
    for generation in range(_GENERATIONS):
        if progress:
            progress(generation, _GENERATIONS)
        points = mean + rng.standard_normal((_MEMBERS, len(mean))) @ np.linalg.cholesky(cov).T
        points = np.clip(points, -limit, limit)
        best = points[np.argsort(-likelihood.blocks(points).sum(axis=0))[:_BEST]]
        away = best - mean
        spread = (away.T * (rank / rank.sum())) @ away
        cov = _KEPT_SHARE * cov + (1.0 - _KEPT_SHARE) * spread + np.diag(_LEAST_STD**2) / _BEST
        mean = rank @ best / rank.sum()
    searched = np.cov(best.T) / _BEST
    return Maximum(mean, sandwich(likelihood, mean, rng) + searched)


def sandwich(likelihood: Likelihood, at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(3, 3) covariance of the most likely factors, H^-1 J H^-1 + r H^-1; nan where the logs are too short to tell it.

    H: minus the second derivatives.  J: covariance of the slope, from its scatter between stretches of the logs.
    r: height of the steps, for what lies within it of the maximum may as well be the maximum.
    """
    away = rng.standard_normal((2 * _MEMBERS, len(at))) * (2.0 * _LEAST_STD)
    blocks = likelihood.blocks(at + away)
    total = blocks.sum(axis=0)
    i, j = np.triu_indices(len(at))
    terms = np.column_stack([np.ones(len(away)), away, away[:, i] * away[:, j]])
    used = np.isfinite(total)
    for _ in range(4):
        if np.count_nonzero(used) < 2 * terms.shape[1]:
            return np.full((len(at), len(at)), np.nan)
        parabola = np.linalg.lstsq(terms[used], total[used], rcond=None)[0]
        distance = np.abs(total - terms @ parabola)
        used = distance <= _ASTRAY * np.median(distance[used])
    upper = np.zeros((len(at), len(at)))
    upper[i, j] = -parabola[len(at) + 1 :]
    H = upper + upper.T
    slopes = np.linalg.lstsq(terms[used], blocks[:, used].T, rcond=None)[0][1 : len(at) + 1].T
    scatter = (slopes - slopes.mean(axis=0)).T @ (slopes - slopes.mean(axis=0))
    if len(slopes) < _LEAST_BLOCKS or np.linalg.cond(scatter) > 1e12:
        return np.full_like(H, np.nan)
    rough = float(np.median(distance[used]))
    if np.linalg.eigvalsh(H)[0] <= 0.0:  # too rough for a parabola: the slopes alone (Berndt et al. 1974)
        return np.asarray((1.0 + rough) * np.linalg.inv(scatter))
    inverse = np.linalg.inv(H)
    return np.asarray(inverse @ scatter @ inverse + rough * inverse)
