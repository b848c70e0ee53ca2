"""Figures as one SVG picture for a README or the documentation: the same data as on the page, without the browser.

The picture follows the reader's light or dark theme by itself, uses no script and no font of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import Final, NamedTuple

import numpy as np

from ohmward.report.axis import XAxis, linear_ticks, shared_x, tick_labels
from ohmward.report.figure import DOT_PX, MEANING, SHADES, SURFACES, Figure, Side, Theme, colours, envelope
from ohmward.runs import runs

MARGIN: Final = 70.0
"""Left of the plot, and right of it where there is a right axis [px]."""
EDGE: Final = 18.0
LINE: Final = 20.0
CHARACTER: Final = 6.7
"""Mean width of a character of 12 px sans-serif text [px]."""


class Scale(NamedTuple):
    """Maps [low, high] of the data to [start, end] in pixels."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def px(self, values: np.ndarray) -> np.ndarray:
        """Pixel positions (n,) of values (n,)."""
        transform = np.log10 if self.log else np.asarray
        low, high = transform(self.low), transform(self.high)
        return self.start + (transform(values) - low) / (high - low) * (self.end - self.start)

    def ticks(self, intervals: int) -> list[tuple[float, str]]:
        """Position [px] and label of the nice values within the scale."""
        if not self.log:
            values = linear_ticks(self.low, self.high, intervals)
            return list(zip(self.px(values).tolist(), tick_labels(values), strict=True))
        values = log_ticks(self.low, self.high)
        return [(px, *tick_labels(value)) for px, value in zip(self.px(values).tolist(), values[:, None], strict=True)]


