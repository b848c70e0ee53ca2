"""Look-up on a uniform grid: the only way for a traced function to use data as an index."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.trace.expression import apply, number
from ohmward.trace.functions import elementwise, floor, is_traced, minimum, where

#: Largest number of straight lines of a table: the number of a line is stored in a byte.
_MOST_LINES = 255
#: Largest second difference of values on one straight line, relative to the largest value: a few rounding errors.
_STRAIGHT = 1e-13
#: Largest coefficient of a segment that rounding alone can explain, relative to the largest value.
_ROUNDING = 1e-15


def table(
    values: Sequence[float] | np.ndarray,
    start: float,
    spacing: float,
    x: Any,
    kind: Literal["linear", "hermite"] = "linear",
) -> Any:
    """Value at x of the curve through `values` at start, start + spacing, start + 2 spacing, ...

    values:  (n,) finite constants, n >= 2.
    start, spacing: position of the first value, distance between neighbouring values (> 0), in the unit of x.
    x:       float, array, traced scalar or array of these.
    kind:    "linear", or "hermite" for the monotone cubic of `monotone_slopes`.
    Returns: shape of x. Beyond the ends the curve continues straight, with the slope of its end. nan gives nan.
    Raises:  InputError for values, spacing or kind that make no curve.
    """
    if not spacing > 0:
        raise InputError(f"table: spacing must be > 0, got {spacing}")
    points = _points(values if isinstance(values, tuple) else tuple(np.asarray(values, dtype=float).ravel().tolist()))
    u = (x - start) * (1.0 / spacing) + 1.0  # 1 at the first value: the segment before it is number 0
    segment = floor(minimum(_positive(u), float(len(points))))
    t, at_segment = u - segment, _entries_at(segment)
    if kind == "linear" and (lines := _lines(points)):
        at_line = _entries_at(at_segment(lines.numbers))
        return at_line(lines.offsets) + at_line(lines.slopes) * u
    if kind == "linear":
        # from values alone: half the memory of values and slopes
        ends = _ends(points)
        left = at_segment(ends[:-1])
        return left + t * (at_segment(ends[1:]) - left)
    *lower, y = map(at_segment, _segments(points, kind))
    for c in reversed(lower):
        y = c + t * y
    return y


def monotone_slopes(values: np.ndarray) -> np.ndarray:
    """Slopes (n,) per grid step of the monotone piecewise cubic through values (n,) on a uniform grid.

    The harmonic mean of the neighbouring differences, 0 at an extremum (Fritsch and Butland 1984, within the region of
    Fritsch and Carlson 1980); at the ends the three-point formula, limited to keep the shape.
    """
    d = np.diff(values)
    if len(d) == 1:
        return np.array([d[0], d[0]])
    left, right = d[:-1], d[1:]
    monotone = left * right > 0
    inner = np.where(monotone, 2 * left * right / np.where(monotone, left + right, 1.0), 0.0)
    return np.array([_end_slope(d[0], d[1]), *inner, _end_slope(d[-1], d[-2])])


def _end_slope(d0: float, d1: float) -> float:
    """Slope at an end, from the difference next to it and the one after."""
    slope = (3.0 * d0 - d1) / 2.0
    if slope * d0 <= 0:
        return 0.0
    return 3.0 * d0 if abs(slope) > abs(3.0 * d0) else slope


@lru_cache(maxsize=256)
def _points(values: tuple[float, ...]) -> tuple[float, ...]:
    """The values without -0.0: equal tables share memory."""
    return tuple((np.array(values, dtype=float) + 0.0).tolist())


@lru_cache(maxsize=256)
def _ends(values: tuple[float, ...]) -> tuple[float, ...]:
    """Values (n + 2,) at the ends of the segments of straight lines, the extensions included."""
    v = _checked(values)
    return (float(2 * v[0] - v[1]), *values, float(2 * v[-1] - v[-2]))


class _Lines(NamedTuple):
    """Straight lines over several segments each."""

    numbers: tuple[float, ...]  #: number of the line of each segment
    #: value at u = 0 and slope of each line
    offsets: tuple[float, ...]
    slopes: tuple[float, ...]


@lru_cache(maxsize=256)
def _lines(values: tuple[float, ...]) -> _Lines | None:
    """The straight lines through values (n,), if they take less memory than the values; else None."""
    v = _checked(values)
    kinks = np.abs(np.diff(v, 2)) > _STRAIGHT * np.abs(v).max()
    knots = np.flatnonzero(np.concatenate([[True], kinks, [True]]))
    count, n = len(knots) - 1, len(v)
    bytes_of_lines = 8 * count + n + 1  # two singles for each line, one byte for each segment
    bytes_of_values = 4 * (n + 2)
    if count > _MOST_LINES or bytes_of_lines >= bytes_of_values:
        return None
    slopes = np.diff(v[knots]) / np.diff(knots)
    offsets = v[knots[:-1]] - slopes * (knots[:-1] + 1)
    numbers = np.repeat(np.arange(float(count)), np.diff(knots))
    numbers = np.concatenate([numbers[:1], numbers, numbers[-1:]])
    return _Lines(*(tuple((row + 0.0).tolist()) for row in (numbers, offsets, slopes)))


@lru_cache(maxsize=256)
def _segments(values: tuple[float, ...], kind: str) -> tuple[tuple[float, ...], ...]:
    """Coefficients (4, n + 1) of t^k on each segment, t in [0, 1]; the first and the last one are the extensions."""
    v = _checked(values)
    if kind != "hermite":
        raise InputError(f'table: kind must be "linear" or "hermite", got {kind!r}')
    return tuple(tuple((row + 0.0).tolist()) for row in _polynomials(v))


def _checked(values: tuple[float, ...]) -> np.ndarray:
    v = np.array(values)
    if len(v) < 2 or not np.isfinite(v).all():
        raise InputError(f"table: values must be 2 or more finite numbers, got {values!r:.80}")
    return v


def _polynomials(v: np.ndarray) -> list[np.ndarray]:
    d, m = np.diff(v), monotone_slopes(v)
    c0 = np.array([v[0] - m[0], *v])
    c1 = np.array([m[0], *m])
    c2 = np.array([0.0, *(3 * d - 2 * m[:-1] - m[1:]), 0.0])
    c3 = np.array([0.0, *(m[:-1] + m[1:] - 2 * d), 0.0])
    is_rounding = [np.abs(c) <= _ROUNDING * np.abs(v).max() for c in (c2, c3)]
    return [c0, c1, np.where(is_rounding[0], 0.0, c2), np.where(is_rounding[1], 0.0, c3)]


def _positive_element(u: Any) -> Any:
    return where(u > 0.0, u, 0.0)


#: u where it is positive; 0 elsewhere and at nan, so that it can become an index.
_positive = elementwise(_positive_element, _positive_element, 1)


def _entries_at(index: Any) -> Callable[[tuple[float, ...]], Any]:
    """Function that gives the entries of a table at indices that are whole numbers within it; entry 0 at nan."""
    if is_traced(index):
        return lambda values: np.frompyfunc(lambda i: apply("gather", number(i), values), 1, 1)(index)
    place = np.where(np.isnan(index), 0, index).astype(int)
    return lambda values: _array(values)[place]


@lru_cache(maxsize=1024)
def _array(values: tuple[float, ...]) -> np.ndarray:
    return np.array(values)
