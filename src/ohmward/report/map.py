"""Map: lines in plan view, at one scale in both directions, as SVG that needs no script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final, NamedTuple

import numpy as np

from ohmward.checks import require_one_of
from ohmward.errors import InputError
from ohmward.report.axis import linear_ticks, tick_labels
from ohmward.report.drawing import Drawing, add_legend, add_line
from ohmward.report.figure import MEANING, Meaning
from ohmward.report.page import Page

#: Largest area of the lines [px], and room for labels at its left, bottom and top.
WIDTH_PX, HEIGHT_PX, LEFT_PX, BOTTOM_PX, TOP_PX = 960.0, 480.0, 64.0, 48.0, 12.0

#: Margin around the lines as a share of their extent, and the smallest extent [unit of the axes].
MAP_MARGIN, LEAST_EXTENT = 0.04, 1e-3

#: Height of a page with a map.
_PAGE_PX: Final = 720

#: Points of a line closer than this [px] look like one.
NEAR_PX: Final = 0.5


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points in their order, in any direction.

    Raises:
        InputError: lengths that differ, an unknown role.
    """

    #: (n,); a point with NaN is a gap
    x: np.ndarray
    y: np.ndarray
    label: str
    role: Meaning = "estimate"  #: meaning of its colour, see `MEANING`

    def __post_init__(self) -> None:
        require_one_of("role", self.role, tuple(MEANING))
        if np.ndim(self.x) != 1 or np.shape(self.x) != np.shape(self.y):
            shapes = f"{np.shape(self.x)}, {np.shape(self.y)}"
            raise InputError(f"line {self.label!r}: x and y must be of one length (n,), got {shapes}")


class Area(NamedTuple):
    """Area of the lines: its corner at the lower left, its extent [unit of the axes], and the scale of both axes."""

    x: float
    y: float
    width: float
    height: float
    px_per_unit: float


@dataclass(frozen=True, eq=False, repr=False)
class Map(Drawing):
    """Lines in plan view at one scale."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]

    def svg(self) -> str:
        """The map as an element of a page; the last line is on top."""
        area = area_of(self.lines)
        width, height = area.width * area.px_per_unit, area.height * area.px_per_unit
        size = f"{LEFT_PX + width + TOP_PX:.0f} {TOP_PX + height + BOTTOM_PX:.0f}"
        drawn = "".join(
            polylines(to_px(area, line.x, line.y), f"var(--{MEANING[line.role]})", 1.8) for line in self.lines
        )
        frame = f'<rect x="{LEFT_PX:g}" y="{TOP_PX:g}" width="{width:.1f}" height="{height:.1f}" class="frame"/>'
        parts = (_x_axis(area, self.x_label), _y_axis(area, self.y_label), frame, drawn)
        return f'<svg viewBox="0 0 {size}" role="img" aria-label="{escape(self.title)}">{"".join(parts)}</svg>'

    def page(self) -> Page:
        """A page that needs no network."""
        return Page(self.title).map(self)

    def draw(self, canvas: Any) -> Any:
        """The lines on a figure of matplotlib."""
        canvas.set_layout_engine("constrained")
        ax = canvas.subplots()
        for line in self.lines:
            add_line(ax, line.x, line.y, MEANING[line.role], line.label)
        ax.set(xlabel=self.x_label, ylabel=self.y_label, title=self.title, aspect="equal")
        add_legend(ax)
        return canvas

    @property
    def height_px(self) -> int:
        """Height of the page."""
        return _PAGE_PX

    def block(self) -> str:
        """The map with its title and legend, as a block of a page."""
        meaning = {line.label: MEANING[line.role] for line in self.lines}
        items = "".join(
            f'<span class="fixed"><i style="--colour:var(--{colour})"></i>{escape(label)}</span>'
            for label, colour in meaning.items()
        )
        caption = f"<figure><figcaption>{escape(self.title)}</figcaption></figure>"
        return f'<div class="map">{caption}<div class="legend">{items}</div>{self.svg()}</div>'


def area_of(lines: Sequence[Line]) -> Area:
    """Area that holds all finite points with a margin."""
    points = np.hstack([np.zeros((2, 0)), *(np.array([line.x, line.y], dtype=float) for line in lines)])
    points = points[:, np.isfinite(points).all(axis=0)]
    if points.shape[1] == 0:
        points = np.zeros((2, 1))
    low, high = points.min(axis=1), points.max(axis=1)
    least = max(LEAST_EXTENT, 0.1 * float(np.max(high - low)))
    extent = np.maximum(high - low, least) * (1 + 2 * MAP_MARGIN)
    corner = (low + high - extent) / 2
    width, height = float(extent[0]), float(extent[1])
    return Area(float(corner[0]), float(corner[1]), width, height, min(WIDTH_PX / width, HEIGHT_PX / height))


def to_px(area: Area, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the drawing, y downwards."""
    across = LEFT_PX + (np.asarray(x, dtype=float) - area.x) * area.px_per_unit
    down = TOP_PX + (area.y + area.height - np.asarray(y, dtype=float)) * area.px_per_unit
    return np.column_stack([across, down])


