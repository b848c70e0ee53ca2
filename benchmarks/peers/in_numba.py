"""The filters in Numba as loops over small matrices, compiled for this processor; many logs one after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numba import njit

from peers import Contestant
from workloads import CellProblem, JointProblem, Posterior

STEPS, LANE_STEPS = 100_000, 50
#: What takes less was compiled before.
LEAST_COMPILING_S = 0.02
fast = njit(fastmath={"contract"}, error_model="numpy")


def cell(problem: CellProblem) -> Iterator[Contestant]:
    yield compiled(cell_run(problem), "loops over matrices", STEPS, problem.method == "ukf")


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield compiled(joint_run(problem), "loops over matrices", STEPS)


def cell_lanes(problem: CellProblem) -> Iterator[Contestant]:
    yield compiled(one_by_one(cell_run, problem), "one log after the other", LANE_STEPS, problem.method == "ukf")


def joint_lanes(problem: JointProblem) -> Iterator[Contestant]:
    yield compiled(one_by_one(joint_run, problem), "one log after the other", LANE_STEPS)


def compiled(run: Callable[[int], Posterior], how: str, steps: int, redrawn: bool = False) -> Contestant:
    began = time.perf_counter()
    run(2)
    took = time.perf_counter() - began
    return Contestant("Numba", how, steps, run, redrawn, took if took > LEAST_COMPILING_S else float("nan"))


def one_by_one(make: Callable, problem: CellProblem | JointProblem) -> Callable[[int], Posterior]:
    """The runs of all logs."""
    columns = [[np.ascontiguousarray(c) for c in column.T] for column in problem.drive]
    runs = [make(problem._replace(drive=type(problem.drive)(*log))) for log in zip(*columns, strict=True)]

    def run(steps: int) -> Posterior:
        first, *_ = [run(steps) for run in runs]
        return first

    return run


def cell_run(problem: CellProblem) -> Callable[[int], Posterior]:
    loop = {"ekf": extended, "ukf": unscented}[problem.method]
    curve, zeros = np.ascontiguousarray(problem.curve.T), np.zeros(problem.n - 3)

    def run(steps: int) -> Posterior:
        mean, cov = problem.start.mean.copy(), problem.start.cov.copy()
        means = np.empty((steps, problem.n))
        constants = problem.weights, problem.r0_ohm, curve, problem.Q, problem.R
        motion = np.append(problem.decays, zeros), np.append(problem.gain, zeros), problem.rate
        loop(mean, cov, *problem.drive.first(steps), *motion, *constants, problem.scaling, means)
        return Posterior(mean, cov)

    return run


def joint_run(problem: JointProblem) -> Callable[[int], Posterior]:
    def run(steps: int) -> Posterior:
        mean, cov = problem.start.mean.copy(), problem.start.cov.copy()
        means = np.empty((steps, problem.n))
        current_A, mean_A, voltage_V = problem.drive.first(steps)
        constants = problem.moves, problem.least, problem.Q, problem.R, problem.window
        adaptive(mean, cov, current_A, mean_A, voltage_V, *constants, problem.scaling, means)
        return Posterior(mean, cov)

    return run


@fast
def segment(curve, soc):
    u = soc * (len(curve) - 2)
    k = min(max(np.floor(u), -1.0), len(curve) - 2.0)
    return curve[int(k) + 1], u - k


@fast
def voltage(x, now_A, weights, r0_ohm, curve):
    c, t = segment(curve, x[0])
    v = c[0] + t * (c[1] + t * (c[2] + t * c[3])) + r0_ohm * now_A
    for j in range(1, len(x)):
        v += weights[j - 1] * x[j]
    return v


@fast
def extended(mean, cov, current_A, mean_A, voltage_V, decay, gain, rate, weights, r0_ohm, curve, Q, R, scaling, means):
    n = len(mean)
    H, C = np.empty(n), np.empty(n)
    H[1:] = weights
    for k in range(len(current_A)):
        if n > 3:
            decay[3] = np.exp(-rate * abs(mean_A[k]))
        for i in range(n):
            mean[i] = decay[i] * mean[i] + gain[i] * mean_A[k]
            for j in range(n):
                cov[i, j] = decay[i] * cov[i, j] * decay[j] + Q[i, j]
        if n > 3:
            mean[3] += (1 - decay[3]) * np.sign(mean_A[k])
        c, t = segment(curve, mean[0])
        H[0] = (c[1] + t * (2 * c[2] + t * 3 * c[3])) * (len(curve) - 2)
        S = R
        for i in range(n):
            C[i] = 0.0
            for j in range(n):
                C[i] += cov[i, j] * H[j]
            S += H[i] * C[i]
        correct(mean, cov, C, S, voltage_V[k] - voltage(mean, current_A[k], weights, r0_ohm, curve))
        means[k] = mean


@fast
def unscented(mean, cov, current_A, mean_A, voltage_V, decay, gain, rate, weights, r0_ohm, curve, Q, R, scaling, means):
    n = len(mean)
    spread, Wm, Wc = scaling
    L, X, Y, C = np.zeros((n, n)), np.empty((2 * n + 1, n)), np.empty(2 * n + 1), np.empty(n)
    for k in range(len(current_A)):
        draw(mean, cov, spread, L, X)
        for p in range(2 * n + 1):
            for i in range(n):
                X[p, i] = decay[i] * X[p, i] + gain[i] * mean_A[k]
        moments(X, Wm, Wc, Q, mean, cov)
        draw(mean, cov, spread, L, X)
        for p in range(2 * n + 1):
            Y[p] = voltage(X[p], current_A[k], weights, r0_ohm, curve)
        y_hat, S = output(X, Y, mean, Wm, Wc, C)
        correct(mean, cov, C, S + R, voltage_V[k] - y_hat)
        means[k] = mean


@fast
def adaptive(mean, cov, current_A, mean_A, voltage_V, moves, least, Q_floor, R_floor, window, scaling, means):
    n = len(mean)
    spread, Wm, Wc = scaling
    L, X, Y, C = np.zeros((n, n)), np.empty((2 * n + 1, n)), np.empty(2 * n + 1), np.empty(n)
    K, Q = np.zeros(n), np.empty((n, n))
    innovation, residual, samples = 0.0, 0.0, 0.0
    for k in range(len(mean_A)):
        for i in range(n):
            for j in range(n):
                Q[i, j] = Q_floor[i, j] + innovation * K[i] * K[j]
        R = residual + cov[n - 1, n - 1] + R_floor
        draw(mean, cov, spread, L, X)
        for p in range(2 * n + 1):
            next_state(X[p], mean_A[k], current_A[k], moves)
            Y[p] = X[p, n - 1]
        moments(X, Wm, Wc, Q, mean, cov)
        y_hat, S = output(X, Y, mean, Wm, Wc, C)
        S += R
        nu = voltage_V[k] - y_hat
        correct(mean, cov, C, S, nu)
        for i in range(n):
            K[i] = C[i] / S
            mean[i] = max(mean[i], least[i])
        e = voltage_V[k] - mean[n - 1]
        samples = min(samples + 1.0, window)
        innovation += (nu * nu - innovation) / samples
        residual += (e * e - residual) / samples
        means[k] = mean


@fast
def next_state(x, mean_A, now_A, moves):
    bulk, surface, g = moves[0] * x[0], moves[1] * x[1], moves[2] * x[2]
    across_A = g * (x[5] - x[4])
    instant_ohm = moves[3] * x[3]
    U = x[6] - instant_ohm * (2 * mean_A - now_A)
    x[6] = U + (surface - bulk) * g * (x[4] - U) + (surface + bulk) * 0.5 * mean_A + instant_ohm * now_A
    x[4] += bulk * (across_A + mean_A)
    x[5] += surface * (mean_A - across_A)


@fast
def draw(mean, cov, spread, L, X):
    n = len(mean)
    for j in range(n):
        pivot = cov[j, j]
        for m in range(j):
            pivot -= L[j, m] * L[j, m]
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            value = cov[i, j]
            for m in range(j):
                value -= L[i, m] * L[j, m]
            L[i, j] = value / L[j, j]
    root = np.sqrt(spread)
    for i in range(n):
        X[0, i] = mean[i]
        for j in range(n):
            X[1 + j, i] = mean[i] + root * L[i, j]
            X[1 + n + j, i] = mean[i] - root * L[i, j]


@fast
def moments(X, Wm, Wc, Q, mean, cov):
    """Mean and covariance of the points, and Q."""
    points, n = X.shape
    for i in range(n):
        mean[i] = 0.0
        for p in range(points):
            mean[i] += Wm[p] * X[p, i]
    for i in range(n):
        for j in range(i + 1):
            value = Q[i, j]
            for p in range(points):
                value += Wc[p] * (X[p, i] - mean[i]) * (X[p, j] - mean[j])
            cov[i, j] = cov[j, i] = value


@fast
def output(X, Y, mean, Wm, Wc, C):
    """Mean and variance of the output; its covariance with the state goes to C."""
    points, n = X.shape
    y_hat, S = 0.0, 0.0
    for p in range(points):
        y_hat += Wm[p] * Y[p]
    C[:] = 0.0
    for p in range(points):
        e = Wc[p] * (Y[p] - y_hat)
        S += e * (Y[p] - y_hat)
        for i in range(n):
            C[i] += e * (X[p, i] - mean[i])
    return y_hat, S


@fast
def correct(mean, cov, C, S, nu):
    n = len(mean)
    for i in range(n):
        mean[i] += C[i] / S * nu
        for j in range(n):
            cov[i, j] -= C[i] * C[j] / S
