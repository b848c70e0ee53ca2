"""Axes: the x axis that figures share, nice ticks and their labels, the decimals of numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report.figure import TIME, Figure


class WallClock(NamedTuple):
    """Clock of a log with dates."""

    start_unix_s: float  #: Unix time [s] of x = 0
    #: IANA name of the time zone to show; "" where the log names none, and its own dates are shown
    time_zone: str = "UTC"


class XAxis(NamedTuple):
    """X axis: its label, its extent in its own unit, and the size of that unit in the unit of the data."""

    label: str
    low: float
    high: float
    unit: float
    #: added to the data in the unit of the axis
    start: float = 0.0
    time_zone: str | None = None  #: of a wall clock, None for every other axis

    def place(self, x: Any) -> Any:
        """Positions on the axis of the data, a number or an array."""
        return x / self.unit + self.start


def shared_x(figures: Sequence[Figure], clock: WallClock | None = None) -> XAxis:
    """X axis of all figures; with `TIME`, the wall clock where there is one, else the unit that suits their duration.

    Without `TIME`, an end at which a point lies has a margin, so that the point is drawn.

    Raises: InputError when there are no figures, or when they do not have one x_label.
    """
    if not figures:
        raise InputError("a plot needs at least one figure, got none")
    labels = {f.x_label for f in figures}
    if len(labels) != 1:
        raise InputError(f"figures of one stack need one x_label, got {sorted(labels)}: plot them separately")
    low, high = _extent(figures)
    if labels != {TIME}:
        margin = _AXIS_MARGIN * (high - low)
        dots = [series.x for figure in figures for series in figure.series if series.style == "points"]
        left, right = (margin if any(end in x for x in dots) else 0.0 for end in (low, high))
        return XAxis(labels.pop(), low - left, high + right, 1.0)
    if clock is not None:
        start, zone = clock
        label = f"Time ({zone})" if zone else "Time (as in the log, which names no time zone)"
        return XAxis(label, low + start, high + start, 1.0, start, zone or "UTC")
    name, seconds = time_unit(high - low)
    return XAxis(f"Time [{name}]", low / seconds, high / seconds, seconds)


#: Distance of a point from the end of the axis, as a share of its length.
_AXIS_MARGIN = 0.03


def _extent(figures: Sequence[Figure]) -> tuple[float, float]:
    xs: list[np.ndarray] = []
    for figure in figures:
        xs += [series.x for series in figure.series if series.x.size]
        xs += [band.x for band in figure.bands if band.x.size]
    if not xs:
        return 0.0, 1.0
    low, high = float(min(x[0] for x in xs)), float(max(x[-1] for x in xs))
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def time_unit(duration_s: float) -> tuple[str, float]:
    """Name and length [s] of the unit for an axis of `duration_s`: s below 3 min, min below 3 h, else h."""
    if duration_s < 180:
        return "s", 1.0
    return ("min", 60.0) if duration_s < 3 * SECONDS_PER_HOUR else ("h", SECONDS_PER_HOUR)


def nice_step(span: float, intervals: int) -> float:
    """The smallest of 1, 2, 5 times a power of ten that divides span > 0 into at most `intervals` intervals."""
    raw = span / intervals
    power = 10.0 ** math.floor(math.log10(raw))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9))


def linear_ticks(low: float, high: float, intervals: int = 6) -> np.ndarray:
    """Multiples of a nice step within [low, high], low < high: two at least."""
    step = nice_step(high - low, intervals)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    ticks = np.round(np.arange(first, last + 1) * step, decimals(step)) + 0.0
    return ticks if ticks.size > 1 or intervals > 9 else linear_ticks(low, high, intervals + 1)


def tick_labels(ticks: np.ndarray) -> list[str]:
    """Ticks as text: the decimals that their step needs, an exponent for very large or small ones."""
    if ticks.size == 0:
        return []
    largest = float(np.abs(ticks).max())
    if largest >= 1e6 or largest < 1e-3:
        texts = [_compact(float(t)) for t in ticks]
    else:
        step = float(np.diff(ticks).min()) if ticks.size > 1 else largest
        texts = [f"{t:.{max(decimals(step), 0)}f}" for t in ticks]
    return [text.replace("-", "−") for text in texts]


def _compact(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        return f"{value:.6g}"
    return np.format_float_scientific(value, precision=5, trim="-", exp_digits=1).replace("e+", "e")


def decimals(resolution: float) -> int:
    """Decimals for multiples of `resolution` > 0 of the form m 10^k; negative for tens, hundreds, ..."""
    return -math.floor(math.log10(resolution) + 1e-9)


def value_decimals(values: np.ndarray, digits: int = 4) -> int:
    """Decimals that show `digits` digits of the central 98 % of the variation of the values (n,), NaN left out.

    For a constant, decimals that show `digits` digits of its value; a lone spike does not coarsen the rest.
    """
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0
    largest = float(max(-finite.min(), finite.max()))
    low, high = np.quantile(finite, [0.01, 0.99], overwrite_input=True)
    span = high - low if high - low > 1e-9 * abs(high) else abs(high)
    span = span or largest or 1.0
    return min(digits + decimals(float(span)), 15)
