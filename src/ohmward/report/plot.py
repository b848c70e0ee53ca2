"""Figures above each other for a notebook, or as a file of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from os import PathLike

from ohmward.report.figure import Figure
from ohmward.report.page import Page

#: Height of a title with its legend, and of what stands above the first figure [px].
_LEGEND_PX, _HEADER_PX = 75, 130


@dataclass(frozen=True, eq=False)
class Plot:
    """Figures on one x axis: they zoom and scroll together. A notebook shows it; `save` writes one HTML file."""

    title: str
    figures: Sequence[Figure]

    def html(self) -> str:
        """A page that needs no network."""
        return Page(self.title).plot(*self.figures).html()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the page; the file is either whole or not there."""
        Page(self.title).plot(*self.figures).write(path)

    def _repr_html_(self) -> str:
        height_px = _HEADER_PX + sum(figure.height_px + _LEGEND_PX for figure in self.figures)
        page = escape(self.html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%;height:{height_px}px;border:0"></iframe>'
