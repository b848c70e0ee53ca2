"""The filters in JAX: the matrix form of `numpy_by_hand` with `jit` and `scan`, `vmap` over logs; double precision."""

from __future__ import annotations

import os

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from peers import Contestant, numpy_by_hand
from workloads import CellProblem, JointProblem, Posterior

jax.config.update("jax_enable_x64", True)
STEPS, LANE_STEPS = 5000, 100


def cell(problem: CellProblem) -> Iterator[Contestant]:
    yield compiled(problem, *cell_step(problem), STEPS, "jit, scan", problem.method == "ukf")


def joint(problem: JointProblem) -> Iterator[Contestant]:
    yield compiled(problem, *joint_step(problem), STEPS, "jit, scan")


def cell_lanes(problem: CellProblem) -> Iterator[Contestant]:
    yield compiled(problem, *cell_step(problem), LANE_STEPS, "vmap, jit, scan", problem.method == "ukf")


def joint_lanes(problem: JointProblem) -> Iterator[Contestant]:
    yield compiled(problem, *joint_step(problem), LANE_STEPS, "vmap, jit, scan")


def cell_step(problem: CellProblem) -> tuple[Callable, tuple]:
    step = {"ekf": numpy_by_hand.extended_step, "ukf": numpy_by_hand.unscented_step}[problem.method]

    def scanned(state: tuple, sample: tuple) -> tuple:
        after = step(jnp, *state, *sample, problem)
        return after, after[0]

    return scanned, tuple(map(jnp.asarray, problem.start))


def joint_step(problem: JointProblem) -> tuple[Callable, tuple]:
    def scanned(state: tuple, sample: tuple) -> tuple:
        now_A, mean_A, y = sample
        after = numpy_by_hand.joint_step(jnp, state, now_A, mean_A, y, problem)
        return after, after[0]

    return scanned, numpy_by_hand.joint_start(jnp, problem)


def compiled(
    problem: CellProblem | JointProblem, step: Callable, start: tuple, steps: int, how: str, redrawn: bool = False
) -> Contestant:
    """The scan over the log, or over all logs where the drive has many."""

    def filtered(columns: tuple) -> Any:
        return jax.lax.scan(step, start, columns)

    many = problem.drive.current_A.ndim == 2
    function = jax.jit(jax.vmap(filtered, in_axes=1) if many else filtered)

    def run(count: int) -> Posterior:
        state, means = function(tuple(problem.drive.first(count)))
        jax.block_until_ready(means)
        mean, cov = (np.asarray(a)[0] if many else np.asarray(a) for a in state[:2])
        return Posterior(mean, cov)

    began = time.perf_counter()
    run(steps)
    return Contestant("JAX", how, steps, run, redrawn, time.perf_counter() - began)
