"""States of charge from which a part of a log may have begun, so that the search is worth a try from each.

The voltage of a flat curve fits several of them. Each is a hill of the posterior, and a search finds only its own.

Prior of a battery whose file does not say how old it is: the age itself is an unknown of its first log.

Ageing takes capacity and adds resistance on a scale lambda that nobody knows. Where a change q lies beyond the standard
deviation of the file, the prior is that of the scale which it makes as likely to be exceeded as not:

    q ~ N(0, lambda^2),   lambda = 1.5 |q|,   with p(lambda | q) ~ exp(-q^2 / (2 lambda^2)) / lambda, lambda <= 0.5

so that a battery that has clearly aged is hardly pulled back to a new one. What the slip of the electrodes does not
describe of an aged curve grows with the loss of capacity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery, require_thevenin
from ohmward.battery.fingerprint import fingerprint, unlearnt_parts
from ohmward.battery.learning.log_faults import usable_log
from ohmward.battery.learning.parameters import OCV_KNOTS, mean_slope_V, prior_covariance
from ohmward.battery.learning.solve import Normals, SocAnchor
from ohmward.battery.learning.voltage_model import VoltageModel
from ohmward.battery.models.knots import correlation, hat
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: Scale of ageing over a change: the median of p(lambda | q) for a change of 0.2.
_SCALE = 1.5
#: Error of the SoC axis of an aged curve beside its slip, for each unit of the loss over the capacity that is left,
#: and its correlation length: of four simulated cells at 80 % it is 0.04 to 0.1.
_SHAPE_STD, _SHAPE_LENGTH = 0.1, 0.2
#: Full and empty stay full and empty, so that this error ends within so much of them.
_ENDS = 0.2


#: A log of which less than this share is new has been seen, where the new part cannot be learnt.
_MOSTLY_SEEN = 0.5


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
    minima = np.flatnonzero(lower_than_before & lower_than_after & (costs < costs.min() + _CLEAR))
    best = minima[np.argsort(costs[minima])][:_MOST_STARTS]
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
    costs, everywhere_soc = [], p.charge.soc
    for start in _GRID:
        soc, everywhere = p.soc + (start - x[place]), everywhere_soc + (start - x[place])
        curve_V = np.asarray(ocv.mean_V(soc, degC))
        slope_V = (np.asarray(ocv.mean_V(soc + _HALF_STEP, degC)) - curve_V) / _HALF_STEP
        residual_V = model.samples.voltage_V[model.rows] - over_V - curve_V
        weight = counts / (noise.voltage_std_V**2 + (noise.soc_axis_std * slope_V) ** 2 + share**2 * p.over_V2)
        # an error of the curve is free to follow its prior: the part of the residual that it explains is taken out
        columns = hat(soc, OCV_KNOTS)
        g = columns.T @ (weight * residual_V)
        explained = g @ np.linalg.solve(prior + columns.T @ (weight[:, None] * columns), g)
        beyond = max(float(everywhere.max()) - 1.0, -float(everywhere.min()), 0.0)
        of_anchors = sum(((everywhere[a.sample] - a.soc) / a.std) ** 2 for a in anchors)
        costs.append(weight @ residual_V**2 - explained + (beyond / _BOUND_STD) ** 2 + of_anchors)
    return np.array(costs)


def prior_of_age(model: VoltageModel, prior: Normals, x: np.ndarray) -> Normals:
    """The prior with the likeliest scale of ageing, the unknowns of the part being x (n,)."""
    p, covariance = model.parameters, prior.covariance.copy()
    q, resistances = p.group("capacity"), np.r_[p.group("ohmic"), p.group("pair")]
    covariance[q, q] += _scale2(max(-float(x[q].sum()), 0.0), covariance[q, q])
    together = np.ix_(resistances, resistances)
    covariance[together] += _scale2(max(float(x[resistances].mean()), 0.0), covariance[together])
    axis_V = _shape_V(model, max(float(np.expm1(-x[q].sum())), 0.0))
    covariance[p.group("ocv"), p.group("ocv")] += np.outer(axis_V, axis_V) * correlation(OCV_KNOTS, _SHAPE_LENGTH)
    return Normals(prior.mean, covariance)


def _scale2(change: float, covariance: np.ndarray) -> float:
    """Variance that a change which these unknowns have in common adds to their covariance."""
    shared = float(covariance.min(initial=np.inf))
    return _SCALE**2 * change**2 - shared if change**2 > shared else 0.0


def _shape_V(model: VoltageModel, loss: float) -> np.ndarray:
    """Standard deviation [V] on OCV_KNOTS of what slip does not describe of a curve at this loss of capacity."""
    inside = np.minimum(np.minimum(OCV_KNOTS, 1.0 - OCV_KNOTS) / _ENDS, 1.0)
    return _SHAPE_STD * loss * inside * mean_slope_V(require_thevenin(model.battery).ocv, OCV_KNOTS)


class NewParts(NamedTuple):
    """New parts of a log."""

    parts: tuple[Log, ...]  #: in order of time; () for a log that the battery has learnt from before
    fingerprint: str  #: of the whole log
    hours: float  #: length of the parts together
    all_hours: float  #: of the log
    left_out: tuple[str, ...]  #: sentences on what is not used of it, and why

    @property
    def mostly_seen(self) -> bool:
        """True where most of the log was learnt before."""
        return self.hours < _MOSTLY_SEEN * self.all_hours


def new_parts(battery: Battery, log: Log) -> NewParts:
    """The parts of a log that can teach the battery something new.

    Raises:
        InputError: the log cannot teach anything about this battery; says why.
    """
    usable = usable_log(log, battery)
    parts = unlearnt_parts(usable, _fingerprints(battery))
    hours, all_hours = _hours(parts), _hours([log])
    left_out = [note.text for note in usable.notes if note not in log.notes]
    if parts != (usable,):
        seen = f"{all_hours - hours:.2g} of {all_hours:.2g} h"
        left_out.append(f"{seen}: the battery has learnt from them before")
    return NewParts(parts, fingerprint(usable), hours, all_hours, tuple(left_out))


def _fingerprints(battery: Battery) -> tuple[str, ...]:
    """Fingerprints of the logs that the battery was identified from, and of those that it has learnt."""
    tested = battery.identification.fingerprints if battery.identification else ()
    learnt = battery.knowledge.logs if battery.knowledge else ()
    return (*tested, *(seen.fingerprint for seen in learnt))


def _hours(logs: Sequence[Log]) -> float:
    """Length of the logs together."""
    return sum(log.duration_s for log in logs) / SECONDS_PER_HOUR
