"""Open-circuit voltage from the ends of rests, where no low-rate test exists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.identification.ocv_from_low_rate import monotone
from ohmward.battery.identification.record import Record
from ohmward.battery.identification.segments import find_rests, is_rest
from ohmward.battery.models.ocv import OcvCurve
from ohmward.errors import InputError
from ohmward.optional import require

#: Shortest rest whose end is an open-circuit voltage [s].
SHORTEST_OCV_REST_S = 600.0
#: Points of the curve.
_RESTED_CURVE_POINTS = 101
#: Rests within this of SoC are one point.
_SAME_SOC = 0.01
#: Fewest points, and smallest span of SoC, that make a curve.
_FEWEST_POINTS = 2
_SMALLEST_SPAN = 0.2
#: Largest drop of the curve below a straight line on the way to SoC 0, over the voltage.
_LARGEST_DROP = 0.1


class RestPoint(NamedTuple):
    """Voltage at the end of a rest."""

    log_name: str
    sample: int  #: index of the last sample of the rest; soc at it; voltage_V there; duration_s of the rest
    soc: float
    voltage_V: float
    duration_s: float


def rest_points(record: Record, soc: np.ndarray) -> tuple[RestPoint, ...]:
    """The end of each rest of at least 10 minutes, and of the rest with which the log starts.

    soc: (T,) state of charge along the record.
    """
    first = [p for p in record.phases[:1] if is_rest(p)]
    rests = [*first, *find_rests(record.phases, SHORTEST_OCV_REST_S)]
    ends = [(p, last_measured(record.log.voltage_V, p.first, p.last)) for p in rests]
    return tuple(
        RestPoint(record.log.name, at, float(soc[at]), float(record.log.voltage_V[at]), p.duration_s)
        for p, at in ends
        if at is not None
    )


def last_measured(voltage_V: np.ndarray, first: int, last: int) -> int | None:
    """The last sample in first ... last with a voltage, or None."""
    known = np.flatnonzero(np.isfinite(voltage_V[first : last + 1]))
    return first + int(known[-1]) if known.size else None


def ocv_from_rests(points: Sequence[RestPoint], empty_V: float, reference_degC: float) -> OcvCurve:
    """Monotone cubic through the ends of the rests.

    empty_V: lowest voltage of the logs [V]; the curve ends there at SoC 0 when no rest came near.

    Raises:
        InputError: fewer than 2 rests, or all at nearly the same SoC.
    """
    PchipInterpolator = require("scipy.interpolate", "identification").PchipInterpolator

    soc, voltage_V = _merged(points)
    if soc.size < _FEWEST_POINTS or np.ptp(soc) < _SMALLEST_SPAN:
        span = np.ptp(soc) if soc.size else 0.0
        raise InputError(
            f"only {soc.size} rests of {SHORTEST_OCV_REST_S:g} s or more, over {span:.0%} of SoC: the open-circuit "
            "voltage cannot be told from the voltage under load; give it (--ocv, ocv=), add a log with a low-rate "
            "discharge and charge, or one with rests at several states of charge, or name the chemistry and the SoC at "
            "the start (--chemistry nmc --initial-soc 0.9)"
        )
    soc, voltage_V = _with_ends(soc, voltage_V, empty_V)
    grid = np.linspace(0.0, 1.0, _RESTED_CURVE_POINTS)
    return OcvCurve(tuple(monotone(PchipInterpolator(soc, voltage_V)(grid))), reference_degC=reference_degC)


def _merged(points: Sequence[RestPoint]) -> tuple[np.ndarray, np.ndarray]:
    """SoC and voltage of the rests, both rising; within 1 % of SoC averaged, longer rests counting more."""
    ordered = sorted(points, key=lambda p: p.soc)
    groups: list[list[RestPoint]] = []
    for point in ordered:
        if groups and point.soc - groups[-1][0].soc < _SAME_SOC:
            groups[-1].append(point)
        else:
            groups.append([point])
    soc = np.array([np.mean([p.soc for p in g]) for g in groups])
    return soc, monotone(
        np.array([np.average([p.voltage_V for p in g], weights=[p.duration_s for p in g]) for g in groups])
    )


def _with_ends(soc: np.ndarray, voltage_V: np.ndarray, empty_V: float) -> tuple[np.ndarray, np.ndarray]:
    """The points with one at SoC 0 and one at SoC 1: straight on from the last two, and down to `empty_V` at 0."""
    slope = np.diff(voltage_V) / np.diff(soc)
    if soc[0] > 0:
        straight_V = voltage_V[0] - slope[0] * soc[0]
        lowest_V = max(empty_V, straight_V - voltage_V[0] * _LARGEST_DROP)
        bottom_V = straight_V if soc[0] < _SAME_SOC else min(straight_V, lowest_V)
        soc, voltage_V = np.append(0.0, soc), np.append(bottom_V, voltage_V)
    if soc[-1] < 1:
        soc, voltage_V = np.append(soc, 1.0), np.append(voltage_V, voltage_V[-1] + slope[-1] * (1 - soc[-1]))
    return soc, voltage_V
