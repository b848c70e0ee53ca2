"""Prior of a battery whose file does not say how old it is: the age itself is an unknown of its first log.

Ageing takes capacity and adds resistance on a scale lambda that nobody knows. Where a change q lies beyond the standard
deviation of the file, the prior is that of the scale which it makes as likely to be exceeded as not:

    q ~ N(0, lambda^2),   lambda = 1.5 |q|,   with p(lambda | q) ~ exp(-q^2 / (2 lambda^2)) / lambda, lambda <= 0.5

so that a battery that has clearly aged is hardly pulled back to a new one. What the slip of the electrodes does not
describe of an aged curve grows with the loss of capacity.
"""

from __future__ import annotations

import numpy as np

from ohmward.battery.battery import require_thevenin
from ohmward.battery.learning.parameters import OCV_KNOTS, mean_slope_V
from ohmward.battery.learning.solve import Normals
from ohmward.battery.learning.voltage_model import VoltageModel

#: Scale of ageing over a change: the median of p(lambda | q) for a change of 0.2.
_SCALE = 1.5
#: Error of the SoC axis of an aged curve beside its slip, for each unit of the loss over the capacity that is left,
#: and its correlation length: of four simulated cells at 80 % it is 0.04 to 0.1.
_SHAPE_STD, _SHAPE_LENGTH = 0.1, 0.2
#: Full and empty stay full and empty, so that this error ends within so much of them.
_ENDS = 0.2


def prior_of_age(model: VoltageModel, prior: Normals, x: np.ndarray) -> Normals:
    """The prior with the likeliest scale of ageing, the unknowns of the part being x (n,)."""
    p, covariance = model.parameters, prior.covariance.copy()
    q, resistances = p.group("capacity"), np.r_[p.group("ohmic"), p.group("pair")]
    covariance[q, q] += _scale2(max(-float(x[q].sum()), 0.0), covariance[q, q])
    together = np.ix_(resistances, resistances)
    covariance[together] += _scale2(max(float(x[resistances].mean()), 0.0), covariance[together])
    axis_V = _shape_V(model, max(float(np.expm1(-x[q].sum())), 0.0))
    correlation = np.exp(-np.abs(OCV_KNOTS[:, None] - OCV_KNOTS) / _SHAPE_LENGTH)
    covariance[p.group("ocv"), p.group("ocv")] += np.outer(axis_V, axis_V) * correlation
    return Normals(prior.mean, covariance)


def _scale2(change: float, covariance: np.ndarray) -> float:
    """Variance that a change which these unknowns have in common adds to their covariance."""
    shared = float(covariance.min(initial=np.inf))
    return _SCALE**2 * change**2 - shared if change**2 > shared else 0.0


def _shape_V(model: VoltageModel, loss: float) -> np.ndarray:
    """Standard deviation [V] on OCV_KNOTS of what slip does not describe of a curve at this loss of capacity."""
    inside = np.minimum(np.minimum(OCV_KNOTS, 1.0 - OCV_KNOTS) / _ENDS, 1.0)
    return _SHAPE_STD * loss * inside * mean_slope_V(require_thevenin(model.battery).ocv, OCV_KNOTS)