def thinned(points: np.ndarray) -> np.ndarray:
    """The points (n, 2) that a line needs to look the same: each at least `NEAR_PX` from the last one kept."""
    rows, (last_x, last_y) = [0], points[0].tolist()
    for k, (x, y) in enumerate(points.tolist()):  # numbers of Python: four times as fast as rows of NumPy
        if abs(x - last_x) >= NEAR_PX or abs(y - last_y) >= NEAR_PX:
            last_x, last_y = x, y
            rows.append(k)
    return points[rows]


def polylines(points: np.ndarray, colour: str, width: float) -> str:
    """A line through points (n, 2) of a drawing, in pieces between its gaps.

    colour: as in CSS.  width: of the line [px].
    """
    gaps = np.flatnonzero(~np.isfinite(points).all(axis=1))
    runs = [run[np.isfinite(run).all(axis=1)] for run in np.split(points, gaps)]
    drawn = [" ".join(f"{x:.1f},{y:.1f}" for x, y in thinned(run)) for run in runs if len(run) > 1]
    style = f'fill="none" stroke="{colour}" stroke-width="{width:g}"'
    return "".join(f'<polyline points="{text}" {style}/>' for text in drawn)


def _x_axis(area: Area, label: str) -> str:
    bottom = TOP_PX + area.height * area.px_per_unit
    ticks = linear_ticks(area.x, area.x + area.width, max(int(area.width * area.px_per_unit // 90), 1))
    at_px = to_px(area, ticks, np.full(len(ticks), area.y))[:, 0]
    marks = [
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP_PX:g}" y2="{bottom:.1f}" class="grid"/>'
        f'<text x="{x:.1f}" y="{bottom + 18:.1f}" text-anchor="middle">{text}</text>'
        for x, text in zip(at_px, tick_labels(ticks), strict=True)
    ]
    middle = LEFT_PX + area.width * area.px_per_unit / 2
    name = f'<text x="{middle:.1f}" y="{bottom + 40:.1f}" text-anchor="middle">{escape(label)}</text>'
    return "".join(marks) + name


def _y_axis(area: Area, label: str) -> str:
    right = LEFT_PX + area.width * area.px_per_unit
    ticks = linear_ticks(area.y, area.y + area.height, max(int(area.height * area.px_per_unit // 45), 1))
    at_px = to_px(area, np.full(len(ticks), area.x), ticks)[:, 1]
    marks = [
        f'<line x1="{LEFT_PX:g}" x2="{right:.1f}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>'
        f'<text x="{LEFT_PX - 8:g}" y="{y + 4:.1f}" text-anchor="end">{text}</text>'
        for y, text in zip(at_px, tick_labels(ticks), strict=True)
    ]
    middle = TOP_PX + area.height * area.px_per_unit / 2
    name = (
        f'<text x="14" y="{middle:.1f}" text-anchor="middle" transform="rotate(-90 14 {middle:.1f})">'
        f"{escape(label)}</text>"
    )
    return "".join(marks) + name
