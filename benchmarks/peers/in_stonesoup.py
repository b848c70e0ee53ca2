"""The filters with Stone Soup's predictors and updaters on our own models: points are redrawn for the measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.transition import TransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from ohmward.filters.unscented import DEFAULT
from peers import Contestant
from workloads import CellProblem, JointProblem, Posterior

STEPS = 50
BEGAN = datetime(2000, 1, 1)


def cell(problem: CellProblem) -> Iterator[Contestant]:
    yield Contestant("Stone Soup", "own models", STEPS, partial(run_cell, problem), redrawn=True)


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield Contestant("Stone Soup", "own models", STEPS, partial(run_joint, problem), redrawn=True)


class Given:
    """What both kinds of models have: functions of a state, and covariances that are set before each step."""

    def function(self, state: Any, noise: bool = False, **kwargs: Any) -> Any:
        x = np.asarray(state.state_vector, dtype=float)
        y = self.of(x.T).T if x.shape[1] > 1 else self.of(x[:, 0])[:, None]
        return (StateVectors if y.shape[1] > 1 else StateVector)(y)

    def covar(self, **kwargs: Any) -> Any:
        return self.covariance

    def rvs(self, *args: Any, **kwargs: Any) -> Any:
        raise NotImplementedError

    def pdf(self, *args: Any, **kwargs: Any) -> Any:
        raise NotImplementedError


class Transition(Given, TransitionModel):
    of: Callable = Property()
    matrix: Any = Property()
    covariance: Any = Property()

    @property
    def ndim_state(self) -> int:
        return len(self.covariance)

    def jacobian(self, state: Any, **kwargs: Any) -> Any:
        return self.matrix


class Measurement(Given, MeasurementModel):
    ndim_state: int = Property()
    mapping: tuple = Property(default=())
    of: Callable = Property()
    row: Callable | None = Property(default=None)
    covariance: Any = Property()

    @property
    def ndim_meas(self) -> int:
        return 1

    def jacobian(self, state: Any, **kwargs: Any) -> Any:
        return self.row(np.asarray(state.state_vector, dtype=float)[:, 0])


def run_cell(problem: CellProblem, steps: int) -> Posterior:
    transition = Transition(None, None, problem.Q)
    measurement = Measurement(
        problem.n, of=None, row=lambda x: problem.slope(np, x)[None], covariance=np.array([[problem.R]])
    )
    predictor, updater = filter_of(problem.method, transition, measurement)
    state = started(problem)
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, voltage_V) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        transition.of = partial(problem.next_state, np, mean_A=mean_A)
        transition.matrix = np.diag(problem.motion(np, mean_A)[0])
        measurement.of = partial(_voltage, problem, now_A)
        state = advance(predictor, updater, state, k, voltage_V)
        means[k] = state.state_vector[:, 0]
    return Posterior(means[-1], np.asarray(state.covar, dtype=float))


def _voltage(problem: CellProblem, now_A: float, x: np.ndarray) -> np.ndarray:
    """(1,) of a state (n,), (points, 1) of many."""
    return np.asarray(problem.voltage(np, x, now_A))[..., None]


def run_joint(problem: JointProblem, steps: int) -> Posterior:
    transition = Transition(None, None, problem.Q)
    measurement = Measurement(problem.n, of=lambda x: x[..., -1:], covariance=np.array([[problem.R]]))
    predictor, updater = filter_of("ukf", transition, measurement)
    state = started(problem)
    K, innovation, residual = np.zeros(problem.n), 0.0, 0.0
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, y) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        transition.of = lambda x, i=mean_A, j=now_A: problem.next_state(np, x, i, j)
        transition.covariance = problem.Q + innovation * np.outer(K, K)
        measurement.covariance = np.array([[residual + state.covar[-1, -1] + problem.R]], dtype=float)
        state = advance(predictor, updater, state, k, y)
        prior = state.hypothesis.prediction
        S = prior.covar[-1, -1] + measurement.covariance[0, 0]
        K, nu = np.asarray(prior.covar[:, -1], dtype=float) / float(S), float(y - prior.state_vector[-1, 0])
        mean = np.maximum(np.asarray(state.state_vector[:, 0], dtype=float), problem.least)
        state = GaussianState(mean[:, None], state.covar, timestamp=state.timestamp)
        e, samples = y - mean[-1], min(k + 1.0, problem.window)
        innovation, residual = innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples
        means[k] = mean
    return Posterior(means[-1], np.asarray(state.covar, dtype=float))


def filter_of(method: str, transition: Transition, measurement: Measurement) -> tuple[Any, Any]:
    """Predictor and updater."""
    if method == "ekf":
        return ExtendedKalmanPredictor(transition), ExtendedKalmanUpdater(measurement)
    alpha, beta, kappa = DEFAULT
    return (
        UnscentedKalmanPredictor(transition, alpha=alpha, beta=beta, kappa=kappa),
        UnscentedKalmanUpdater(measurement, alpha=alpha, beta=beta, kappa=kappa),
    )


def started(problem: CellProblem | JointProblem) -> GaussianState:
    return GaussianState(problem.start.mean[:, None], problem.start.cov, timestamp=BEGAN)


def advance(predictor: Any, updater: Any, state: Any, k: int, voltage_V: float) -> Any:
    """The state after the next sample."""
    time = BEGAN + timedelta(seconds=k + 1)
    prediction = predictor.predict(state, timestamp=time)
    seen = Detection([[voltage_V]], timestamp=time, measurement_model=updater.measurement_model)
    return updater.update(SingleHypothesis(prediction, seen))
