"""The filters with FilterPy, as its documentation has them: sigma points are redrawn after the prediction."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from ohmward.filters.unscented import DEFAULT
from peers import Contestant
from workloads import CellProblem, JointProblem, Posterior

STEPS = 200


def cell(problem: CellProblem) -> Iterator[Contestant]:
    run = {"ekf": run_extended, "ukf": run_unscented}[problem.method]
    yield Contestant("FilterPy", "as documented", STEPS, partial(run, problem), redrawn=True)


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield Contestant("FilterPy", "as documented", STEPS, partial(run_joint, problem), redrawn=True)


def run_extended(problem: CellProblem, steps: int) -> Posterior:
    ekf = ExtendedKalmanFilter(dim_x=problem.n, dim_z=1, dim_u=problem.n)
    ekf.x, ekf.P = problem.start
    ekf.B = np.eye(problem.n)
    ekf.Q, ekf.R = problem.Q, np.array([[problem.R]])
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, voltage_V) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        decay, push = problem.motion(np, mean_A)
        ekf.F = np.diag(decay)
        ekf.predict(u=push)
        ekf.update(
            np.array([voltage_V]),
            lambda x: problem.slope(np, x)[None],
            lambda x, i: np.array([problem.voltage(np, x, i)]),
            hx_args=now_A,
        )
        means[k] = ekf.x
    return Posterior(ekf.x, ekf.P)


def run_unscented(problem: CellProblem, steps: int) -> Posterior:
    ukf = UnscentedKalmanFilter(
        problem.n,
        1,
        1.0,
        lambda x, i: np.array([problem.voltage(np, x, i)]),
        lambda x, dt, i: problem.next_state(np, x, i),
        MerweScaledSigmaPoints(problem.n, *DEFAULT),
    )
    ukf.x, ukf.P = problem.start
    ukf.Q, ukf.R = problem.Q, np.array([[problem.R]])
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, voltage_V) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        ukf.predict(i=mean_A)
        ukf.update(np.array([voltage_V]), i=now_A)
        means[k] = ukf.x
    return Posterior(ukf.x, ukf.P)


def run_joint(problem: JointProblem, steps: int) -> Posterior:
    ukf = UnscentedKalmanFilter(
        problem.n,
        1,
        1.0,
        lambda x: x[-1:],
        lambda x, dt, i, j: problem.next_state(np, x, i, j),
        MerweScaledSigmaPoints(problem.n, *DEFAULT),
    )
    ukf.x, ukf.P = problem.start
    K, innovation, residual = np.zeros(problem.n), 0.0, 0.0
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, y) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        ukf.Q = problem.Q + innovation * np.outer(K, K)
        ukf.R = np.array([[residual + ukf.P[-1, -1] + problem.R]])
        ukf.predict(i=mean_A, j=now_A)
        ukf.update(np.array([y]))
        ukf.x = np.maximum(ukf.x, problem.least)
        K, nu, e = ukf.K[:, 0], ukf.y[0], y - ukf.x[-1]
        samples = min(k + 1.0, problem.window)
        innovation, residual = innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples
        means[k] = ukf.x
    return Posterior(ukf.x, ukf.P)
