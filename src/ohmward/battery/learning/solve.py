"""Most likely corrections of a battery given a part of a log, and their covariance, by the search of `posterior`.

Besides the voltages, anchors give the SoC: ((soc_a - s_a(x)) / std_a)^2. A voltage counts w = row time / (2 correlation
time), as in the filter's R, and all voltages count less where their errors are larger than R.

A curve with knees makes the distribution of the capacity skewed: a Gaussian at its mode is too narrow. On a grid of
capacities q = ln Q, all else is fitted (Laplace, as in Rue et al. 2009, J. R. Stat. Soc. B 71, 319):

    -2 ln p(q) = cost(x_q) + ln det H_q       x_q, H_q the most likely other unknowns at q and their Hessian

Mean and variance of that distribution take the place of those at the mode.

Where empty and full lie on the curve errs alike in all rows, however many there are. These two errors d are considered,
not sought (Schmidt 1966, Adv. Control Syst. 3, 293), with J, W and J_d the rows' derivatives, weights, and derivatives
by the two places:

    P = H^-1 + G diag(std_d^2) G'       G = H^-1 J' W J_d       J_d = dV/dz [1 - z, z]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ohmward.battery.chemistries import CHEMISTRIES, Normal
from ohmward.battery.learning.voltage_model import ChargeAlong, OpenCircuit, VoltageModel
from ohmward.battery.posterior import (
    OVERPOTENTIAL_STD,
    Gaussian,
    Unknowns,
    gauss_newton,
    hessian,
    pseudo_huber,
    robust_weights,
    variances,
    voltage_variance,
)
from ohmward.battery.soc.anchor_rule import SocAnchor
from ohmward.filters.belief import Belief

#: Most steps of the search.
_MOST_STEPS = 10
#: Rounds in which the misfit is found, and factor by which it may still grow.
_MISFIT_ROUNDS, _SAME_MISFIT = 2, 1.05
#: Share of the rows that a sensor may have spoilt.
_GLITCHES = 0.05
#: Smallest error of the offset that a rest shows [A].
_LEAST_OFFSET_A = 1e-6
#: SoC can leave 0 to 1 only by the error of full and empty themselves.
_BOUND_STD = 0.01


class Solution(NamedTuple):
    """The most likely unknowns of a part."""

    x: np.ndarray  #: (n,) parameters of the battery and unknowns of the part
    hessian: np.ndarray  #: (n, n) of half the cost
    within: np.ndarray  #: (n, n) its inverse, the covariance as if the curve were right
    covariance: np.ndarray  #: (n, n)
    cost: float  #: at the minimum, up to a constant
    residual_V: np.ndarray  #: (N,) measured minus expected voltage in the rows
    variance_V2: np.ndarray  #: (N,) its expected variance
    weight: np.ndarray  #: (N,) of each row
    misfit: float  #: factor by which the residuals exceed their variance, 1 where they do not
    charge: ChargeAlong  #: charge and state of charge at every sample
    capacity_known: bool = True  #: False where the part does not show the capacity

    @property
    def ends_std(self) -> np.ndarray:
        """(2,) standard deviations of the highest and the lowest SoC of the part, as if the curve were right."""
        soc = self.charge.soc
        columns = self.charge.soc_columns(np.array([np.argmax(soc), np.argmin(soc)]))
        return np.sqrt(variances(columns, self.within))


class PartRows(NamedTuple):
    """Rows of a part about a point."""

    residual: np.ndarray  #: (R,) over the standard deviations
    columns: np.ndarray  #: (R, n) derivatives, over the same
    of_places: np.ndarray  #: (R, 2) derivatives by the places of empty and full on the curve, over the same
    cost: float
    residual_V: np.ndarray  #: (N,) measured minus expected voltage
    variance_V2: np.ndarray  #: (N,) expected variance of a single sample
    charge: ChargeAlong


@dataclass(frozen=True, eq=False)
class PartProblem:
    """Voltages, prior and anchors of one part of a log."""

    model: VoltageModel
    prior: Belief  #: of all unknowns (n,)
    anchors: Sequence[SocAnchor]

    def coarse(self, x: np.ndarray, every: int) -> PartProblem:
        """The problem with every `every`-th row, its circuit linear about x (n,): much quicker."""
        return replace(self, model=self.model.linear_about(x, every))

    @property
    def capacity(self) -> int:
        """Place of the correction of the logarithm of the capacity."""
        return self.model.parameters.group("capacity").start

    @cached_property
    def density(self) -> Gaussian:
        """The prior as precision and information."""
        precision = np.linalg.inv(self.prior.cov)
        return Gaussian(precision, precision @ self.prior.mean)

    @cached_property
    def weight(self) -> np.ndarray:
        """(N,) number of voltages that each row counts as."""
        model, rows = self.model, self.model.rows
        row_s = model.samples.row_s * model.samples.rows.size / max(rows.size, 1)
        weight = np.full(rows.size, row_s / max(row_s, 2 * model.battery.noise.correlation_s))
        # the first sample of a persistent error is as good as any: a rest before a drive counts
        first = np.searchsorted(rows, model.starts).clip(0, rows.size - 1)
        weight[first] = 1.0
        return weight

    def about(self, x: np.ndarray, misfit: float) -> PartRows:
        """The rows about the unknowns x (n,); misfit: factor on the variance of the voltages."""
        p, noise = self.model.predict(x), self.model.battery.noise
        share = np.minimum(noise.overpotential_share_at(p.soc), OVERPOTENTIAL_STD)
        slope_V = p.voltage_columns[:, self.model.unknowns.group("start soc").start]
        variance_V2 = voltage_variance(noise.voltage_std_V, share, p.over_V2, slope_V)
        residual_V = self.model.samples.voltage_V[self.model.rows] - p.voltage_V
        robust = robust_weights(residual_V**2 / (variance_V2 * misfit))
        scale = np.sqrt(self.weight * robust / (variance_V2 * misfit))
        of_soc, soc_columns = self.soc_rows(x, p.charge)
        of_offset, offset_columns = self.model.offset_rows(x)
        offset_std_A = max(self.model.battery.sensor.noise_std_A, _LEAST_OFFSET_A)
        of_anchors = np.concatenate([of_soc, of_offset / offset_std_A])
        columns = np.empty((scale.size + of_anchors.size, x.size))
        np.multiply(scale[:, None], p.voltage_columns, out=columns[: scale.size])
        columns[scale.size :] = np.vstack([soc_columns, offset_columns / offset_std_A])
        # the width of the errors depends on x: without its logarithm a large overpotential would excuse any residual
        width = self.weight @ np.log(variance_V2)
        cost = float(self.weight @ pseudo_huber(robust) + of_anchors @ of_anchors + width)
        residual = np.concatenate([scale * residual_V, of_anchors])
        soc = p.soc.clip(0.0, 1.0)
        of_places = np.zeros((residual.size, 2))
        of_places[: soc.size] = (scale * slope_V)[:, None] * np.column_stack([1.0 - soc, soc])
        return PartRows(residual, columns, of_places, cost, residual_V, variance_V2, p.charge)

    def soc_rows(self, x: np.ndarray, charge: ChargeAlong) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the anchors, and of SoC where it lies furthest outside 0 to 1."""
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