def log_ticks(low: float, high: float) -> np.ndarray:
    """Powers of ten within [low, high], 0 < low < high; if there are fewer than two, 2 and 5 times them as well."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1,), (1, 2, 5)):
        ticks = [m * 10.0**e for e in exponents for m in multiples if low <= m * 10.0**e <= high]
        if len(ticks) >= 2:
            break
    return np.array(ticks)


class Area(NamedTuple):
    """The plotting area of one figure in the picture [px]."""

    left: float
    top: float
    width: float
    height: float


class Entry(NamedTuple):
    """One entry of a legend: what it is called, its colour, its mark."""

    label: str
    colour: str
    mark: str


def to_svg(*figures: Figure, width_px: int = 800) -> str:
    """The figures above each other on one x axis, as the text of an SVG file.

    Raises: InputError when they do not have one x_label.
    """
    x_axis = shared_x(figures)
    right = MARGIN if any(f.right_label for f in figures) else EDGE
    parts, top = [], EDGE
    for figure in figures:
        legend, legend_height = _legend(figure, top + LINE + 4, width_px)
        area = Area(MARGIN, top + LINE + legend_height + 10, width_px - MARGIN - right, figure.height_px)
        parts += [_text("title", EDGE, top + 13, figure.title), *legend, *_panel(figure, x_axis, area)]
        top = area.top + area.height + LINE + EDGE
    parts.append(_text("label", MARGIN + (width_px - MARGIN - right) / 2, top - 2, x_axis.label, "middle"))
    height = top + 12
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width_px} {height:g}" width="{width_px}" role="img">',
        f"<title>{escape(', '.join(f.title for f in figures))}</title>",
        f"<style>{_style()}</style>",
        f'<rect class="paper" width="{width_px}" height="{height:g}" rx="10"/>',
        *parts,
        "</svg>\n",
    ])  # fmt: skip


def _panel(figure: Figure, x_axis: XAxis, area: Area) -> Iterable[str]:
    x = Scale(x_axis.low * x_axis.unit, x_axis.high * x_axis.unit, 0.0, area.width)
    x_shown = Scale(x_axis.low, x_axis.high, 0.0, area.width)
    y: dict[Side, Scale] = {"left": _y_scale(figure, "left", area.height)}
    y["right"] = _y_scale(figure, "right", area.height)
    yield from _x_ticks(x_shown, area)
    yield from _y_ticks(y["left"], area, "left", figure.y_label)
    if figure.right_label:
        yield from _y_ticks(y["right"], area, "right", figure.right_label)
    yield f'<svg x="{area.left:g}" y="{area.top:g}" width="{area.width:g}" height="{area.height:g}">'
    yield from _spans(figure, x, area.height)
    yield from _bands(figure, x, y["left"])
    yield from _series(figure, x, y)
    yield from _markers(figure, x, area)
    yield "</svg>"


def _y_scale(figure: Figure, side: Side, height: float) -> Scale:
    log = figure.log_y and side == "left"
    if figure.y_limits and side == "left":
        return Scale(*figure.y_limits, height, 0.0, log)
    values = [s.y for s in figure.series if s.axis == side]
    values += [v for b in figure.bands for v in (b.low, b.high) if side == "left"]
    finite = np.concatenate([np.empty(0), *(v[np.isfinite(v)] for v in values)])
    if finite.size == 0:
        return Scale(1.0, 10.0, height, 0.0, log) if log else Scale(0.0, 1.0, height, 0.0)
    low, high = float(finite.min()), float(finite.max())
    return Scale(*_padded(low, high, log), height, 0.0, log)


def _padded(low: float, high: float, log: bool) -> tuple[float, float]:
    """The range and 5 % of it on both sides; a single value gets room around it."""
    if log:
        padded = _padded(math.log10(low), math.log10(high), log=False)
        return 10.0 ** padded[0], 10.0 ** padded[1]
    pad = 0.05 * (high - low) or 0.1 * abs(high) or 1.0
    return low - pad, high + pad


def _x_ticks(x: Scale, area: Area) -> Iterable[str]:
    bottom = area.top + area.height
    for px, label in x.ticks(max(int(area.width / 80), 2)):
        yield _line("grid", area.left + px, area.top, area.left + px, bottom)
        yield _text("label", area.left + px, bottom + 17, label, "middle")


def _y_ticks(y: Scale, area: Area, side: Side, label: str) -> Iterable[str]:
    right = area.left + area.width
    at, anchor = (area.left - 8, "end") if side == "left" else (right + 8, "start")
    for px, text in y.ticks(max(int(area.height / 45), 2)):
        if side == "left":
            yield _line("grid", area.left, area.top + px, right, area.top + px)
        yield _text("label", at, area.top + px + 4, text, anchor)
    turn, x = (-90, EDGE + 4) if side == "left" else (90, right + MARGIN - EDGE - 4)
    middle = area.top + area.height / 2
    move = f"translate({x:.1f} {middle:.1f}) rotate({turn})"
    yield f'<text class="label" text-anchor="middle" transform="{move}">{escape(label)}</text>'


def _spans(figure: Figure, x: Scale, height: float) -> Iterable[str]:
    for span in figure.spans:
        left, right = x.px(np.array([span.x_from, span.x_to]))
        width = max(right - left, 1.0)
        yield f'<rect class="area {MEANING[span.role]}" x="{left:.1f}" y="0" width="{width:.1f}" height="{height:g}"/>'


def _bands(figure: Figure, x: Scale, y: Scale) -> Iterable[str]:
    for band in figure.bands:
        xs, low, high = envelope(band.x, band.low, band.high, int(x.end))
        for i, j in runs(np.isfinite(low + high)):
            there, back = (np.stack([x.px(xs[i:j]), y.px(edge[i:j])], axis=1) for edge in (high, low))
            outline = np.concatenate([there, back[::-1]])
            yield f'<path class="area {MEANING[band.role]}" d="{_polyline(outline)}z"/>'


def _series(figure: Figure, x: Scale, y: dict[Side, Scale]) -> Iterable[str]:
    for series, colour in zip(figure.series, colours([s.role for s in figure.series]), strict=True):
        kept = series.visible(int(x.end), figure.height_px, figure.log_y)
        points = np.stack([x.px(series.x[kept]), y[series.axis].px(series.y[kept])], axis=1)
        draw = {"points": _dots, "step": _stairs}.get(series.style, _polyline)
        path = "".join(draw(points[i:j]) for i, j in runs(np.isfinite(points[:, 1])))
        yield f'<path class="{_kind(series.style)} {colour}" d="{path}"/>'


def _markers(figure: Figure, x: Scale, area: Area) -> Iterable[str]:
    free = 0.0
    for marker in sorted(figure.markers):
        px = float(x.px(np.array([marker.x]))[0])
        colour = MEANING[marker.role]
        yield _line(f"line dashed {colour}", px, 0.0, px, area.height)
        if px >= free:
            yield _text(f"label fill {colour}", px + 5, 13, marker.label)
            free = px + 5 + CHARACTER * len(marker.label)


def _polyline(points: np.ndarray) -> str:
    """A path through points (n, 2) [px], in differences of tenths of a pixel; a single one becomes a dot."""
    start, steps = _differences(points)
    return f"M{start}l{' '.join(f'{dx:g},{dy:g}' for dx, dy in steps)}" if len(steps) else _dots(points)


def _stairs(points: np.ndarray) -> str:
    start, steps = _differences(points)
    return f"M{start}{''.join(f'h{dx:g}v{dy:g}' for dx, dy in steps)}" if len(steps) else _dots(points)


def _dots(points: np.ndarray) -> str:
    """Lines without length: their round ends are the dots."""
    return "".join(f"M{px:.1f} {py:.1f}h0" for px, py in points)


def _differences(points: np.ndarray) -> tuple[str, np.ndarray]:
    near = np.round(points, 1)
    return f"{near[0, 0]:g} {near[0, 1]:g}", np.round(np.diff(near, axis=0), 1) + 0.0


def _legend(figure: Figure, top: float, width: float) -> tuple[list[str], float]:
    """The entries, in as many lines as they need, and the height of these."""
    parts, x, row = [], EDGE, 0
    for entry in _entries(figure):
        advance = 24 + CHARACTER * len(entry.label) + 16
        if x + advance > width and x > EDGE:
            x, row = EDGE, row + 1
        y = top + LINE * row
        parts += [_mark(entry, x, y + 6), _text("label", x + 24, y + 10, entry.label)]
        x += advance
    return parts, LINE * (row + 1)


def _entries(figure: Figure) -> list[Entry]:
    names = colours([s.role for s in figure.series])
    lines = [Entry(s.label, name, s.style) for s, name in zip(figure.series, names, strict=True)]
    bands = [Entry(b.label, MEANING[b.role], "area") for b in figure.bands]
    spans = [Entry(s.label, MEANING[s.role], "area") for s in figure.spans]
    return [entry for entry in dict.fromkeys(lines + bands + spans) if entry.label]


def _mark(entry: Entry, x: float, y: float) -> str:
    if entry.mark == "area":
        return f'<rect class="area {entry.colour}" x="{x:g}" y="{y - 6:g}" width="18" height="12" rx="3"/>'
    width = 0 if entry.mark == "points" else 18
    return f'<path class="{_kind(entry.mark)} {entry.colour}" d="M{x + 9 - width / 2:g} {y:g}h{width}"/>'


def _kind(style: str) -> str:
    """The class that draws a style."""
    return {"points": "dots", "dashed": "line dashed"}.get(style, "line")


def _line(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<path class="{kind}" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>'


def _text(kind: str, x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _style() -> str:
    return (
        "text{font:12px system-ui,-apple-system,'Segoe UI',Roboto,Arial,sans-serif}"
        ".title{font-size:15px;font-weight:600}"
        ".line,.dots,.grid{fill:none;stroke-linejoin:round}.grid{stroke-width:1}.line{stroke-width:1.6}"
        f".dots{{stroke-width:{DOT_PX};stroke-linecap:round}}"
        ".dashed{stroke-dasharray:7 5}.area{stroke:none;fill-opacity:.18}"
        f"{_theme('light')}@media(prefers-color-scheme:dark){{{_theme('dark')}}}"
    )


def _theme(theme: Theme) -> str:
    hues = {name: getattr(shade, theme) for name, shade in (SHADES | SURFACES).items()}
    marks = "".join(f".{n}.line,.{n}.dots{{stroke:{hues[n]}}}.{n}.area,.{n}.fill{{fill:{hues[n]}}}" for n in SHADES)
    return (
        f".paper{{fill:{hues['card']}}}.title{{fill:{hues['ink']}}}.label{{fill:{hues['soft']}}}"
        f".grid{{stroke:{hues['grid']}}}{marks}"
    )
