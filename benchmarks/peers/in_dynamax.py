"""The filters of the cell with dynamax: JAX underneath, its functions as they are, in double precision.

Its filters begin with a measurement, so they start from the prediction to the first one. It adds 1e-9 to the variance
of the innovation, which is why it agrees to fewer digits than the others.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator

from peers import in_jax

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams
    from dynamax.nonlinear_gaussian_ssm.inference_ekf import extended_kalman_filter
    from dynamax.nonlinear_gaussian_ssm.inference_ukf import unscented_kalman_filter

import jax
import jax.numpy as jnp
import numpy as np

from ohmward.filters.unscented import DEFAULT
from peers import Contestant
from workloads import CellProblem, Posterior

STEPS = in_jax.STEPS


def cell(problem: CellProblem) -> Iterator[Contestant]:
    redrawn = problem.method == "ukf"
    current_A, mean_A, voltage_V = map(jnp.asarray, problem.drive)
    inputs = jnp.column_stack([current_A, mean_A])
    F = np.diag(problem.motion(np, problem.drive.mean_A[0])[0])
    params = ParamsNLGSSM(
        initial_mean=jnp.asarray(problem.next_state(np, problem.start.mean, problem.drive.mean_A[0])),
        initial_covariance=jnp.asarray(F @ problem.start.cov @ F + problem.Q),
        dynamics_function=lambda x, u: problem.next_state(jnp, x, u[1]),
        dynamics_covariance=jnp.asarray(problem.Q),
        emission_function=lambda x, u: jnp.atleast_1d(problem.voltage(jnp, x, u[0])),
        emission_covariance=jnp.array([[problem.R]]),
    )

    @jax.jit
    def filtered(y: jax.Array, u: jax.Array) -> tuple:
        fields = ["filtered_means", "filtered_covariances"]
        if redrawn:
            found = unscented_kalman_filter(params, y, UKFHyperParams(*DEFAULT), u, output_fields=fields)
        else:
            found = extended_kalman_filter(params, y, inputs=u, output_fields=fields)
        return found.filtered_means, found.filtered_covariances

    def run(count: int) -> Posterior:
        means, covs = filtered(voltage_V[:count, None], inputs[:count])
        return Posterior(np.asarray(means)[-1], np.asarray(covs)[-1])

    began = time.perf_counter()
    run(STEPS)
    yield Contestant("dynamax", "as documented", STEPS, run, redrawn, time.perf_counter() - began)
