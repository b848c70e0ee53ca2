"""Open-circuit voltage curve as a few straight lines, which take less flash on a microcontroller than a table.

A line goes on as long as one slope stays within the error of every point of the curve on the way; the next one begins
where it ends (swing filter: Elmeleegy et al., VLDB 2009). The lines end on a uniform grid, so that a table finds them
by its index, with one byte for each of its places and two numbers for each line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.checks import require_positive

#: Numbers of places of the grid, tried in turn.
GRIDS = (51, 101, 151, 201, 251, 301, 401, 501, 601, 801, 1201, 1601)

#: Points of the curve that are compared between two places.
_WITHIN = 16


class OnLines(NamedTuple):
    """A curve on lines."""

    ocv: OcvCurve  #: the curve
    error_V: float  #: largest difference of its mean to the original, from SoC 0 to 1
    lines: int  #: their number; 0 where the original takes less memory


def on_lines(ocv: OcvCurve, error_V: float) -> OnLines:
    """The mean curve at its reference temperature as lines that take the least memory; without hysteresis.

    error_V: largest difference that is allowed anywhere from SoC 0 to 1 [V], > 0. If lines within it would take more
        memory than the curve does, the curve stays as it is.

    Raises:
        InputError: the error is not positive.
    """
    require_positive("error_V", error_V)
    drawn = [curve for places in GRIDS if (curve := _drawn(ocv, places, error_V)).error_V <= error_V]
    return min((*drawn, OnLines(ocv, 0.0, 0)), key=_bytes)


def _bytes(curve: OnLines) -> int:
    """Memory of its tables in single precision: a byte a place and two numbers a line, or four numbers a segment."""
    points = len(curve.ocv.voltage_V)
    return points + 1 + 8 * curve.lines if curve.lines else 16 * (points + 1)


def _drawn(ocv: OcvCurve, places: int, error_V: float) -> OnLines:
    soc = np.linspace(0.0, 1.0, _WITHIN * (places - 1) + 1)
    curve = np.asarray(ocv.mean_V(soc, ocv.reference_degC))
    values, knots = [float(curve[0])], [0]
    while knots[-1] < places - 1:
        end, value = _furthest(curve, knots[-1], values[-1], places, error_V)
        values.append(value)
        knots.append(end)
    line = np.interp(np.arange(float(places)), knots, values)
    error = float(np.abs(np.interp(soc, np.linspace(0.0, 1.0, places), line) - curve).max())
    drawn = OcvCurve(tuple(line.tolist()), reference_degC=ocv.reference_degC, interpolation="linear")
    return OnLines(drawn, error, len(knots) - 1)


def _furthest(curve: np.ndarray, first: int, value: float, places: int, error_V: float) -> tuple[int, float]:
    """The place at which a line from `value` at place `first` must end, and its value there; it never falls."""
    rest = curve[_WITHIN * first + 1 :]
    ahead = np.arange(1.0, len(rest) + 1.0) / _WITHIN
    steepest = np.minimum.accumulate((rest + error_V - value) / ahead)
    flattest = np.maximum.accumulate(np.maximum((rest - error_V - value) / ahead, 0.0))
    reached = np.flatnonzero((steepest >= flattest)[_WITHIN - 1 :: _WITHIN])
    steps = 1 if not reached.size else int(reached[-1]) + 1
    at = _WITHIN * steps - 1
    slope = 0.5 * (steepest[at] + flattest[at]) if reached.size else max(rest[at] - value, 0.0)
    return first + steps, float(value + slope * steps)
