"""The filters in NumPy as matrix products: what one writes who knows both. They also say what is right."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from peers import Contestant
from workloads import CellProblem, JointProblem, Posterior

STEPS = 500


def cell(problem: CellProblem) -> Iterator[Contestant]:
    yield Contestant("NumPy by hand", "matrices", STEPS, partial(run_cell, problem), redrawn=True)


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield Contestant("NumPy by hand", "matrices", STEPS, partial(run_joint, problem))


def cell_lanes(problem: CellProblem) -> Iterator[Contestant]:
    yield Contestant("NumPy by hand", "matrices over logs", 20, partial(run_cell_lanes, problem), redrawn=True)


def joint_lanes(problem: JointProblem) -> Iterator[Contestant]:
    yield Contestant("NumPy by hand", "matrices over logs", 20, partial(run_joint_lanes, problem))


def run_cell(problem: CellProblem, steps: int) -> Posterior:
    step = {"ekf": extended_step, "ukf": unscented_step}[problem.method]
    mean, cov = problem.start
    means = np.empty((steps, problem.n))
    for k, (now_A, mean_A, voltage_V) in enumerate(zip(*problem.drive.first(steps), strict=True)):
        mean, cov = step(np, mean, cov, now_A, mean_A, voltage_V, problem)
        means[k] = mean
    return Posterior(mean, cov)


def run_joint(problem: JointProblem, steps: int, redraw: bool = False) -> Posterior:
    state: Any = joint_start(np, problem)
    current_A, mean_A, voltage_V = problem.drive.first(steps)
    means = np.empty((steps, problem.n))
    for k in range(steps):
        state = joint_step(np, state, current_A[k], mean_A[k], voltage_V[k], problem, redraw)
        means[k] = state[0]
    return Posterior(*state[:2])


def extended_step(
    xp: Any, mean: Any, cov: Any, now_A: Any, mean_A: Any, y: Any, problem: CellProblem
) -> tuple[Any, Any]:
    """Extended Kalman filter of the cell."""
    decay, push = problem.motion(xp, mean_A)
    mean, cov = decay * mean + push, cov * xp.outer(decay, decay) + problem.Q  # F is diagonal
    H = problem.slope(xp, mean)
    C = cov @ H
    S = H @ C + problem.R
    K = C / S
    return mean + K * (y - problem.voltage(xp, mean, now_A)), cov - S * xp.outer(K, K)


def unscented_step(
    xp: Any, mean: Any, cov: Any, now_A: Any, mean_A: Any, y: Any, problem: CellProblem
) -> tuple[Any, Any]:
    """Unscented Kalman filter of the cell, points redrawn."""
    spread, Wm, Wc = problem.scaling
    X = problem.next_state(xp, draw(xp, mean, cov, spread), mean_A)
    mean = Wm @ X
    D = X - mean
    cov = (Wc * D.T) @ D + problem.Q
    X = draw(xp, mean, cov, spread)
    Y = problem.voltage(xp, X, now_A)
    y_hat = Wm @ Y
    E = Wc * (Y - y_hat)
    S = E @ (Y - y_hat) + problem.R
    K = E @ (X - mean) / S
    return mean + K * (y - y_hat), cov - S * xp.outer(K, K)


def joint_start(xp: Any, problem: JointProblem) -> tuple:
    """Mean, covariance, last gain, moments of innovation and residual, samples in them."""
    mean, cov = problem.start
    return xp.asarray(mean), xp.asarray(cov), xp.zeros(problem.n), 0.0, 0.0, 0.0


def joint_step(
    xp: Any, state: tuple, now_A: Any, mean_A: Any, y: Any, problem: JointProblem, redraw: bool = False
) -> tuple:
    """Adaptive unscented Kalman filter of states and parameters."""
    mean, cov, K, innovation, residual, samples = state
    spread, Wm, Wc = problem.scaling
    Q, R = problem.Q + innovation * xp.outer(K, K), residual + cov[-1, -1] + problem.R
    X = problem.next_state(xp, draw(xp, mean, cov, spread), mean_A, now_A)
    mean = Wm @ X
    D = X - mean
    cov = (Wc * D.T) @ D + Q
    if redraw:
        X = draw(xp, mean, cov, spread)
        D = X - mean
    Y = X[:, -1]
    y_hat = Wm @ Y
    E = Wc * (Y - y_hat)
    S = E @ (Y - y_hat) + R
    K = E @ D / S
    nu = y - y_hat
    mean, cov = xp.maximum(mean + K * nu, problem.least), cov - S * xp.outer(K, K)
    e = y - mean[-1]
    samples = xp.minimum(samples + 1.0, problem.window)
    return mean, cov, K, innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples, samples


def draw(xp: Any, mean: Any, cov: Any, spread: float) -> Any:
    """Sigma points (2 n + 1, n)."""
    offsets = np.sqrt(spread) * xp.linalg.cholesky(cov).T
    return xp.concatenate([mean[None], mean + offsets, mean - offsets])


# ---- many logs: a leading axis of logs on everything


def run_cell_lanes(problem: CellProblem, steps: int) -> Posterior:
    current_A, mean_A, voltage_V = problem.drive.first(steps)
    logs = current_A.shape[1]
    mean, cov = (np.repeat(a[None], logs, axis=0) for a in problem.start)
    step = extended_lanes if problem.method == "ekf" else unscented_lanes
    means = np.empty((steps, logs, problem.n))
    for k in range(steps):
        mean, cov = step(mean, cov, current_A[k], mean_A[k], voltage_V[k], problem)
        means[k] = mean
    return Posterior(mean[0], cov[0])


def extended_lanes(
    mean: Any, cov: Any, now_A: Any, mean_A: Any, y: Any, problem: CellProblem
) -> tuple[np.ndarray, np.ndarray]:
    decay, push = problem.motion(np, mean_A)
    mean, cov = decay * mean + push, cov * (decay[..., :, None] * decay[..., None, :]) + problem.Q
    c, t = problem.segment(np, mean[:, 0])
    H = np.empty_like(mean)
    H[:, 1:] = problem.weights
    H[:, 0] = (c[1] + t * (2 * c[2] + t * 3 * c[3])) * (problem.curve.shape[1] - 2)
    C = np.einsum("bij,bj->bi", cov, H)
    S = np.einsum("bi,bi->b", H, C) + problem.R
    K = C / S[:, None]
    nu = y - problem.voltage(np, mean, now_A)
    return mean + K * nu[:, None], cov - K[:, :, None] * C[:, None, :]


def unscented_lanes(
    mean: Any, cov: Any, now_A: Any, mean_A: Any, y: Any, problem: CellProblem
) -> tuple[np.ndarray, np.ndarray]:
    spread, Wm, Wc = problem.scaling
    X = problem.next_state(np, draw_lanes(mean, cov, spread), mean_A[:, None])
    mean, _, cov = moments(X, Wm, Wc)
    cov += problem.Q
    X = draw_lanes(mean, cov, spread)
    Y = problem.voltage(np, X, now_A[:, None])
    return corrected(X - mean[:, None], Y, mean, cov, y, problem.R, Wm, Wc)[:2]


def run_joint_lanes(problem: JointProblem, steps: int) -> Posterior:
    current_A, mean_A, voltage_V = problem.drive.first(steps)
    logs, (spread, Wm, Wc) = mean_A.shape[1], problem.scaling
    mean, cov = (np.repeat(a[None], logs, axis=0) for a in problem.start)
    K, innovation, residual = np.zeros((logs, problem.n)), np.zeros(logs), np.zeros(logs)
    means = np.empty((steps, logs, problem.n))
    for k in range(steps):
        Q = problem.Q + innovation[:, None, None] * K[:, :, None] * K[:, None, :]
        R = residual + cov[:, -1, -1] + problem.R
        X = problem.next_state(np, draw_lanes(mean, cov, spread), mean_A[k][:, None], current_A[k][:, None])
        mean, D, cov = moments(X, Wm, Wc)
        mean, cov, K, nu = corrected(D, X[..., -1], mean, cov + Q, voltage_V[k], R, Wm, Wc)
        mean = np.maximum(mean, problem.least)
        e, samples = voltage_V[k] - mean[:, -1], min(k + 1.0, problem.window)
        innovation, residual = innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples
        means[k] = mean
    return Posterior(mean[0], cov[0])


def draw_lanes(mean: np.ndarray, cov: np.ndarray, spread: float) -> np.ndarray:
    """Sigma points (logs, 2 n + 1, n)."""
    offsets = np.sqrt(spread) * np.linalg.cholesky(cov).transpose(0, 2, 1)
    return np.concatenate([mean[:, None], mean[:, None] + offsets, mean[:, None] - offsets], axis=1)


def moments(X: np.ndarray, Wm: np.ndarray, Wc: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, deviations and covariance of the points of each log."""
    mean = np.einsum("p,bpi->bi", Wm, X)
    D = X - mean[:, None]
    return mean, D, D.transpose(0, 2, 1) @ (Wc[:, None] * D)


def corrected(D: Any, Y: Any, mean: Any, cov: Any, y: Any, R: Any, Wm: Any, Wc: Any) -> tuple:
    """Mean and covariance after the measurement, gain and innovation of each log."""
    y_hat = Y @ Wm
    E = Y - y_hat[:, None]
    S = E**2 @ Wc + R
    K = np.einsum("bp,bpi->bi", Wc * E, D) / S[:, None]
    nu = y - y_hat
    return mean + K * nu[:, None], cov - S[:, None, None] * K[:, :, None] * K[:, None, :], K, nu