def solve(
    problem: PartProblem,
    start: np.ndarray,
    most_steps: int = _MOST_STEPS,
    capacity: float | None = None,
    misfit: float | None = None,
) -> Solution:
    """The solution from a start (n,), with rows counting less where their errors are larger than their variance.

    capacity: correction of the logarithm of the capacity, if it is not sought.
    misfit: factor on the variance of the rows; None finds it.
    """
    x, free = start.copy(), np.ones(start.size, dtype=bool)
    if capacity is not None:
        x[problem.capacity], free[problem.capacity] = capacity, False

    def minimum(H: np.ndarray, gradient: np.ndarray, x: np.ndarray) -> np.ndarray:
        there = x.copy()
        there[free] += np.linalg.solve(H[np.ix_(free, free)], gradient[free])
        return there

    density = problem.density
    factor = misfit or 1.0
    for _ in range(_MISFIT_ROUNDS if misfit is None else 1):
        x, there = gauss_newton(partial(problem.about, misfit=factor), density, x, most_steps, minimum)
        found = misfit_of(there.residual_V, there.variance_V2)
        if misfit is not None or found <= _SAME_MISFIT * factor:
            break
        factor = found
    H = hessian(there.columns, density)
    within = np.linalg.inv(H)
    solution = Solution(
        x=x,
        hessian=H,
        within=within,
        covariance=within,
        cost=there.cost + density.cost(x),
        residual_V=there.residual_V,
        variance_V2=there.variance_V2,
        weight=problem.weight / factor,
        misfit=factor,
        charge=there.charge,
    )
    moved = within @ (there.columns.T @ there.of_places) * place_std(problem, solution)
    return solution._replace(covariance=within + moved @ moved.T)


def misfit_of(residual_V: np.ndarray, variance_V2: np.ndarray) -> float:
    """Factor by which the squares of the residuals exceed their variance on average, at least 1.

    The share `_GLITCHES` that fits worst is left out: the robust weights take care of it.
    """
    square = np.sort(residual_V**2 / variance_V2)
    usual = square[: square.size - int(_GLITCHES * square.size)]
    return max(float(usual.mean()), 1.0) if usual.size else 1.0


