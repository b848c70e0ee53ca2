"""A stack of figures as plain data for the browser: every sample that the figures hold, packed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ohmward.report.axis import WallClock, XAxis, shared_x, value_decimals
from ohmward.report.figure import Band, Figure, Series
from ohmward.report.packed import Columns
from ohmward.report.palette import MEANING, colours


def stack(figures: Sequence[Figure], clock: WallClock | None = None) -> dict[str, Any]:
    """The figures with their common x axis, ready for `json.dumps`; series and bands name columns by number.

    Raises: InputError when the figures do not share one x_label.
    """
    x_axis = shared_x(figures, clock)
    columns = Columns()
    drawn = [_figure(f, x_axis, columns) for f in figures]
    return {
        "x_label": x_axis.label,
        "extent": [x_axis.low, x_axis.high],
        "time_zone": x_axis.time_zone,
        "columns": columns.packed,
        "figures": drawn,
    }


def _figure(figure: Figure, x_axis: XAxis, columns: Columns) -> dict[str, Any]:
    names = colours([s.role for s in figure.series])
    return {
        "title": figure.title,
        "y_label": figure.y_label,
        "right_label": figure.right_label,
        "log_y": figure.log_y,
        "y_limits": figure.y_limits,
        "height_px": figure.height_px,
        "series": [
            _series(s, name, figure.log_y, x_axis, columns)
            for s, name in sorted(zip(figure.series, names, strict=True), key=_above)
        ],
        "bands": [_band(b, figure.log_y, x_axis, columns) for b in figure.bands],
        "markers": [{"x": x_axis.place(m.x), "label": m.label, "colour": MEANING[m.role]} for m in figure.markers],
        "spans": [
            {
                "from": x_axis.place(s.x_from),
                "to": x_axis.place(s.x_to),
                "label": s.label,
                "colour": MEANING[s.role],
            }
            for s in figure.spans
        ],
    }


def _above(named: tuple[Series, str]) -> bool:
    """True for the line of a truth, which is drawn above the estimates: it would not be seen below them."""
    return named[0].role == "reference" and named[0].style != "points"


def _series(series: Series, colour: str, log_y: bool, x_axis: XAxis, columns: Columns) -> dict[str, Any]:
    logarithmic = log_y and series.axis == "left"
    return {
        "label": series.label,
        "colour": colour,
        "style": series.style,
        "axis": series.axis,
        "decimals": None if logarithmic else value_decimals(series.y),
        "x": columns.x(series.x, x_axis),
        "y": [columns.y(series.y, logarithmic)],
    }


def _band(band: Band, log_y: bool, x_axis: XAxis, columns: Columns) -> dict[str, Any]:
    return {
        "label": band.label,
        "colour": MEANING[band.role],
        "style": "area",
        "axis": "left",
        "decimals": None if log_y else value_decimals(np.concatenate([band.low, band.high])),
        "x": columns.x(band.x, x_axis),
        "y": [columns.y(band.low, log_y), columns.y(band.high, log_y)],
    }
