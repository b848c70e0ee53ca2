"""Content of a plot: series, uncertainty bands, markers and spans. No drawing here, and no domain.

figure = Figure(
    "State of charge", TIME, "State of charge [%]",
    series=[Series(t, soc, "estimate", role="estimate"), Series(t, truth, "reference", "dashed", "reference")],
    bands=[Band(t, soc - 2 * std, soc + 2 * std, "95 %")],
    spans=[Span(600.0, 1800.0, "rest")],
)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from ohmward.errors import InputError
from ohmward.report.decimate import DOT_PX, FINEST, envelope, finest, m4, scatter
from ohmward.report.palette import MEANING, ROLES, Meaning, Role

TIME: Final = "time"
"""As `x_label`: x is in seconds; the drawing shows it in s, min or h, chosen by its duration, and labels the unit."""

Style = Literal["line", "points", "step", "dashed"]
Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Series:
    """Samples (x_i, y_i) with a label.

    x: (n,) ascending (points may come in any order), y: (n,), NaN (or an infinity) is a gap in the line.
       Of a long line only those samples stay that `decimate.finest` picks: all that can be seen of a log.
    style: "line", "points", "step" (each value holds until the next sample) or "dashed".
    role: meaning of the colour, see `palette.MEANING`; "auto" takes the next free hue.
    axis: its y axis, "left" or "right".
    Raises: InputError for lengths that differ, descending x, an unknown style, role or axis.
    """

    x: np.ndarray
    y: np.ndarray
    label: str
    style: Style = "line"
    role: Role = "auto"
    axis: Side = "left"

    def __post_init__(self) -> None:
        _check_choice("style", self.style, get_args(Style))
        _check_choice("role", self.role, ROLES)
        _check_choice("axis", self.axis, get_args(Side))
        x, y = _columns(self.label, x=self.x, y=self.y)
        if self.style == "points":
            order = np.argsort(x, kind="stable")
            x, y = x[order], y[order]
        _check_ascending(self.label, x)
        if self.style != "points":
            x, y = finest(x, y)
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)

    def visible(self, width_px: int, height_px: int, log_y: bool = False) -> np.ndarray:
        """Indices of the samples that draw the same picture in an area of this size as all of them."""
        if self.style != "points":
            return m4(self.x, self.y, width_px)
        y = np.log10(self.y) if log_y and self.axis == "left" else self.y
        return scatter(self.x, y, width_px // DOT_PX, height_px // DOT_PX)


@dataclass(frozen=True, eq=False)
class Band:
    """Shaded region low_i <= y <= high_i on the left axis, as of an uncertainty.

    Raises: InputError for lengths that differ, descending x, low above high, an unknown role.
    """

    #: (n,) ascending; low, high: (n,), NaN in either is a gap. A long band becomes its `decimate.envelope`.
    x: np.ndarray

    low: np.ndarray
    high: np.ndarray
    label: str
    role: Meaning = "estimate"  #: as in `Series`, but not "auto"

    def __post_init__(self) -> None:
        _check_choice("role", self.role, tuple(MEANING))
        x, low, high = _columns(self.label, x=self.x, low=self.low, high=self.high)
        _check_ascending(self.label, x)
        if (low > high).any():
            i = int(np.argmax(low > high))
            raise InputError(
                f"band {self.label!r}: low must not exceed high, got {low[i]:g} > {high[i]:g} at index {i}"
            )
        gap = np.isnan(low) | np.isnan(high)
        if gap.any():
            low, high = np.where(gap, np.nan, low), np.where(gap, np.nan, high)
        for name, values in zip(("x", "low", "high"), envelope(x, low, high, 2 * FINEST), strict=True):
            object.__setattr__(self, name, values)


class Marker(NamedTuple):
    """Vertical line at x, in the unit of the figure's x."""

    x: float
    label: str
    role: Meaning = "background"


class Span(NamedTuple):
    """Shaded part of the x axis; spans of one label share one entry of the legend."""

    x_from: float
    x_to: float
    label: str
    role: Meaning = "background"