#: Steps of the grid to either side: the first in standard deviations at the mode, factor from one to the next, largest
#: number, and rise of -2 ln of the density above its minimum at which they end.
_FIRST_STEP_STDS, _STEP_FACTOR, _MOST_GRID_STEPS, _END_RISE = 0.8, 1.5, 7, 12.0
#: A part reaches a new stretch of the curve where it goes this far below all others, beyond the error of its SoC.
_DEEPER = 0.01
#: An anchor below this SoC is a cut-off, not a full charge.
_HALF = 0.5
#: A part shows its SoC where an event gives it, or a steep end does as surely as a charger. From 24 to 82 % of charge,
#: flat curves that fitted well were 4 to 16 points off.
LOCATED_STD = 0.01
#: Errors of full and empty on the curve of a label where both are located: chargers differ, and a cell that rested at
#: the voltage of empty had 1 to 3 % left after drives at -15 to 45 degC. Above that voltage cells of a chemistry are as
#: far apart as everywhere: between 2.9 and 3.0 V those of LFP had 2 to 10 % left.
_FULL_PLACE_STD, _EMPTY_PLACE_STD = 0.01, 0.02
#: Share of the voltage of empty by which cut-offs differ; voltages there that a sensor may have spoilt.
_CUT_OFF_SHARE, _SPOILT = 0.02, 2
#: A part shows the capacity where it can give it with less than this share of the variance known before. Else it stays:
#: the errors of a label's flat curve are all that would move it, and they are the same in every log.
_INFORMED_SHARE = 1.0 / 3.0
#: Where -2 ln of the density falls this much below that of the mode, there is another mode, too far away for a model
#: that is linear about this one: such a log does not give the capacity. Between two modes it rises by this much; a fall
#: without a rise is the same mode, whose top the search has not quite reached.
_HIGHER, _BARRIER = 3.0, 0.5
#: Smallest first step, and steps of the search at each point.
_LEAST_STEP, _SEARCH_STEPS = 0.002, 4
#: Largest spacing of the rows that are used, and fewest rows.
_COARSE, _MARGINAL_ROWS = 10, 300


