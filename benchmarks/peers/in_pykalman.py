"""The filters with the functions of pykalman's unscented module, called as its own loop does: points are redrawn.

It has no extended Kalman filter.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from pykalman.unscented import Moments, moments2points, unscented_filter_correct, unscented_filter_predict

from ohmward.filters.unscented import DEFAULT
from peers import Contestant
from workloads import CellProblem, JointProblem, Posterior

STEPS = 200


def cell(problem: CellProblem) -> Iterator[Contestant]:
    if problem.method == "ukf":
        yield Contestant("pykalman", "its functions", STEPS, partial(run_unscented, problem), redrawn=True)


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield Contestant("pykalman", "its functions", STEPS, partial(run_joint, problem), redrawn=True)


def run_unscented(problem: CellProblem, steps: int) -> Posterior:
    moments, R = Moments(*problem.start), np.array([[problem.R]])
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, voltage_V) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        points = moments2points(moments, *DEFAULT)
        _, prior = unscented_filter_predict(
            lambda x, i=mean_A: problem.next_state(np, x, i), points, sigma_transition=problem.Q
        )
        points = moments2points(prior, *DEFAULT)
        moments = unscented_filter_correct(
            lambda x, i=now_A: np.array([problem.voltage(np, x, i)]),
            prior,
            points,
            np.array([voltage_V]),
            sigma_observation=R,
        )
        means[k] = moments.mean
    return Posterior(*moments)


def run_joint(problem: JointProblem, steps: int) -> Posterior:
    moments = Moments(*problem.start)
    K, innovation, residual = np.zeros(problem.n), 0.0, 0.0
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, y) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        Q, R = problem.Q + innovation * np.outer(K, K), residual + moments.covariance[-1, -1] + problem.R
        points = moments2points(moments, *DEFAULT)
        _, prior = unscented_filter_predict(
            lambda x, i=mean_A, j=now_A: problem.next_state(np, x, i, j), points, sigma_transition=Q
        )
        points = moments2points(prior, *DEFAULT)
        mean, cov = unscented_filter_correct(
            lambda x: x[-1:], prior, points, np.array([y]), sigma_observation=np.array([[R]])
        )
        # it keeps gain and innovation to itself; for an output that is a state both follow from the prior
        K, nu = prior.covariance[:, -1] / (prior.covariance[-1, -1] + R), y - prior.mean[-1]
        moments = Moments(np.maximum(mean, problem.least), cov)
        e, samples = y - moments.mean[-1], min(k + 1.0, problem.window)
        innovation, residual = innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples
        means[k] = moments.mean
    return Posterior(*moments)