@dataclass(frozen=True, eq=False)
class Figure:
    """One plot.

    Raises: InputError for a right series without right_label, values <= 0 on a log axis, limits that do not ascend.
    """

    title: str
    #: `TIME`, or a name and unit such as "Slip ratio [-]"
    x_label: str

    #: the same for both y axes
    y_label: str
    series: Sequence[Series] = ()
    bands: Sequence[Band] = ()
    markers: Sequence[Marker] = ()
    spans: Sequence[Span] = ()
    right_label: str = ""
    #: logarithmic left axis; its values must be positive
    log_y: bool = False
    y_limits: tuple[float, float] | None = None  #: ends of the left axis; None fits the data
    height_px: int = field(default=260, kw_only=True)  #: of the drawing without legend and title

    def __post_init__(self) -> None:
        for name in ("series", "bands", "markers", "spans"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for role in [m.role for m in self.markers] + [s.role for s in self.spans]:
            _check_choice("role", role, tuple(MEANING))
        if not self.right_label and any(s.axis == "right" for s in self.series):
            raise InputError(
                f"figure {self.title!r}: a series on the right axis needs right_label, for example 'I [A]'"
            )
        _check_limits(self)
        if self.log_y:
            _check_positive(self)


def _columns(label: str, **columns: np.ndarray) -> list[np.ndarray]:
    """Columns as float arrays of one common length; infinite values of y become NaN."""
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    shapes = {name: a.shape for name, a in arrays.items()}
    if any(a.ndim != 1 for a in arrays.values()) or len(set(shapes.values())) != 1:
        raise InputError(f"series {label!r}: {', '.join(arrays)} must be 1-D and equally long, got {shapes}")
    return [a if name == "x" else _without_infinities(a) for name, a in arrays.items()]


def _without_infinities(values: np.ndarray) -> np.ndarray:
    infinite = np.isinf(values)
    return np.where(infinite, np.nan, values) if infinite.any() else values


def _check_ascending(label: str, x: np.ndarray) -> None:
    if not np.isfinite(x).all():
        raise InputError(f"series {label!r}: x must be finite, drop the samples without an x")
    back = np.flatnonzero(x[1:] < x[:-1])
    if back.size:
        i = int(back[0])
        raise InputError(
            f"series {label!r}: x must ascend, got {x[i]:g} before {x[i + 1]:g} at index {i}; sort it, "
            "make one series of each branch, or use style='points'"
        )


def _check_choice(name: str, value: str, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(allowed)}, got {value!r}")


def _check_limits(figure: Figure) -> None:
    of_spans = [x for s in figure.spans for x in (s.x_from, s.x_to)]
    edges = [m.x for m in figure.markers] + of_spans + list(figure.y_limits or ())
    if not np.isfinite(edges).all():
        raise InputError(f"figure {figure.title!r}: markers, spans and y_limits must be finite, got {edges}")
    for span in figure.spans:
        if span.x_from > span.x_to:
            raise InputError(f"span {span.label!r}: x_from must not exceed x_to, got {span.x_from:g} > {span.x_to:g}")
    if figure.y_limits is None:
        return
    if not figure.y_limits[0] < figure.y_limits[1]:
        raise InputError(f"figure {figure.title!r}: y_limits must ascend, got {figure.y_limits}")
    if figure.log_y and figure.y_limits[0] <= 0:
        raise InputError(f"figure {figure.title!r}: y_limits of a log axis must be positive, got {figure.y_limits}")


def _check_positive(figure: Figure) -> None:
    left = [(s.label, s.y) for s in figure.series if s.axis == "left"] + [(b.label, b.low) for b in figure.bands]
    for label, values in left:
        if (values <= 0).any():
            raise InputError(
                f"figure {figure.title!r}: log_y needs values > 0, {label!r} has {np.nanmin(values):g}; "
                "set those to NaN, or use a linear axis"
            )
