"""Start of a part of a log: state of charge, from another source than the voltage or by trial, and age of the battery.

A log that goes on where another one ended starts with its charge: days cut at midnight count as one log does. The
voltage of a flat curve fits several states of charge. Each is a mode of the posterior, and a search finds only its
own, so that one is started from each.

The age of a battery whose file has no logs is an unknown of its first log. Ageing takes capacity and adds resistance on
an unknown scale lambda. Where a change q lies beyond the standard deviation of the file, the prior is that with the
median scale, given the change:

    q ~ N(0, lambda^2),   lambda = 1.5 |q|,   with p(lambda | q) ~ exp(-q^2 / (2 lambda^2)) / lambda, lambda <= 0.5

so that a battery that has clearly aged is hardly pulled back to a new one. The part of an aged curve that the slip of
the electrodes does not describe grows with the loss of capacity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.fingerprint import fingerprint, unlearnt_parts
from ohmward.battery.learning.log_faults import usable_log
from ohmward.battery.learning.parameters import mean_slope_V, prior_covariance
from ohmward.battery.learning.samples import Samples
from ohmward.battery.learning.voltage_model import VoltageModel
from ohmward.battery.models.ocv import correlation, hat
from ohmward.battery.posterior import OCV_KNOTS
from ohmward.battery.soc.anchor_rule import REST_C, SocAnchor
from ohmward.battery.soc.anchors import Anchor
from ohmward.battery.soc.sample import INITIAL_SOC_STD
from ohmward.filters.belief import Belief
from ohmward.logs.log import SECONDS_PER_HOUR, Log

#: Longest time [s] between two logs of which one goes on with the charge of the other, and smallest standard deviation
#: of that charge.
_CONTINUES_S, _CONTINUED_STD = 1800.0, 0.01
#: Between the two the current of either log may have continued, and this multiple of the capacity per hour as well.
_BETWEEN_C = 0.05
#: Standard deviation of SoC in a rest at the voltage of a full battery.
_FULL_AT_REST_STD = 0.03


def given_at_start(battery: Battery, log: Log, initial_soc: float | None) -> tuple[SocAnchor, ...]:
    """State of charge at the first sample by the user, or by the log that ended just before; () without either.

    The current of either log may have continued between the two.
    """
    if initial_soc is not None:
        return (SocAnchor(0, initial_soc, INITIAL_SOC_STD),)
    start = log.begin_unix_s
    if start is None:
        return ()
    for seen in reversed(battery.learnt_logs):
        if seen.end_unix_s is None or seen.end_soc is None or seen.end_soc_std is None:
            continue
        gap_s = start - seen.end_unix_s
        if abs(gap_s) <= _CONTINUES_S:
            rate_C = max(abs(seen.end_current_A), abs(float(log.current_A[0]))) / battery.capacity_Ah
            unknown = (rate_C + _BETWEEN_C) * abs(gap_s) / SECONDS_PER_HOUR
            return (SocAnchor(0, seen.end_soc, math.hypot(seen.end_soc_std, _CONTINUED_STD, unknown)),)
    return ()


def full_at_start(battery: Battery, samples: Samples) -> tuple[SocAnchor, ...]:
    """State of charge of a part that starts at rest at the voltage of a full battery or above; () for any other."""
    full_V = float(battery.thevenin.ocv.mean_V(1.0, samples.temperature_degC[0]))
    resting = abs(samples.current_A[0]) <= REST_C * battery.capacity_Ah
    if not (resting and samples.voltage_V[0] >= full_V):
        return ()
    return (SocAnchor(0, 1.0, math.hypot(_FULL_AT_REST_STD, battery.noise.soc_axis_std)),)


def soc_anchors(anchors: Sequence[Anchor], samples: Samples) -> tuple[SocAnchor, ...]:
    """The anchors within a part, except rests: they add nothing to their voltage, which is used anyway."""
    first_s, last_s = samples.time_s[0], samples.time_s[-1]
    inside = [a for a in anchors if a.kind != "rest" and first_s <= a.time_s <= last_s]
    return tuple(SocAnchor(int(np.searchsorted(samples.time_s, a.time_s)), a.soc, a.soc_std) for a in inside)


#: Scale of ageing over a change: the median of p(lambda | q) for a change of 0.2.
_SCALE = 1.5
#: Error of the SoC axis of an aged curve in addition to its slip, for each unit of the loss over the capacity that is
#: left, and its correlation length: for four simulated cells at 80 % it is 0.04 to 0.1.
_SHAPE_STD, _SHAPE_LENGTH = 0.1, 0.2
#: Full and empty stay full and empty, so that this error falls to 0 within this distance of them.
_ENDS = 0.2

#: A log of which less than this share is new counts as seen where the new part cannot be learnt.
_MOSTLY_SEEN = 0.5

#: States of charge that are tried, and most modes that are searched from.
_GRID = np.linspace(0.0, 1.0, 41)
_MOST_STARTS = 4
#: Number of rows that are used.
_COARSE_ROWS = 400
#: Difference of -2 ln p from the highest mode beyond which another one is ignored.
_CLEAR = 60.0
#: Step of SoC for the slope of the curve, width of the bounds of SoC, and smallest variance of the curve [V^2].
_SLOPE_STEP, _BOUND_WIDTH, _LEAST_CURVE_V2 = 0.005, 0.05, 1e-12


def likely_starts(model: VoltageModel, x: np.ndarray, anchors: Sequence[SocAnchor]) -> list[np.ndarray]:
    """Unknowns (n,) with the likely states of charge at the start, the most likely first, all others as in x (n,)."""
    rows = model.rows[:: max(1, model.rows.size // _COARSE_ROWS)]
    coarse = VoltageModel(model.battery, model.samples, rows)
    costs = _costs(coarse, x, anchors)
    lower_than_before = np.concatenate([[True], costs[1:] <= costs[:-1]])
    lower_than_after = np.concatenate([costs[:-1] <= costs[1:], [True]])
    minima = np.flatnonzero(lower_than_before & lower_than_after & (costs < costs.min() + _CLEAR))
    best = minima[np.argsort(costs[minima])][:_MOST_STARTS]
    starts = np.tile(x, (best.size, 1))
    starts[:, model.unknowns.group("start soc")] = _GRID[best, None]
    return list(starts)


def _costs(model: VoltageModel, x: np.ndarray, anchors: Sequence[SocAnchor]) -> np.ndarray:
    """(G,) cost of each start: of the voltage, with an error of the curve along all of SoC, of anchors and bounds.

    The overpotentials are those of one start: they depend little on SoC.
    """
    p, noise, ocv = model.predict(x), model.battery.noise, model.model.ocv
    degC = model.samples.temperature_degC[model.rows]
    over_V = p.voltage_V - np.asarray(ocv.mean_V(p.soc, degC))
    open_circuit_V = model.samples.voltage_V[model.rows] - over_V
    group = model.parameters.group("ocv")
    prior = np.linalg.inv(prior_covariance(model.battery)[group, group] + _LEAST_CURVE_V2 * np.eye(OCV_KNOTS.size))
    share = noise.overpotential_share_at(p.soc) + noise.resistance_std
    independent = model.samples.hours * SECONDS_PER_HOUR / (2 * noise.correlation_s)
    counts = min(1.0, independent / max(p.soc.size, 1))

    def of_voltage(soc: np.ndarray) -> float:
        curve_V = np.asarray(ocv.mean_V(soc, degC))
        slope_V = (np.asarray(ocv.mean_V(soc + _SLOPE_STEP, degC)) - curve_V) / _SLOPE_STEP
        residual_V = open_circuit_V - curve_V
        weight = counts / (noise.voltage_std_V**2 + (noise.soc_axis_std * slope_V) ** 2 + share**2 * p.over_V2)
        # an error of the curve is free to follow its prior: the part of the residual that it explains is taken out
        columns = hat(soc, OCV_KNOTS)
        g = columns.T @ (weight * residual_V)
        explained = g @ np.linalg.solve(prior + columns.T @ (weight[:, None] * columns), g)
        return float(weight @ residual_V**2 - explained)

    def of_charge(soc: np.ndarray) -> float:
        beyond = max(float(soc.max()) - 1.0, -float(soc.min()), 0.0)
        of_anchors = sum(((soc[a.sample] - a.soc) / a.std) ** 2 for a in anchors)
        return float((beyond / _BOUND_WIDTH) ** 2 + of_anchors)

    everywhere = p.charge.soc
    shifts = _GRID - x[model.unknowns.group("start soc")]
    return np.array([of_voltage(p.soc + shift) + of_charge(everywhere + shift) for shift in shifts])


def prior_of_age(model: VoltageModel, prior: Belief, x: np.ndarray) -> Belief:
    """The prior with the likeliest scale of ageing, the unknowns of the part being x (n,)."""
    p, covariance = model.parameters, prior.cov.copy()
    q, resistances = p.group("capacity"), p.places("ohmic", "pair")
    lost = max(-float(x[q].sum()), 0.0)
    covariance[q, q] += _scale2(lost, covariance[q, q])
    together = np.ix_(resistances, resistances)
    grown = max(float(x[resistances].mean()), 0.0)
    covariance[together] += _scale2(grown, covariance[together])
    # (K,) error of a curve at this loss of capacity that slip does not describe
    loss = float(np.expm1(lost))
    inside = np.minimum(np.minimum(OCV_KNOTS, 1.0 - OCV_KNOTS) / _ENDS, 1.0)
    axis_V = _SHAPE_STD * loss * inside * mean_slope_V(model.battery.thevenin.ocv, OCV_KNOTS)
    covariance[p.group("ocv"), p.group("ocv")] += np.outer(axis_V, axis_V) * correlation(OCV_KNOTS, _SHAPE_LENGTH)
    return Belief(prior.mean, covariance)


def _scale2(change: float, covariance: np.ndarray) -> float:
    """Variance that a change common to these unknowns adds to their covariance."""
    shared = float(covariance.min(initial=np.inf))
    return _SCALE**2 * change**2 - shared if change**2 > shared else 0.0


class NewParts(NamedTuple):
    """New parts of a log."""

    parts: tuple[Log, ...]  #: in order of time; () for a log that the battery has learnt from before
    fingerprint: str  #: of the whole log
    hours: float  #: length of the parts together
    mostly_seen: bool  #: True where most of the log was learnt before
    left_out: tuple[str, ...]  #: sentences on the parts that are not used, and why


def new_parts(battery: Battery, log: Log) -> NewParts:
    """The parts of a log from which the battery can learn something new.

    Raises:
        InputError: nothing can be learnt from the log about this battery; says why.
    """
    usable = usable_log(log, battery)
    tested = battery.identification.fingerprints if battery.identification else ()
    learnt = (seen.fingerprint for seen in battery.learnt_logs)
    parts = unlearnt_parts(usable, (*tested, *learnt))
    hours = sum(part.duration_s for part in parts) / SECONDS_PER_HOUR
    all_hours = log.duration_s / SECONDS_PER_HOUR
    left_out = [note.text for note in usable.notes if note not in log.notes]
    if parts != (usable,):
        seen = f"{all_hours - hours:.2g} of {all_hours:.2g} h"
        left_out.append(f"{seen}: the battery has learnt from them before")
    return NewParts(parts, fingerprint(usable), hours, hours < _MOSTLY_SEEN * all_hours, tuple(left_out))
