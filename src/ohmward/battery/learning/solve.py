"""Most likely corrections of a battery given a part of a log: Gauss-Newton on the posterior, with its covariance.

    minimise  (x - m)' P^-1 (x - m) + sum w rho((y - V(x))^2 / R) + sum ((soc_a - s_a(x)) / std_a)^2

An error of the model holds on for minutes: a sample counts w = row time / (2 correlation time), as in the filter's R.
Samples that do not fit count less (pseudo-Huber), and all count less where they err by more than their R says.

A curve with knees makes the distribution of the capacity skewed: a Gaussian at its mode is too sure. On a grid of
capacities q = ln Q, all else is fitted (Laplace, as in Rue et al. 2009, J. R. Stat. Soc. B 71, 319):

    -2 ln p(q) = cost(x_q) + ln det H_q       x_q, H_q the most likely other unknowns at q and their Hessian

Mean and variance of that distribution take the place of those at the mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import Normal
from ohmward.battery.learning.voltage_model import ChargeAlong, VoltageModel, VoltagePrediction
from ohmward.battery.models.noise import BatteryNoise

#: Errors beyond so many standard deviations count less.
_ROBUST_AT = 2.5
#: Most steps, halvings of one, and the step, in posterior standard deviations, at which the search has ended.
_MOST_STEPS, _MOST_HALVINGS, _SMALL_STEP = 10, 5, 0.03
#: The cost may rise by so much in a step: the slope of the curve is a mean, so that no step is quite downhill.
_SLACK = 0.5
#: The model errs by this share of the overpotential at least, however many parameters fit it; more than
#: `_LARGEST_SHARE` is what the parameters themselves leave open before they are learnt.
_LARGEST_SHARE = 0.1
#: Rounds in which the misfit is found, and by what factor it may still grow.
_ROUNDS, _SAME_MISFIT = 2, 1.05
#: Share of the rows that a sensor may have spoilt.
_GLITCHES = 0.05
#: Keeps the offset that a rest shows from being exact [A].
_LEAST_OFFSET_A = 1e-6
#: Error of SoC from sample to sample, which the slope of the curve turns into one of the voltage.
_SOC_STD = 0.003
#: SoC cannot leave 0 to 1 but for the error of full and empty themselves.
_BOUND_STD = 0.01


class SocAnchor(NamedTuple):
    """SoC that something else than the voltage tells: the sample, the SoC and its standard deviation."""

    sample: int
    soc: float
    std: float


class Normals(NamedTuple):
    """Gaussian prior of all unknowns (n,): mean and covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


class Solution(NamedTuple):
    """The most likely unknowns of a part.

    x, hessian: (n,) parameters and nuisances, and (n, n) that of half the cost; covariance: (n, n).
    cost: sum of squares at the minimum.
    residual_V: (N,) measured minus expected voltage in the rows; variance_V2: (N,) what was expected of its square.
    weight: (N,) of each row.  misfit: factor by which the residuals exceed their variance, 1 where they do not.
    charge: charge and state of charge at every sample.
    """

    x: np.ndarray
    hessian: np.ndarray
    covariance: np.ndarray
    cost: float
    residual_V: np.ndarray
    variance_V2: np.ndarray
    weight: np.ndarray
    misfit: float
    charge: ChargeAlong


class _Rows(NamedTuple):
    """A linear least-squares problem about a point: weighted residuals (R,), derivatives (R, n) and their cost."""

    residual: np.ndarray
    columns: np.ndarray
    cost: float
    prediction: VoltagePrediction  #: at the point


def solve(
    model: VoltageModel,
    prior: Normals,
    anchors: Sequence[SocAnchor],
    start: np.ndarray,
    most_steps: int = _MOST_STEPS,
    fixed: Mapping[int, float] | None = None,
    misfit: float | None = None,
) -> Solution:
    """The solution from a start (n,), its rows counting less where they err by more than their variance.

    fixed: values of unknowns that are not sought, by their place.
    misfit: factor on the variance of the rows; None finds it.
    """
    x = start.copy()
    for k, value in (fixed or {}).items():
        x[k] = value
    search = _Search(model, prior.mean, np.linalg.inv(prior.covariance), anchors, tuple(fixed or ()))
    factor = misfit or 1.0
    for _ in range(_ROUNDS if misfit is None else 1):
        x, H, there = search.minimise(x, factor, most_steps)
        residual_V, variance_V2, weight = search.errors(there.prediction)
        found = misfit_of(residual_V, variance_V2)
        if misfit is not None or found <= _SAME_MISFIT * factor:
            break
        factor = found
    charge = there.prediction.charge
    return Solution(x, H, np.linalg.inv(H), there.cost, residual_V, variance_V2, weight / factor, factor, charge)


def misfit_of(residual_V: np.ndarray, variance_V2: np.ndarray) -> float:
    """Factor by which the squares of the residuals exceed their variance on average, at least 1.

    The `_GLITCHES` that fit worst are left out: the robust weights have them.
    """
    square = np.sort(residual_V**2 / variance_V2)
    usual = square[: square.size - int(_GLITCHES * square.size)]
    return max(float(usual.mean()), 1.0) if usual.size else 1.0