def capacity_marginal(problem: PartProblem, found: Solution) -> Normal | None:
    """Mean and standard deviation of the correction of the logarithm of the capacity; None with several modes.

    Some rows are enough for a log that has one mode. Where they show another one, all rows are used for a log that
    counts the charge between full charges and cut-offs more than once; any other log does not give the capacity.
    """
    some = max(1, min(_COARSE, problem.model.rows.size // _MARGINAL_ROWS))
    cut_offs = sum(a.soc < _HALF for a in problem.anchors)
    counted = min(cut_offs, len(problem.anchors) - cut_offs) > 1
    for every in (some, 1) if counted else (some,):
        points = _scan(problem.coarse(found.x, every), found)
        if points:
            q = problem.capacity
            return moments(points, float(np.sqrt(found.covariance[q, q])))
    return None


def _scan(problem: PartProblem, found: Solution) -> dict[float, float]:
    """-2 ln of the density by the correction of ln Q about a solution; empty where it is not the highest mode."""
    q = problem.capacity
    middle = float(found.x[q])
    first_step = max(_FIRST_STEP_STDS * float(np.sqrt(found.covariance[q, q])), _LEAST_STEP)
    x, cost = _profile(problem, found.x, middle, found.misfit)
    points = {middle: cost}
    for step in (first_step, -first_step):
        value, here = middle, x
        for _ in range(_MOST_GRID_STEPS):
            value += step
            step *= _STEP_FACTOR
            here, there = _profile(problem, here, value, found.misfit)
            if there < cost - _HIGHER and max(points.values()) > cost + _BARRIER:
                return {}
            points[value] = there
            if there > min(points.values()) + _END_RISE:
                break
    return points


def _profile(problem: PartProblem, start: np.ndarray, capacity: float, misfit: float) -> tuple[np.ndarray, float]:
    """The most likely unknowns at a capacity, and -2 ln of its marginal density up to a constant."""
    there = solve(problem, start, _SEARCH_STEPS, capacity, misfit)
    others = np.arange(start.size) != problem.capacity
    narrowed = float(np.linalg.slogdet(there.hessian[np.ix_(others, others)])[1])
    return there.x, there.cost + narrowed


def moments(points: Mapping[float, float], least_std: float = 0.0) -> Normal:
    """Mean and standard deviation of a density from -2 ln of it at some points, by the trapezoidal rule.

    least_std: smallest standard deviation, that at the mode: points so far apart resolve no narrower density.
    """
    grid = np.array(sorted(points))
    cost = np.array([points[value] for value in grid])
    widths = 0.5 * (np.diff(grid, prepend=grid[0]) + np.diff(grid, append=grid[-1]))
    weight = widths * np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    mean = float(weight @ grid)
    return Normal(mean, max(float(np.sqrt(weight @ (grid - mean) ** 2)), least_std))


def place_std(problem: PartProblem, found: Solution) -> np.ndarray:
    """(2,) standard deviations of the places of empty and full on the curve."""
    located = found.ends_std.max() < LOCATED_STD and came_to_empty(problem.model, found)
    of_curve = np.full(2, problem.model.battery.noise.soc_axis_std)
    return np.minimum(of_curve, (_EMPTY_PLACE_STD, _FULL_PLACE_STD)) if located else of_curve


def count_error2(problem: PartProblem, found: Solution) -> float:
    """Variance of a capacity by the charge of the part, without that of its offset."""
    return capacity_error2(place_std(problem, found), problem.anchors, float(np.ptp(found.charge.soc)))


def came_to_empty(model: VoltageModel, found: Solution) -> bool:
    """Whether the voltages of the part, less their overpotentials, have come down to that of the chemistry's empty."""
    battery = model.battery
    curve = OpenCircuit(battery, found.x[: model.parameters.size], model.parameters)
    expected_V = curve.at(found.charge.charge[model.rows], model.samples.temperature_degC[model.rows])
    lowest_V = np.sort(expected_V + found.residual_V)[: _SPOILT + 1]
    empty_V = battery.n_series * CHEMISTRIES[battery.chemistry].ocv_V[0]
    return bool(lowest_V[-1] <= (1.0 + _CUT_OFF_SHARE) * empty_V)


def with_capacity(problem: PartProblem, found: Solution, error2: float) -> Solution:
    """The solution with the distribution of the capacity that its part supports.

    error2: see `count_error2`.

    A part that reaches below all earlier logs shows it by the knee at empty, a cut-off by the place of empty. Any other
    part says nothing about it but by its offset: along the charge below full the curve is the same whatever the
    capacity is. Nor does one whose curve and anchors could be that far off (`capacity_error2`).
    """
    knowledge = problem.model.battery.knowledge
    of_offset = capacity_by_offset(problem.model.parameters, problem.prior, Belief(found.x, found.covariance))
    if knowledge is None or found.charge.soc.min() < knowledge.seen_from_soc - _DEEPER:
        informed = error2 < _INFORMED_SHARE * of_offset.std**2
        marginal = capacity_marginal(problem, found) if informed else None
        if marginal is None:
            return with_marginal(problem, found, of_offset)._replace(capacity_known=False)
        gain = of_offset.std**2 / (of_offset.std**2 + error2)
        at_least = float(np.sqrt(gain * error2))
        return with_marginal(problem, found, Normal(marginal.mean, max(marginal.std, at_least)))
    if any(anchor.soc < _HALF for anchor in problem.anchors):
        return found
    return with_marginal(problem, found, of_offset)


def capacity_by_offset(p: Unknowns, prior: Belief, found: Belief) -> Normal:
    """Correction of the logarithm of the capacity, by the prior and what was found of the sensor's offset alone."""
    q, offset = p.group("capacity").start, p.group("offset")
    gain = np.linalg.solve(prior.cov[offset, offset], prior.cov[offset, q])
    mean = prior.mean[q] + gain @ (found.mean - prior.mean)[offset]
    variance = prior.cov[q, q] - gain @ (prior.cov - found.cov)[offset, offset] @ gain
    return Normal(float(mean), float(np.sqrt(variance)))


def capacity_error2(ends_std: np.ndarray, anchors: Sequence[SocAnchor], depth: float) -> float:
    """Smallest variance of a capacity counted between two anchors, or between two places of the curve `depth` apart.

    However many voltages there are, the curve errs by ends_std (2,) at these places.
    """
    of_curve = float(ends_std @ ends_std) / max(depth, _DEEPER) ** 2
    pairs = combinations(anchors, 2)
    between = [(a.std**2 + b.std**2) / max(abs(a.soc - b.soc), _DEEPER) ** 2 for a, b in pairs]
    return min([of_curve, *between])


def with_marginal(problem: PartProblem, found: Solution, marginal: Normal) -> Solution:
    """The solution at the mean of the capacity, all others fitted to it, and with its variance.

    All others follow the capacity by their covariance with it.
    """
    q = problem.capacity
    there = solve(problem, found.x, _SEARCH_STEPS, marginal.mean)
    slope = there.covariance[:, q] / there.covariance[q, q]
    added = marginal.std**2 - there.covariance[q, q]
    return there._replace(covariance=there.covariance + added * np.outer(slope, slope))
