"""Drawings of a result: a page for a browser or a notebook, or axes of matplotlib where no script runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from ohmward.atomic import replacing
from ohmward.errors import InputError
from ohmward.optional import MissingPackageError, require
from ohmward.report.axis import XAxis, shared_x
from ohmward.report.figure import MEANING, SHADES, Figure, Style, colours, envelope
from ohmward.report.page import Page

#: Endings of the files that matplotlib writes.
SUFFIXES: Final = (".svg", ".pdf", ".png")
#: Width of a drawing, height of a title and axis together, and size of a page's pixel [inch].
_WIDTH_IN, _AROUND_IN, _PX_IN = 8.0, 0.55, 1 / 100
#: Dots per inch of a PNG: in a file, and in a notebook, which stores one for every plot.
_DPI, _NOTEBOOK_DPI = 150, 100
#: Columns and rows for thinning lines: more than a page in a journal shows.
_THINNING_COLUMNS, _THINNING_ROWS = 1200, 800
_STYLES: Final[Mapping[Style, Mapping[str, Any]]] = {
    "line": {"linewidth": 1.2},
    "dashed": {"linewidth": 1.2, "linestyle": "--"},
    "step": {"linewidth": 1.2, "drawstyle": "steps-post"},
    "points": {"linestyle": "none", "marker": ".", "markersize": 3.0},
}


def add_line(ax: Any, x: np.ndarray, y: np.ndarray, colour: str, label: str, style: Style = "line") -> None:
    """A line on axes of matplotlib; colour: its name in `SHADES`."""
    ax.plot(x, y, color=_colour(colour), label=label, **_STYLES[style])


def _draw(figure: Figure, ax: Any, x_axis: XAxis) -> None:
    place = x_axis.place
    named: set[str] = set()
    for span in figure.spans:
        shade = {"color": _colour(MEANING[span.role]), "alpha": 0.12, "linewidth": 0}
        label = f"_{span.label}" if span.label in named else span.label  # the legend names each once
        named.add(span.label)
        ax.axvspan(place(span.x_from), place(span.x_to), label=label, **shade)
    for band in figure.bands:
        shade = {"color": _colour(MEANING[band.role]), "alpha": 0.2, "linewidth": 0}
        x, low, high = envelope(band.x, band.low, band.high, _THINNING_COLUMNS)
        ax.fill_between(place(x), low, high, label=band.label, **shade)
    right = ax.twinx() if figure.right_label else None
    for series, name in zip(figure.series, colours([s.role for s in figure.series]), strict=True):
        rows = series.visible(_THINNING_COLUMNS, _THINNING_ROWS, figure.log_y)
        side = right if right is not None and series.axis == "right" else ax
        add_line(side, place(series.x[rows]), series.y[rows], name, series.label, series.style)
    for marker in figure.markers:
        ax.axvline(place(marker.x), color=_colour(MEANING[marker.role]), linewidth=0.8, label=marker.label)
    ax.set_title(figure.title, loc="left", fontsize="medium")
    ax.set_ylabel(figure.y_label)
    if figure.log_y:
        ax.set_yscale("log")
    if figure.y_limits is not None:
        ax.set_ylim(*figure.y_limits)
    if right is not None:
        right.set_ylabel(figure.right_label)
    ax.margins(x=0.0)
    ax.grid(color=_colour("grey"), alpha=0.25, linewidth=0.5)
    add_legend(ax, right)


def add_legend(*axes: Any) -> None:
    """A legend on the first of the axes with the entries of all; none for a single entry."""
    entries: dict[str, Any] = {}
    for ax in axes:
        if ax is not None:
            handles, labels = ax.get_legend_handles_labels()
            entries = dict(zip(labels, handles, strict=True)) | entries
    if len(entries) > 1:
        axes[0].legend(entries.values(), entries.keys(), fontsize="x-small", loc="best", framealpha=0.7)


def _colour(name: str) -> str:
    return SHADES[name].light


#: Height of a title with its legend, and of the header above the first figure [px].
_LEGEND_PX, _HEADER_PX = 75, 130


class Drawing(ABC):
    """Base of drawings that a notebook shows and `save` writes."""

    title: str

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.title!r}; show it in a notebook, or save('page.html'))"

    @abstractmethod
    def page(self) -> Page:
        """A page that needs no network."""

    @abstractmethod
    def draw(self, canvas: Any) -> Any:
        """Draw on a new figure of matplotlib, which is returned."""

    @property
    @abstractmethod
    def height_px(self) -> int:
        """Height of the page."""

    def html(self) -> str:
        """The page as text."""
        return self.page().html()

    def to_matplotlib(self) -> Any:
        """A `matplotlib.figure.Figure` whose axes can be changed before it is saved.

        Raises:
            MissingPackageError: matplotlib is not installed.
        """
        return self.draw(require("matplotlib.pyplot", "to_matplotlib").figure())

    def save(self, path: str | PathLike[str]) -> None:
        """Write a zoomable page (.html) or a picture (.svg, .pdf, .png), complete or not at all.

        Raises:
            InputError: another file extension.
            MissingPackageError: a picture without matplotlib.
            OhmwardError: the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() in SUFFIXES:
            matplotlib = require("matplotlib.figure", f"a picture as {path.suffix.lower()}")
            with replacing(path) as temporary:
                self.draw(matplotlib.Figure()).savefig(temporary, format=path.suffix[1:].lower(), dpi=_DPI)
        elif path.suffix.lower() in (".html", ".htm"):
            self.page().write(path)
        else:
            raise InputError(f"{path}: name a page .html, and a picture {' or '.join(SUFFIXES)}")

    def _repr_html_(self) -> str:
        page = escape(self.html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%;height:{self.height_px}px;border:0"></iframe>'

    def _repr_png_(self) -> bytes | None:
        """The picture that Jupyter stores beside the page, for a notebook printed or converted to PDF."""
        try:
            matplotlib = require("matplotlib.figure", "a picture")
        except MissingPackageError:
            return None
        file = BytesIO()
        self.draw(matplotlib.Figure()).savefig(file, format="png", dpi=_NOTEBOOK_DPI)
        return file.getvalue()


@dataclass(frozen=True, eq=False, repr=False)
class Plot(Drawing):
    """Figures on one x axis: they zoom and scroll together."""

    title: str
    figures: Sequence[Figure]

    def page(self) -> Page:
        """A page that needs no network."""
        return Page(self.title).plot(*self.figures)

    def draw(self, canvas: Any) -> Any:
        """Draw the figures stacked on a figure of matplotlib."""
        heights = [figure.height_px * _PX_IN for figure in self.figures]
        canvas.set_size_inches(_WIDTH_IN, sum(heights) + _AROUND_IN * len(heights))
        canvas.set_layout_engine("constrained")
        axes = canvas.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        x_axis = shared_x(self.figures)
        for figure, ax in zip(self.figures, axes, strict=True):
            _draw(figure, ax, x_axis)
        axes[-1].set_xlabel(x_axis.label)
        return canvas

    @property
    def height_px(self) -> int:
        """Height of the page."""
        return _HEADER_PX + sum(figure.height_px + _LEGEND_PX for figure in self.figures)
