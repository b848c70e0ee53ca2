"""A card: a title, a few facts and a small picture, as a notebook shows a log, a battery or a run."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Final

import numpy as np

from ohmward.report.figure import MEANING, SHADES, Band, Figure, Series, colours, envelope, m4
from ohmward.report.map import Line, Map, polylines

#: Size of the picture and width of its lines [px], and the number of columns for thinning these.
_CARD_WIDTH, _CARD_HEIGHT, _LINE_PX, _CARD_COLUMNS = 320.0, 90.0, 1.2, 320
#: Extent assumed for a path in a direction in which it does not move.
_STILL_EXTENT: Final = 1e-9
_CARD: Final = "display:inline-flex;gap:24px;align-items:center;font-size:13px;line-height:1.5"
_NAME: Final = "font-size:13px;text-align:left;padding:0 12px 0 0;font-weight:normal;opacity:.7"
_VALUE: Final = "font-size:13px;text-align:left;padding:0"


def card(title: str, facts: Mapping[str, str], figure: Figure | Map | None = None) -> str:
    """HTML with its own style, readable on light and dark backgrounds.

    facts: name and value, a row each; those without a value are left out.
    figure: its left axis is drawn; for a map, the last line.
    """
    rows = "".join(
        f'<tr><th style="{_NAME}">{escape(name)}</th><td style="{_VALUE}">{escape(value)}</td></tr>'
        for name, value in facts.items()
        if value
    )
    picture = ""
    if figure is not None:
        drawn = _path(figure.lines[-1]) if isinstance(figure, Map) else _curves(figure)
        picture = (
            f'<div><svg viewBox="0 -2 {_CARD_WIDTH:g} {_CARD_HEIGHT + 4:g}" width="{_CARD_WIDTH:g}" role="img" '
            f'aria-label="{escape(figure.title, quote=True)}">{drawn}</svg><div>{escape(figure.y_label)}</div></div>'
        )
    return f'<div style="{_CARD}"><div><b>{escape(title)}</b><table>{rows}</table></div>{picture}</div>'


def _path(line: Line) -> str:
    """A line in plan view, at one scale."""
    points = np.column_stack([line.x, line.y]).astype(float)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return ""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    extent[extent == 0.0] = _STILL_EXTENT
    scale = np.full(2, np.min((_CARD_WIDTH, _CARD_HEIGHT) / extent))
    colour = SHADES[MEANING[line.role]].light
    return polylines(_places(points[:, 0], points[:, 1], low, scale), colour, _LINE_PX)


def _curves(figure: Figure) -> str:
    """Bands and lines of the left axis."""
    lines = [series for series in figure.series if series.axis == "left" and np.isfinite(series.y).any()]
    if not lines:
        return ""
    lows, highs = [band.low for band in figure.bands], [band.high for band in figure.bands]
    drawn = np.concatenate([*(series.y for series in lines), *lows, *highs])
    low, high = figure.y_limits or (np.nanmin(drawn), np.nanmax(drawn))
    corner = np.array([min(series.x[0] for series in lines), low])
    extent = np.array([max(series.x[-1] for series in lines), high]) - corner
    extent[extent == 0.0] = 1.0
    scale = (_CARD_WIDTH, _CARD_HEIGHT) / extent
    names = colours([series.role for series in lines])
    bands = "".join(_band(band, corner, scale) for band in figure.bands)
    curves = "".join(_line(series, name, corner, scale) for series, name in zip(lines, names, strict=True))
    return bands + curves


def _line(series: Series, colour: str, corner: np.ndarray, scale: np.ndarray) -> str:
    """A line, or dots."""
    rows = m4(series.x, series.y, _CARD_COLUMNS)
    points = _places(series.x[rows], series.y[rows], corner, scale)
    stroke = SHADES[colour].light
    if series.style == "points":
        dots = points[np.isfinite(points[:, 1])]
        return "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1" fill="{stroke}"/>' for x, y in dots)
    return polylines(points, stroke, _LINE_PX)


def _band(band: Band, corner: np.ndarray, scale: np.ndarray) -> str:
    x, low, high = envelope(band.x, band.low, band.high, _CARD_COLUMNS)
    known = np.isfinite(low) & np.isfinite(high)
    above, below = (_places(x[known], edge[known], corner, scale) for edge in (high, low))
    outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in np.vstack([above, below[::-1]]))
    return f'<polygon points="{outline}" fill="{SHADES[MEANING[band.role]].light}" opacity="0.2"/>'


def _places(x: np.ndarray, y: np.ndarray, corner: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the picture, y downwards and clipped at its edges."""
    points = (np.column_stack([x, y]) - corner) * scale
    points[:, 1] = _CARD_HEIGHT - np.clip(points[:, 1], 0.0, _CARD_HEIGHT)
    return points
