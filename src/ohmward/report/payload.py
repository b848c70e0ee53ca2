"""A stack of figures as plain data for the browser: decimated, rounded, NaN as None."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ohmward.report.axis import decimals, shared_x, value_decimals
from ohmward.report.decimate import envelope
from ohmward.report.figure import Band, Figure, Series
from ohmward.report.palette import MEANING, colours

COLUMNS: Final = 1000
"""Pixel columns to decimate for: about what a wide screen shows."""


def stack(figures: Sequence[Figure]) -> dict[str, Any]:
    """The figures with their common x axis, ready for `json.dumps`.

    x is written as differences of whole numbers, `per_unit` of them to one unit of the axis: about seven digits.
    Raises: InputError when the figures do not share one x_label.
    """
    x_axis = shared_x(figures)
    per_unit = 10.0 ** (6 + decimals(x_axis.high - x_axis.low))
    return {
        "x_label": x_axis.label,
        "extent": [x_axis.low, x_axis.high],
        "per_unit": per_unit,
        "figures": [_figure(f, x_axis.unit, per_unit / x_axis.unit) for f in figures],
    }


def _figure(figure: Figure, unit: float, per_x: float) -> dict[str, Any]:
    names = colours([s.role for s in figure.series])
    return {
        "y_label": figure.y_label,
        "right_label": figure.right_label,
        "log_y": figure.log_y,
        "y_limits": figure.y_limits,
        "height_px": figure.height_px,
        "series": [
            _series(s, name, per_x, figure.log_y, figure.height_px)
            for s, name in zip(figure.series, names, strict=True)
        ],
        "bands": [_band(b, per_x, figure.log_y) for b in figure.bands],
        "markers": [{"x": m.x / unit, "label": m.label, "colour": MEANING[m.role]} for m in figure.markers],
        "spans": [
            {"from": s.x_from / unit, "to": s.x_to / unit, "label": s.label, "colour": MEANING[s.role]}
            for s in figure.spans
        ],
    }


def _series(series: Series, colour: str, per_x: float, log_y: bool, height_px: int) -> dict[str, Any]:
    rows = series.visible(COLUMNS, height_px, log_y)
    x, y = series.x[rows], series.y[rows]
    places = None if log_y and series.axis == "left" else value_decimals(y)
    return {
        "label": series.label,
        "colour": colour,
        "style": series.style,
        "axis": series.axis,
        "decimals": places,
        "x": _differences(x * per_x),
        "y": _rounded(y, places),
    }


def _band(band: Band, per_x: float, log_y: bool) -> dict[str, Any]:
    x, low, high = envelope(band.x, band.low, band.high, COLUMNS)
    places = None if log_y else value_decimals(np.concatenate([low, high]))
    return {
        "label": band.label,
        "colour": MEANING[band.role],
        "decimals": places,
        "x": _differences(x * per_x),
        "low": _rounded(low, places),
        "high": _rounded(high, places),
    }


def _differences(x: np.ndarray) -> list[int]:
    """Differences of ascending x (n,), rounded to integers and made distinct: equal x would be drawn as one sample."""
    order = np.arange(x.size)
    distinct = np.maximum.accumulate(np.rint(x).astype(np.int64) - order) + order
    return np.diff(distinct, prepend=0).tolist()


def _rounded(values: np.ndarray, places: int | None) -> list[float | int | None]:
    """Rounded to decimals, or (None) to 5 significant digits; NaN as None, whole numbers without a decimal point."""
    near = [float(f"{v:.5g}") for v in values] if places is None else np.round(values, places).tolist()
    return [None if v != v else int(v) if v.is_integer() else v for v in near]
