"""The filters as CasADi SX functions in its virtual machine: `mapaccum` over a log, `map` over logs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np

from peers import Contestant, c_code
from workloads import CellProblem, JointProblem, Posterior

STEPS = 5000
#: Samples that one call of the mapped function takes.
BLOCK = 500
LANE_STEPS = 50


def cell(problem: CellProblem) -> Iterator[Contestant]:
    yield from over_log(problem, *cell_step(problem), redrawn=True)


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield from over_log(problem, *joint_step(problem))


def cell_lanes(problem: CellProblem) -> Iterator[Contestant]:
    yield over_logs(problem, *cell_step(problem), redrawn=True)


def joint_lanes(problem: JointProblem) -> Iterator[Contestant]:
    yield over_logs(problem, *joint_step(problem))


Step = tuple[Callable[[], ca.Function], np.ndarray]


def over_log(
    problem: CellProblem | JointProblem, build: Callable, start: np.ndarray, redrawn: bool = False
) -> Iterator[Contestant]:
    """One log, a block of samples at a time: in the virtual machine, and as generated C where there is a compiler."""
    ways = {"SX, mapaccum": mapped}
    if c_code.compiler():
        ways["SX, mapaccum, its C code by " + c_code.compiler()] = compiled
    for how, make in ways.items():
        began = time.perf_counter()
        block = make(build())
        prepared_s = time.perf_counter() - began
        yield Contestant("CasADi", how, STEPS, partial(run_blocks, problem, block, build(), start), redrawn, prepared_s)


def mapped(step: ca.Function) -> ca.Function:
    """The step over a block of samples."""
    return step.mapaccum(BLOCK)


def compiled(step: ca.Function) -> ca.Function:
    """The same as C."""
    block = mapped(step)
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("block.c")
        generator.add(block)
        generator.generate(f"{folder}/")
        return ca.external(block.name(), str(c_code.library(Path(folder) / "block.c")))


def run_blocks(
    problem: CellProblem | JointProblem, block: ca.Function, single: ca.Function, start: np.ndarray, steps: int
) -> Posterior:
    """Whole blocks, and what remains sample by sample."""
    state, samples, states = start.copy(), np.empty((BLOCK, 3)), np.empty((BLOCK, len(start)))
    buffer, evaluate = block.buffer()
    for k, array in enumerate((state, samples)):
        buffer.set_arg(k, memoryview(array))
    buffer.set_res(0, memoryview(states))
    columns = np.column_stack(problem.drive.first(steps))
    means = np.empty((steps, problem.n))
    whole = steps - steps % BLOCK
    for k in range(0, whole, BLOCK):
        samples[:] = columns[k : k + BLOCK]
        evaluate()
        means[k : k + BLOCK], state[:] = states[:, : problem.n], states[-1]
    for k in range(whole, steps):
        state[:] = np.asarray(single(state, columns[k])).ravel()
        means[k] = state[: problem.n]
    return posterior(state, problem.n)


def over_logs(
    problem: CellProblem | JointProblem, build: Callable, start: np.ndarray, redrawn: bool = False
) -> Contestant:
    """Many logs, a sample of all of them at a time."""
    logs = problem.drive.current_A.shape[1]
    step = build().map(logs)

    def run(steps: int) -> Posterior:
        state = np.repeat(start[:, None], logs, axis=1)
        means = np.empty((steps, problem.n, logs))
        for k, sample in enumerate(zip(*problem.drive.first(steps), strict=True)):
            state = np.asarray(step(state, np.vstack(sample)))
            means[k] = state[: problem.n]
        return posterior(state[:, 0], problem.n)

    return Contestant("CasADi", "SX, map", LANE_STEPS, run, redrawn)


def posterior(state: np.ndarray, n: int) -> Posterior:
    return Posterior(state[:n], state[n : n + n * n].reshape(n, n))


def cell_step(problem: CellProblem) -> Step:
    """(state, sample) -> state, of mean and covariance."""
    n = problem.n

    def build() -> ca.Function:
        state, sample = ca.SX.sym("state", n + n * n), ca.SX.sym("sample", 3)
        mean, cov = state[:n], ca.reshape(state[n:], n, n)
        now_A, mean_A, y = ca.vertsplit(sample)
        filter_ = {"ekf": extended, "ukf": unscented}[problem.method]
        mean, cov = filter_(problem, mean, cov, now_A, mean_A, y)
        return ca.Function("step", [state, sample], [ca.vertcat(mean, ca.vec(cov))])

    return build, np.concatenate([problem.start.mean, problem.start.cov.ravel()])


def voltage(problem: CellProblem, x: ca.SX, now_A: ca.SX) -> ca.SX:
    """The curve as nested choices: SX has no look-up."""
    segments = problem.curve.shape[1]
    u = x[0] * (segments - 2)
    k = ca.fmin(ca.fmax(ca.floor(u), -1), segments - 2)
    edges = [float(j) - 0.5 for j in range(segments - 1)]
    c = [ca.pw_const(k, edges, row) for row in problem.curve]
    t = u - k
    return c[0] + t * (c[1] + t * (c[2] + t * c[3])) + ca.dot(problem.weights, x[1:]) + problem.r0_ohm * now_A


def motion(problem: CellProblem, mean_A: ca.SX) -> tuple:
    """Decay and push."""
    decay, push = ca.SX(problem.decays), problem.gain * mean_A
    if not problem.rate:
        return decay, push
    kept = ca.exp(-problem.rate * ca.fabs(mean_A))
    return ca.vertcat(decay, kept), ca.vertcat(push, (1 - kept) * ca.sign(mean_A))


def extended(problem: CellProblem, mean: ca.SX, cov: ca.SX, now_A: ca.SX, mean_A: ca.SX, y: ca.SX) -> tuple:
    decay, push = motion(problem, mean_A)
    mean, cov = decay * mean + push, ca.diag(decay) @ cov @ ca.diag(decay) + problem.Q
    x = ca.SX.sym("x", problem.n)
    h = voltage(problem, x, now_A)
    y_hat, H = ca.substitute([h, ca.jacobian(h, x)], [x], [mean])
    C = cov @ H.T
    S = H @ C + problem.R
    K = C / S
    return mean + K * (y - y_hat), cov - S * K @ K.T


def unscented(problem: CellProblem, mean: ca.SX, cov: ca.SX, now_A: ca.SX, mean_A: ca.SX, y: ca.SX) -> tuple:
    spread, Wm, Wc = problem.scaling
    decay, push = motion(problem, mean_A)
    X = [decay * x + push for x in draw(mean, cov, spread)]
    mean, D = centred(X, Wm)
    cov = product(D, D, Wc) + problem.Q
    X = draw(mean, cov, spread)
    return corrected(X, [voltage(problem, x, now_A) for x in X], mean, cov, y, problem.R, Wm, Wc)[:2]


def joint_step(problem: JointProblem) -> Step:
    """(state, sample) -> state, of mean, covariance, gain, and what the noise is learnt from."""
    n, (spread, Wm, Wc) = problem.n, problem.scaling

    def build() -> ca.Function:
        state, sample = ca.SX.sym("state", 2 * n + n * n + 3), ca.SX.sym("sample", 3)
        mean, cov, K = state[:n], ca.reshape(state[n : n + n * n], n, n), state[n + n * n : 2 * n + n * n]
        innovation, residual, samples = ca.vertsplit(state[-3:])
        now_A, mean_A, y = ca.vertsplit(sample)
        Q, R = problem.Q + innovation * K @ K.T, residual + cov[-1, -1] + problem.R
        X = [ca.vertcat(*problem.elements(ca.vertsplit(x), mean_A, now_A)) for x in draw(mean, cov, spread)]
        mean, D = centred(X, Wm)
        cov = product(D, D, Wc) + Q
        mean, cov, K, nu = corrected(X, [x[-1] for x in X], mean, cov, y, R, Wm, Wc)
        mean = ca.vertcat(ca.fmax(mean[:4], problem.least[:4]), mean[4:])
        e, samples = y - mean[-1], ca.fmin(samples + 1, problem.window)
        noise = (innovation + (nu * nu - innovation) / samples, residual + (e * e - residual) / samples, samples)
        return ca.Function("step", [state, sample], [ca.vertcat(mean, ca.vec(cov), K, *noise)])

    return build, np.concatenate([problem.start.mean, problem.start.cov.ravel(), np.zeros(n + 3)])


def draw(mean: ca.SX, cov: ca.SX, spread: float) -> list[ca.SX]:
    """2 n + 1 sigma points."""
    offsets = [np.sqrt(spread) * column for column in ca.horzsplit(ca.chol(cov).T)]
    return [mean, *(mean + d for d in offsets), *(mean - d for d in offsets)]


def centred(X: list, Wm: np.ndarray) -> tuple:
    """Mean and deviations."""
    mean = sum(w * x for w, x in zip(Wm, X, strict=True))
    return mean, [x - mean for x in X]


def product(A: list, B: list, Wc: np.ndarray) -> ca.SX:
    """Weighted sum of the outer products."""
    return sum(w * a @ b.T for w, a, b in zip(Wc, A, B, strict=True))


def corrected(X: list, Y: list, mean: ca.SX, cov: ca.SX, y: ca.SX, R: ca.SX, Wm: np.ndarray, Wc: np.ndarray) -> tuple:
    """Mean and covariance after the measurement, gain and innovation."""
    y_hat, E = centred(Y, Wm)
    S = product(E, E, Wc) + R
    K = product([x - mean for x in X], E, Wc) / S
    nu = y - y_hat
    return mean + K * nu, cov - S * K @ K.T, K, nu