class _Search:
    """The search for the minimum of one part."""

    def __init__(
        self,
        model: VoltageModel,
        mean: np.ndarray,
        precision: np.ndarray,
        anchors: Sequence[SocAnchor],
        fixed: Sequence[int] = (),
    ):
        self.model, self.mean, self.precision, self.anchors = model, mean, precision, anchors
        self.free = np.array([k for k in range(mean.size) if k not in fixed])
        self.measured_V = model.samples.voltage_V[model.rows]
        noise: BatteryNoise = model.battery.noise
        self.white_V2 = noise.voltage_std_V**2
        row_s = model.samples.row_s * model.samples.rows.size / max(model.rows.size, 1)
        self.weight = np.full(model.rows.size, row_s / max(row_s, 2 * noise.correlation_s))
        # of an error that holds on, the first sample is as good as any: a rest before a drive counts
        self.weight[np.unique(np.searchsorted(model.rows, model.starts).clip(0, model.rows.size - 1))] = 1.0
        self.offset_std_A = max(model.battery.sensor.noise_std_A, _LEAST_OFFSET_A)

    def minimise(self, x: np.ndarray, misfit: float, most_steps: int) -> tuple[np.ndarray, np.ndarray, _Rows]:
        """The minimum, the Hessian (n, n) and the rows there."""
        here = self.problem(x, misfit)
        H = self.hessian(here)
        for _ in range(most_steps):
            gradient = here.columns.T @ here.residual + self.precision @ (self.mean - x)
            step = np.zeros(x.size)
            step[self.free] = np.linalg.solve(H[np.ix_(self.free, self.free)], gradient[self.free])
            shorter = 1.0
            for _ in range(_MOST_HALVINGS):
                there = self.problem(x + shorter * step, misfit)
                if there.cost <= here.cost + _SLACK:
                    break
                shorter *= 0.5
            else:
                break
            small = shorter**2 * step @ H @ step < _SMALL_STEP**2 * step.size
            x, here = x + shorter * step, there
            H = self.hessian(here)
            if small:
                break
        return x, H, here

    def hessian(self, rows: _Rows) -> np.ndarray:
        """Of half the cost, by Gauss and Newton."""
        return rows.columns.T @ rows.columns + self.precision

    def problem(self, x: np.ndarray, misfit: float) -> _Rows:
        """Residuals about x over their standard deviations, and the cost."""
        p = self.model.predict(x)
        residual_V, variance_V2, weight = self.errors(p)
        square = residual_V**2 / (variance_V2 * misfit)
        robust = 1.0 / np.sqrt(1.0 + square / _ROBUST_AT**2)
        scale = np.sqrt(weight * robust / (variance_V2 * misfit))
        pseudo_huber = 2 * _ROBUST_AT**2 * (1.0 / robust - 1.0)
        of_soc, soc_columns = self.soc_rows(x, p.charge)
        of_offset, offset_columns = self.model.offset_rows(x)
        of_anchors = np.concatenate([of_soc, of_offset / self.offset_std_A])
        residual = np.concatenate([scale * residual_V, of_anchors])
        columns = np.vstack([scale[:, None] * p.voltage_columns, soc_columns, offset_columns / self.offset_std_A])
        off = x - self.mean
        # the width of the errors depends on x: without its logarithm a large overpotential would excuse any residual
        width = weight @ np.log(variance_V2)
        cost = weight @ pseudo_huber + of_anchors @ of_anchors + off @ self.precision @ off + width
        return _Rows(residual, columns, float(cost), p)

    def errors(self, p: VoltagePrediction) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N,) residual [V], its variance as of a single sample [V^2], and the weight of the row."""
        share = np.minimum(self.model.share_at(p.soc), _LARGEST_SHARE)
        slope = p.voltage_columns[:, self.model.parameters.size + self.model.nuisances.soc]
        variance = self.white_V2 + share**2 * p.over_V2 + (_SOC_STD * slope) ** 2
        return self.measured_V - p.voltage_V, variance, self.weight

    def soc_rows(self, x: np.ndarray, charge: ChargeAlong) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the anchors, and of SoC where it would leave 0 to 1 most."""
        soc = charge.soc
        highest, lowest = int(np.argmax(soc)), int(np.argmin(soc))
        rows = list(self.anchors)
        if soc[highest] > 1.0:
            rows.append(SocAnchor(highest, 1.0, _BOUND_STD))
        if soc[lowest] < 0.0:
            rows.append(SocAnchor(lowest, 0.0, _BOUND_STD))
        if not rows:
            return np.zeros(0), np.zeros((0, x.size))
        at, std = np.array([row.sample for row in rows]), np.array([row.std for row in rows])
        residual = np.array([row.soc for row in rows]) - soc[at]
        return residual / std, charge.soc_columns(at) / std[:, None]


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
