"""Marginal distribution of the capacity, which a curve with knees makes skewed: a Gaussian at its mode is too sure.

On a grid of capacities q = ln Q, all else is fitted (Laplace, as in Rue et al. 2009, J. R. Stat. Soc. B 71, 319):

    -2 ln p(q) = cost(x_q) + ln det H_q       x_q, H_q the most likely other unknowns at q and their Hessian

Mean and variance of that distribution take the place of those at the mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.solve import Normals, SocAnchor, Solution, solve
from ohmward.battery.learning.voltage_model import VoltageModel

#: Steps of the grid to either side: the first in standard deviations at the mode, each longer than the one before by a
#: factor, at most so many, and none beyond so large a -2 ln of the density over that of the mode.
_FIRST, _LONGER, _MOST, _FAR = 0.8, 1.5, 7, 12.0
#: A part reaches a new stretch of the curve where it ends so far below all others, beyond the error of its SoC.
_DEEPER = 0.01
#: An anchor below this SoC is a cut-off, not a full charge.
_HALF = 0.5
#: Where -2 ln of the density falls so much below that of the mode, there is another hill, too far away for a model that
#: is linear about this one: such a log does not tell the capacity. Between two hills it rises by so much; a fall
#: without a rise is the same hill, whose top the search has not quite reached.
_HIGHER, _BARRIER = 3.0, 0.5
#: Least first step, and steps of the search at each point.
_LEAST_STEP, _STEPS = 0.002, 4
#: Every so many rows are enough for it, and never fewer than so many.
_COARSE, _ROWS = 10, 300


def capacity_marginal(model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], found: Solution) -> Normal:
    """Mean and standard deviation of the correction of the logarithm of the capacity; its prior where it has hills.

    Some rows are enough for a log that has one hill. Where they show another one, all rows are asked of a log that
    counts the charge between full charges and cut-offs more than once; any other one does not tell the capacity.
    """
    q = model.parameters.group("capacity").start
    some = max(1, min(_COARSE, model.rows.size // _ROWS))
    cut_offs = sum(a.soc < _HALF for a in anchors)
    counted = min(cut_offs, len(anchors) - cut_offs) > 1
    for every in (some, 1) if counted else (some,):
        points = _scan(model.linear_about(found.x, every), prior, anchors, found)
        if points:
            return moments(points)
    return Normal(float(prior.mean[q]), float(np.sqrt(prior.covariance[q, q])))


def _scan(model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], found: Solution) -> dict[float, float]:
    """-2 ln of the density by the correction of ln Q about a solution; empty where it is not the highest hill."""
    q = model.parameters.group("capacity").start
    step = max(_FIRST * float(np.sqrt(found.covariance[q, q])), _LEAST_STEP)
    x, cost = _profile(model, prior, anchors, found.x, float(found.x[q]), found.misfit)
    points = {float(found.x[q]): cost}
    for side in (1.0, -1.0):
        value, width, here = float(found.x[q]), step, x
        for _ in range(_MOST):
            value += side * width
            here, there = _profile(model, prior, anchors, here, value, found.misfit)
            if there < cost - _HIGHER and max(points.values()) > cost + _BARRIER:
                return {}
            points[value] = there
            width *= _LONGER
            if there > min(points.values()) + _FAR:
                break
    return points


def _profile(
    model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], start: np.ndarray, value: float, misfit: float
) -> tuple[np.ndarray, float]:
    """The most likely unknowns at a capacity, and -2 ln of its marginal density up to a constant."""
    q = model.parameters.group("capacity").start
    there = solve(model, prior, anchors, start, _STEPS, {q: value}, misfit)
    others = np.delete(np.arange(start.size), q)
    return there.x, there.cost + float(np.linalg.slogdet(there.hessian[np.ix_(others, others)])[1])


def moments(points: Mapping[float, float]) -> Normal:
    """Mean and standard deviation of a density by -2 ln of it at some points, by trapezoids."""
    grid = np.array(sorted(points))
    cost = np.array([points[value] for value in grid])
    widths = 0.5 * (np.diff(grid, prepend=grid[0]) + np.diff(grid, append=grid[-1]))
    weight = widths * np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    mean = float(weight @ grid)
    return Normal(mean, float(np.sqrt(weight @ (grid - mean) ** 2)))


def with_capacity(model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], found: Solution) -> Solution:
    """The solution with the distribution of the capacity that its part can tell.

    A part that reaches below all that logs have shown tells it by the knee at empty, a cut-off by where empty is. Any
    other part tells nothing of it: along the charge below full the curve is the same whatever the capacity is.
    """
    q, knowledge = model.parameters.group("capacity").start, model.battery.knowledge
    lowest_soc = float(found.charge.soc.min())
    if knowledge is None or lowest_soc < knowledge.seen_from_soc - _DEEPER:
        return with_marginal(model, prior, anchors, found, capacity_marginal(model, prior, anchors, found))
    if any(anchor.soc < _HALF for anchor in anchors):
        return found
    return _with_variance(found, q, max(float(prior.covariance[q, q]), float(found.covariance[q, q])))


def with_marginal(
    model: VoltageModel, prior: Normals, anchors: Sequence[SocAnchor], found: Solution, marginal: Normal
) -> Solution:
    """The solution at the mean of the capacity, all others fitted to it, and with its variance."""
    q = model.parameters.group("capacity").start
    there = solve(model, prior, anchors, found.x, _STEPS, {q: marginal.mean})
    return _with_variance(there, q, marginal.std**2)


def _with_variance(found: Solution, q: int, variance: float) -> Solution:
    """The solution with this variance of the unknown q; all others follow as their covariance with it says."""
    slope = found.covariance[:, q] / found.covariance[q, q]
    added = variance - found.covariance[q, q]
    return found._replace(covariance=found.covariance + added * np.outer(slope, slope))
