"""A figure: curves, bands and marks with their colours; long curves are thinned to what a screen shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from ohmward.checks import require_one_of
from ohmward.errors import InputError

Meaning = Literal["estimate", "comparison", "reference", "background", "alert"]
Role = Meaning | Literal["auto"]
Theme = Literal["light", "dark"]


class Shade(NamedTuple):
    """One colour as `#rrggbb`, on a light and on a dark background."""

    light: str
    dark: str


# Hues after Okabe and Ito, "Color Universal Design" (2008): distinct with every common colour blindness.
SHADES: Final[dict[str, Shade]] = {
    "blue": Shade("#0072b2", "#56a9e8"),
    "orange": Shade("#d55e00", "#ff9a57"),
    "green": Shade("#009e73", "#2fc99b"),
    "purple": Shade("#a6487f", "#e0a0cb"),
    "amber": Shade("#9a6700", "#f2d060"),
    "sky": Shade("#3a9bd9", "#a8dcff"),
    "ink": Shade("#1f2933", "#eef2f6"),
    "grey": Shade("#7b8794", "#8b98a5"),
    "red": Shade("#c8102e", "#ff6b6b"),
}
SURFACES: Final[dict[str, Shade]] = {
    "paper": Shade("#f6f7f9", "#12161c"),
    "card": Shade("#ffffff", "#1a2029"),
    "soft": Shade("#5f6c7b", "#9aa7b5"),
    "rule": Shade("#e1e5ea", "#2c3541"),
    "grid": Shade("#eceff3", "#252d38"),
}
CYCLE: Final = ("blue", "orange", "green", "purple", "amber", "sky")
MEANING: Final[dict[Meaning, str]] = {
    "estimate": "blue",
    "comparison": "orange",
    "reference": "ink",
    "background": "grey",
    "alert": "red",
}
ROLES: Final = ("auto", *MEANING)


def colours(roles: Sequence[Role]) -> list[str]:
    """A name in `SHADES` for each role; "auto" takes the next hue of `CYCLE` that no other role of the list uses."""
    taken = {MEANING[role] for role in roles if role != "auto"}
    free = [hue for hue in CYCLE if hue not in taken] or list(CYCLE)
    count = 0
    names = []
    for role in roles:
        names.append(free[count % len(free)] if role == "auto" else MEANING[role])
        count += role == "auto"
    return names


def style_sheet() -> str:
    """The colours of a page: light, dark where the reader prefers it, light on paper."""
    dark = f"@media screen and (prefers-color-scheme:dark){{:root{{{css_variables('dark')}}}}}"
    return f":root{{{css_variables('light')}}}{dark}"


def css_variables(theme: Theme) -> str:
    """`--paper:#f6f7f9;--blue:#0072b2;...` for a style sheet."""
    return "".join(f"--{name}:{getattr(shade, theme)};" for name, shade in (SURFACES | SHADES).items())


DOT_PX: Final = 4
"""Diameter of a sample drawn as a point."""
FINEST: Final = 256_000
"""Columns for which a figure keeps the samples of a long line: a million samples stay whole, and may be zoomed into."""
_COLUMNS_AT_ONCE: Final = 20_000
"""Columns decimated at once: bounds the memory that ten million samples take."""


def m4(x: np.ndarray, y: np.ndarray, columns: int) -> np.ndarray:
    """Indices (k,) of the samples to keep, ascending, k <= 5 * columns.

    x: (n,) ascending; y: (n,), NaN is a gap: the first NaN of a column is kept too.
    A series of at most 4 * columns samples is kept whole.
    """
    if x.size <= 4 * columns:
        return np.arange(x.size)
    edges = column_edges(x, columns)
    blocks = (edges[k : k + _COLUMNS_AT_ONCE + 1] for k in range(0, edges.size - 1, _COLUMNS_AT_ONCE))
    return np.concatenate([block[0] + _column_samples(y[block[0] : block[-1]], block - block[0]) for block in blocks])


def finest(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Line (x, y) of at most 5 samples for each of `FINEST` columns, its ends among them.

    If `FINEST` is 2^k times the number of columns drawn, `m4` selects the same samples from it as from the whole line.
    """
    visible = m4(x, y, FINEST)
    if visible.size == x.size:
        return x, y
    visible = _distinct(np.concatenate([[0], visible, [x.size - 1]]))
    return x[visible], y[visible]


