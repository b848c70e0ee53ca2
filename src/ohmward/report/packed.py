"""Columns of numbers as short text for the browser, `assets/data.js` unpacks them.

Whole numbers of steps, each as the difference to the one before, their bytes sorted by significance, deflated, base64:
a million samples of a sensor take one to three megabytes.
"""

from __future__ import annotations

import base64
import math
import zlib
from typing import Any, Final

import numpy as np

from ohmward.report.axis import XAxis, decimals, value_decimals

DIGITS: Final = 5
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
    """Packed columns of a stack, each array once however many series show it."""

    def __init__(self) -> None:
        self.packed: list[dict[str, Any]] = []
        self._numbers: dict[tuple[int, float], int] = {}
        self._kept: list[np.ndarray] = []

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
            self._kept.append(values)
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
    per_unit = 10.0 ** value_decimals(y, DIGITS)
    known = y[np.isfinite(y)]
    extremes = {"extremes": [float(known.min()), float(known.max())] if known.size else [0.0]}
    if logarithmic or (known.size and np.ptp(known) * per_unit > _LARGEST_RANGE):
        return extremes | {"data": _text(y.astype("<f4").view("<i4"))}
    whole = np.rint(y * per_unit)
    while per_unit > 1.0 and not np.any(whole[np.isfinite(whole)] % 10.0):
        whole, per_unit = np.rint(whole / 10.0), per_unit / 10.0
    return extremes | _differences(whole, per_unit)


def _differences(whole: np.ndarray, per_unit: float) -> dict[str, Any]:
    """Whole numbers (n,) with their first one apart."""
    known = np.flatnonzero(np.isfinite(whole))
    first = float(whole[known[0]]) if known.size else 0.0
    steps = np.full(whole.size, GAP, dtype="<i4")
    steps[known] = np.diff(whole[known], prepend=first)
    return {"first": int(first), "per_unit": per_unit, "data": _text(steps)}


def _text(words: np.ndarray) -> str:
    by_significance = np.ascontiguousarray(words.view(np.uint8).reshape(-1, 4).T)
    return base64.b64encode(zlib.compress(by_significance.tobytes(), _COMPRESSION)).decode("ascii")
