"""States of charge from which a part of a log may have begun, so that the search is worth a try from each.

The voltage of a flat curve fits several of them. Each is a hill of the posterior, and a search finds only its own.
"""

from __future__ import annotations

import numpy as np

from ohmward.battery.identification.circuit_design import hat
from ohmward.battery.learning.parameters import OCV_KNOTS, prior_covariance
from ohmward.battery.learning.solve import SocAnchor
from ohmward.battery.learning.voltage_model import VoltageModel
from ohmward.logs.log import SECONDS_PER_HOUR

#: States of charge that are looked at, and how many hills are climbed at most.
_GRID = np.linspace(0.0, 1.0, 41)
_MOST_STARTS = 4
#: Rows that are looked at.
_ROWS = 400
#: A hill that is so much higher than another, as a difference of -2 ln p, is alone.
_CLEAR = 60.0
#: Step of SoC for the slope of the curve, width of the bounds of SoC, and least variance of the curve [V^2].
_HALF_STEP, _BOUND_STD, _LEAST_V2 = 0.005, 0.05, 1e-12


def likely_starts(model: VoltageModel, x: np.ndarray, anchors: tuple[SocAnchor, ...]) -> list[float]:
    """States of charge at the start, the most likely first, at the unknowns x (n,) otherwise."""
    rows = model.rows[:: max(1, model.rows.size // _ROWS)]
    coarse = VoltageModel(model.battery, model.samples, rows)
    costs = _costs(coarse, x, anchors)
    lower_than_before = np.concatenate([[True], costs[1:] <= costs[:-1]])
    lower_than_after = np.concatenate([costs[:-1] <= costs[1:], [True]])
    hills = np.flatnonzero(lower_than_before & lower_than_after & (costs < costs.min() + _CLEAR))
    best = hills[np.argsort(costs[hills])][:_MOST_STARTS]
    return [float(_GRID[k]) for k in best]


def _costs(model: VoltageModel, x: np.ndarray, anchors: tuple[SocAnchor, ...]) -> np.ndarray:
    """(G,) cost of each start: of the voltage, with an error of the curve along all of SoC, of anchors and bounds.

    The overpotentials are those of one start: they depend little on SoC.
    """
    place = model.parameters.size + model.nuisances.soc
    p = model.predict(x)
    noise, ocv, degC = model.battery.noise, model.model.ocv, model.samples.temperature_degC[model.rows]
    over_V = p.voltage_V - np.asarray(ocv.mean_V(p.soc, degC))
    group = model.parameters.group("ocv")
    prior = np.linalg.inv(prior_covariance(model.battery)[group, group] + _LEAST_V2 * np.eye(OCV_KNOTS.size))
    share = model.share_at(p.soc) + noise.resistance_std
    counts = min(1.0, model.samples.hours * SECONDS_PER_HOUR / (2 * noise.correlation_s) / max(p.soc.size, 1))
    costs = []
    for start in _GRID:
        soc, everywhere = p.soc + (start - x[place]), p.soc_anywhere + (start - x[place])
        curve_V = np.asarray(ocv.mean_V(soc, degC))
        slope_V = (np.asarray(ocv.mean_V(soc + _HALF_STEP, degC)) - curve_V) / _HALF_STEP
        residual_V = model.samples.voltage_V[model.rows] - over_V - curve_V
        weight = counts / (noise.voltage_std_V**2 + (noise.soc_axis_std * slope_V) ** 2 + share**2 * p.over_V2)
        # an error of the curve is free to follow its prior: the part of the residual that it explains is taken out
        columns = hat(soc, OCV_KNOTS)
        g = columns.T @ (weight * residual_V)
        explained = g @ np.linalg.solve(prior + columns.T @ (weight[:, None] * columns), g)
        beyond = max(float(everywhere.max()) - 1.0, -float(everywhere.min()), 0.0)
        told = sum(((everywhere[a.sample] - a.soc) / a.std) ** 2 for a in anchors)
        costs.append(weight @ residual_V**2 - explained + (beyond / _BOUND_STD) ** 2 + told)
    return np.array(costs)
