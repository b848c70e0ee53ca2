"""What a result draws: a page for a browser or a notebook, or axes of matplotlib for a paper."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

from ohmward.errors import InputError
from ohmward.report import static
from ohmward.report.figure import Figure
from ohmward.report.page import Page

#: Height of a title with its legend, and of what stands above the first figure [px].
_LEGEND_PX, _HEADER_PX = 75, 130


class Drawing(ABC):
    """Something that a notebook shows and `save` writes."""

    @abstractmethod
    def page(self) -> Page:
        """A page that needs no network."""

    @abstractmethod
    def draw(self, canvas: Any) -> Any:
        """Put it on a new figure of matplotlib, which is returned."""

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
        return self.draw(static.new_canvas())

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as a page that can be zoomed (.html), or as a picture (.svg, .pdf, .png); whole or not at all.

        Raises:
            InputError: another ending.
            MissingPackageError: a picture without matplotlib.
            OhmwardError: the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() in static.SUFFIXES:
            static.write(path, self.draw)
        elif path.suffix.lower() in (".html", ".htm"):
            self.page().write(path)
        else:
            raise InputError(f"{path}: name a page .html, and a picture {' or '.join(static.SUFFIXES)}")

    def _repr_html_(self) -> str:
        page = escape(self.html(), quote=True)
        return f'<iframe srcdoc="{page}" style="width:100%;height:{self.height_px}px;border:0"></iframe>'


@dataclass(frozen=True, eq=False)
class Plot(Drawing):
    """Figures on one x axis: they zoom and scroll together."""

    title: str
    figures: Sequence[Figure]

    def page(self) -> Page:
        """A page that needs no network."""
        return Page(self.title).plot(*self.figures)

    def draw(self, canvas: Any) -> Any:
        """The figures above each other on a figure of matplotlib."""
        return static.of_figures(self.figures, canvas)

    @property
    def height_px(self) -> int:
        """Height of the page."""
        return _HEADER_PX + sum(figure.height_px + _LEGEND_PX for figure in self.figures)
