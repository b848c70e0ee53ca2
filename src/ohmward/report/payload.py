"""The samples of a figure in its page, packed into text, with everything its script needs to draw them."""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ohmward.report.axis import WallClock, XAxis, decimals, shared_x, value_decimals
from ohmward.report.figure import MEANING, Band, Figure, Series, colours

FIGURE_DIGITS: Final = 5
"""Digits of the usual variation of a column that stay: ten times what one screen shows."""
X_DIGITS: Final = 9
"""Digits of the extent of an x axis that stay: a thousand steps for each of a million samples."""
GAP: Final = -(2**31)
"""Difference that stands for NaN; the value after it counts from the last one known."""
_LARGEST_RANGE: Final = 2**29
_LARGEST_WHOLE: Final = 2.0**52
"""Numbers of steps beyond this one are no longer told apart by a double."""
_COMPRESSION: Final = 4


class Columns:
    """Packed columns of a stack, each array stored once however many series show it."""

    def __init__(self) -> None:
        self.packed: list[dict[str, Any]] = []
        self._numbers: dict[tuple[int, float], int] = {}
        self._arrays: list[np.ndarray] = []  # alive, so that no later one has the identity of an earlier one

    def x(self, x: np.ndarray, x_axis: XAxis) -> int:
        """Number of the column of ascending x (n,) on its axis; equal x become distinct."""
        return self._number(x, x_axis.unit, lambda: _packed_x(x, x_axis))

    def y(self, y: np.ndarray, logarithmic: bool) -> int:
        """Number of the column of y (n,), NaN is a gap."""
        return self._number(y, float(logarithmic), lambda: _packed_y(y, logarithmic))

    def _number(self, values: np.ndarray, kind: float, pack: Any) -> int:
        key = (id(values), kind)
        if key not in self._numbers:
            self._numbers[key] = len(self.packed)
            self._arrays.append(values)
            self.packed.append(pack())
        return self._numbers[key]


def _packed_x(x: np.ndarray, x_axis: XAxis) -> dict[str, Any]:
    farthest = max(abs(x_axis.low - x_axis.start), abs(x_axis.high - x_axis.start))
    resolved = math.floor(math.log10(_LARGEST_WHOLE / max(farthest, 1.0)))
    per_unit = 10.0 ** min(X_DIGITS - 1 + decimals(x_axis.high - x_axis.low), resolved)
    order = np.arange(x.size)
    whole = np.rint(x * (per_unit / x_axis.unit)).astype(np.int64)
    distinct = (np.maximum.accumulate(whole - order) + order).astype(float)
    return {"start": x_axis.start} | _differences(distinct, per_unit)


def _packed_y(y: np.ndarray, logarithmic: bool) -> dict[str, Any]:
    """In steps of the usual variation; as 32-bit floats where these do not fit: on a log axis, beside a huge spike."""
    per_unit = 10.0 ** value_decimals(y, FIGURE_DIGITS)
    known = np.isfinite(y)
    low = float(y.min(initial=np.inf, where=known))
    high = float(y.max(initial=-np.inf, where=known))
    extremes = {"extremes": [low, high] if low <= high else [0.0]}
    if logarithmic or (high - low) * per_unit > _LARGEST_RANGE:
        return extremes | {"data": _text(y.astype("<f4").view("<i4"))}
    whole = y * per_unit
    np.rint(whole, out=whole)
    while per_unit > 1.0 and not np.any(whole % 10.0, where=known):
        whole, per_unit = np.rint(whole / 10.0), per_unit / 10.0
    return extremes | _differences(whole, per_unit)


def _differences(whole: np.ndarray, per_unit: float) -> dict[str, Any]:
    """Differences of whole numbers (n,), with the first number separate."""
    known = np.isfinite(whole)
    values = whole if known.all() else whole[known]
    first = float(values[0]) if values.size else 0.0
    between = np.zeros(values.size, dtype="<i4")
    np.subtract(values[1:], values[:-1], out=between[1:], casting="unsafe")
    steps = np.full(whole.size, GAP, dtype="<i4")
    steps[known] = between
    return {"first": int(first), "per_unit": per_unit, "data": _text(steps)}


def _text(words: np.ndarray) -> str:
    by_significance = np.ascontiguousarray(words.view(np.uint8).reshape(-1, 4).T)
    return base64.b64encode(zlib.compress(by_significance.tobytes(), _COMPRESSION)).decode("ascii")


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
