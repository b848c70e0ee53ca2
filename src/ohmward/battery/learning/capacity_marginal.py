"""Marginal distribution of the capacity, which a curve with knees makes skewed: a Gaussian at its mode is too sure.

On a grid of capacities q = ln Q, all else is fitted (Laplace, as in Rue et al. 2009, J. R. Stat. Soc. B 71, 319):

    -2 ln p(q) = cost(x_q) + ln det H_q       x_q, H_q the most likely other unknowns at q and their Hessian

Mean and variance of that distribution take the place of those at the mode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.solve import Normals, SocAnchor, Solution, solve_at
from ohmward.battery.learning.voltage_model import VoltageModel

#: Points of the grid in standard deviations at the mode, the least of them, and steps of the search at each.
_GRID, _LEAST_STD, _STEPS = np.arange(-4, 5), 0.01, 3
#: Every so many rows are enough for it, and never fewer than so many.
_COARSE, _ROWS = 10, 300


def capacity_marginal(model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], found: Solution) -> Normal:
    """Mean and standard deviation of the correction of the logarithm of the capacity."""
    q = model.parameters.group("capacity").start
    every = max(1, min(_COARSE, model.rows.size // _ROWS))
    coarse = model.linear_about(found.x, every)
    std = max(float(np.sqrt(found.covariance[q, q])), _LEAST_STD)
    grid = found.x[q] + std * _GRID
    costs = np.zeros(grid.size)
    middle = grid.size // 2
    for side in (range(middle, grid.size), range(middle - 1, -1, -1)):
        x = found.x
        for k in side:
            x, costs[k] = solve_at(coarse, prior, anchors, x, q, float(grid[k]), found.misfit, _STEPS)
    density = np.exp(-0.5 * (costs - costs.min()))
    density /= density.sum()
    mean = float(density @ grid)
    return Normal(mean, float(np.sqrt(density @ (grid - mean) ** 2)))


def with_marginal(found: Solution, q: int, marginal: Normal) -> Solution:
    """The solution with this distribution of the unknown q; all others follow as their covariance with it says."""
    slope = found.covariance[:, q] / found.covariance[q, q]
    variance = marginal.std**2 - found.covariance[q, q]
    return found._replace(
        x=found.x + slope * (marginal.mean - found.x[q]),
        covariance=found.covariance + variance * np.outer(slope, slope),
    )