def envelope(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Band (x, low, high) of at most 2 * columns samples that contains the given one.

    x: (n,) ascending; low, high: (n,).  Each column spans from its first to its last x, from its lowest low to its
    highest high; a column without any finite sample is NaN, a gap narrower than a column closes.
    A band of at most 2 * columns samples is unchanged.
    """
    if x.size <= 2 * columns:
        return x, low, high
    edges = column_edges(x, columns)
    ends = x[np.stack([edges[:-1], edges[1:] - 1], axis=1)].ravel()
    lowest, highest = np.fmin.reduceat(low, edges[:-1]), np.fmax.reduceat(high, edges[:-1])
    return ends, np.repeat(lowest, 2), np.repeat(highest, 2)


def scatter(x: np.ndarray, y: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Indices (k,) of samples with dots in the same cells of a grid as all, the lowest and the highest included.

    x, y: (n,), samples whose y is NaN are left out; k <= columns * rows + 2. All are kept if no more than cells.
    """
    seen = np.flatnonzero(~np.isnan(y))
    if seen.size <= columns * rows:
        return seen
    cell = _cells(x[seen], columns) * rows + _cells(y[seen], rows)
    first = np.unique(cell, return_index=True)[1]
    return np.unique(seen[[*first, np.argmin(y[seen]), np.argmax(y[seen])]])


def column_edges(x: np.ndarray, columns: int) -> np.ndarray:
    """Indices, at most columns + 1, that split ascending x (n,) into columns of equal width, without the empty ones."""
    inner = np.linspace(x[0], x[-1], columns + 1)[1:-1]
    return _distinct(np.concatenate([[0], np.searchsorted(x, inner), [x.size]]))


def _distinct(ascending: np.ndarray) -> np.ndarray:
    """Each of ascending whole numbers >= 0 once; `np.unique` takes many times as long."""
    return ascending[np.diff(ascending, prepend=-1) > 0]


def _column_samples(y: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Indices of the first, last, lowest and highest sample and the first gap of each column; edges: (columns + 1,)."""
    gap = np.isnan(y)
    column = np.repeat(np.arange(edges.size - 1), np.diff(edges))
    lowest, highest = np.fmin.reduceat(y, edges[:-1])[column], np.fmax.reduceat(y, edges[:-1])[column]
    drawn = np.zeros(y.size, dtype=bool)
    for chosen in (gap, ~gap, y == lowest, y == highest):
        rows = np.flatnonzero(chosen)
        drawn[rows[np.diff(column[rows], prepend=-1) != 0]] = True  # the first of each column
    known = np.flatnonzero(~gap)
    drawn[known[np.diff(column[known], append=-1) != 0]] = True
    return np.flatnonzero(drawn)


def _cells(values: np.ndarray, count: int) -> np.ndarray:
    """Number of the cell of each value, of `count` equal cells between the lowest and the highest value."""
    low, high = values.min(), values.max()
    return np.minimum((values - low) / (high - low or 1.0) * count, count - 1).astype(int)


TIME: Final = "time"
"""As `x_label`: x is in seconds; the drawing shows it in s, min or h, chosen by its duration, and labels the unit."""

Style = Literal["line", "points", "step", "dashed"]
Side = Literal["left", "right"]


@dataclass(frozen=True, eq=False)
class Series:
    """Samples (x_i, y_i) with a label; of a long line only those that `finest` picks, which look the same.

    Raises:
        InputError: lengths that differ, descending x, an unknown style, role or axis.
    """

    x: np.ndarray  #: (n,) ascending; points may come in any order
    y: np.ndarray  #: (n,), NaN (or an infinity) is a gap in the line
    label: str
    style: Style = "line"  #: a "step" holds each value until the next sample
    role: Role = "auto"  #: meaning of the colour, see `MEANING`; "auto" takes the next free hue
    axis: Side = "left"  #: its y axis

    def __post_init__(self) -> None:
        require_one_of("style", self.style, get_args(Style))
        require_one_of("role", self.role, ROLES)
        require_one_of("axis", self.axis, get_args(Side))
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
    """Shaded region low_i <= y <= high_i on the left axis, such as an uncertainty.

    Raises: InputError for lengths that differ, descending x, low above high, an unknown role.
    """

    #: (n,) ascending; low, high: (n,), NaN in either is a gap. A long band becomes its `envelope`.
    x: np.ndarray

    low: np.ndarray
    high: np.ndarray
    label: str
    role: Meaning = "estimate"  #: as in `Series`, but not "auto"

    def __post_init__(self) -> None:
        require_one_of("role", self.role, tuple(MEANING))
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

    y_label: str  #: name and unit of the left axis
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
            require_one_of("role", role, tuple(MEANING))
        if not self.right_label and any(s.axis == "right" for s in self.series):
            raise InputError(
                f"figure {self.title!r}: a series on the right axis needs right_label, for example 'I [A]'"
            )
        edges = [marker.x for marker in self.markers]
        for span in self.spans:
            edges += [span.x_from, span.x_to]
        edges += self.y_limits or ()
        if not np.isfinite(edges).all():
            raise InputError(f"figure {self.title!r}: markers, spans and y_limits must be finite, got {edges}")
        for span in self.spans:
            if span.x_from > span.x_to:
                raise InputError(
                    f"span {span.label!r}: x_from must not exceed x_to, got {span.x_from:g} > {span.x_to:g}"
                )
        if self.y_limits is not None and not self.y_limits[0] < self.y_limits[1]:
            raise InputError(f"figure {self.title!r}: y_limits must ascend, got {self.y_limits}")
        if not self.log_y:
            return
        if self.y_limits is not None and self.y_limits[0] <= 0:
            raise InputError(f"figure {self.title!r}: y_limits of a log axis must be positive, got {self.y_limits}")
        left = [(one.label, one.y) for one in self.series if one.axis == "left"]
        for label, values in left + [(band.label, band.low) for band in self.bands]:
            if (values <= 0).any():
                raise InputError(
                    f"figure {self.title!r}: log_y needs values > 0, {label!r} has {np.nanmin(values):g}; "
                    "set those to NaN, or use a linear axis"
                )


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
