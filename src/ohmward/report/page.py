"""A report page: blocks put together to one HTML file that needs no network.

page = (
    Page("Pulse test", "pack A, 2 h 13 min")
    .numbers({"Capacity": "3.02 Ah ± 0.01"})
    .heading("State of charge")
    .plot(soc, current)
)
page.write("report.html")
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Final, Protocol

from ohmward.atomic import write_text
from ohmward.errors import InputError
from ohmward.report import blocks
from ohmward.report.axis import WallClock
from ohmward.report.figure import Figure, css_variables

_CODE: Final = ("vendor/uplot/uPlot.iife.min.js", "assets/data.js", "assets/save.js", "assets/plots.js")


class Block(Protocol):
    """Drawing that is a block of a page."""

    def block(self) -> str:
        """HTML, its texts escaped."""
        ...


@dataclass(frozen=True)
class Page:
    """A title and the blocks below it. Immutable: every method returns a new page with one block more."""

    title: str
    subtitle: str = ""  #: a line under the title
    #: the last line, for a time stamp and a version: nothing here reads a clock, so that equal input gives equal bytes
    footer: str = ""
    body: tuple[str, ...] = ()
    headings: tuple[str, ...] = ()

    def heading(self, text: str) -> Page:
        """A section title; pages with several get a table of contents."""
        page = replace(self, headings=(*self.headings, text))
        return page._with(blocks.heading(text, _anchor(len(self.headings), text)))

    def chapter(self, title: str, page: Page, sections: int = 0) -> Page:
        """A section with the beginning of another page: the blocks before its headings, then its first sections."""
        headed = self.heading(title)
        return replace(headed, body=(*headed.body, *page._beginning(sections)))

    def _beginning(self, sections: int) -> Iterator[str]:
        """Blocks before the first heading, then those of the first sections with headings one level lower."""
        titles = iter(self.headings[:sections])
        for block in self.body:
            if not block.startswith("<h2"):
                yield block
            elif title := next(titles, None):
                yield blocks.subheading(title)
            else:
                return

    def text(self, text: str) -> Page:
        """Paragraphs, split at blank lines."""
        return self._with(blocks.paragraphs(text))

    def callout(self, level: blocks.Level, text: str) -> Page:
        """A note that stands out; level: "info", "warning" or "error"."""
        return self._with(blocks.callout(level, text))

    def numbers(self, values: Mapping[str, str]) -> Page:
        """A row of key figures: label -> value with unit, such as {"Capacity": "3.02 Ah ± 0.01"}."""
        return self._with(blocks.numbers(values))

    def table(self, header: Sequence[str], rows: Sequence[Sequence[blocks.Cell]], caption: str = "") -> Page:
        """A table of texts and numbers; None is shown as a dash."""
        return self._with(blocks.table(header, rows, caption))

    def plot(self, *figures: Figure, clock: WallClock | None = None) -> Page:
        """Figures above each other on one x axis: they zoom and scroll together.

        clock: of a log with dates: figures over `TIME` are drawn on it.
        """
        return self._with(blocks.plot(figures, clock))

    def map(self, plane: Block) -> Page:
        """Lines from above, such as a `Map`."""
        return self._with(plane.block())

    def html(self) -> str:
        """The whole page."""
        return "".join(self._pieces())

    def _pieces(self) -> Iterator[str]:
        """The whole page piece by piece: its blocks may be large."""
        code = "\n".join(map(_asset, _CODE))
        values = {
            "policy": _content_policy(code),
            "title": escape(self.title),
            "subtitle": f'<p class="subtitle">{escape(self.subtitle)}</p>' if self.subtitle else "",
            "contents": _contents(self.headings),
            "footer": f"<footer>{escape(self.footer)}</footer>" if self.footer else "",
            "style": f"{_asset('vendor/uplot/uPlot.min.css')}\n{_theme()}\n{_asset('assets/report.css')}",
            "licence": _asset("vendor/uplot/LICENSE"),
            "code": code,
        }
        before, after = _asset("assets/page.html").split("$body\n")
        yield Template(before).substitute(values)
        for block in blocks.folded(self.body):
            yield block
            yield "\n"
        yield Template(after).substitute(values)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the page; a reader of `path` sees the old file or the whole new one.

        Raises:
            InputError: a name that does not end in .html or .htm.
            OhmwardError: the file cannot be written.
        """
        if Path(path).suffix.lower() not in (".html", ".htm"):
            raise InputError(
                f"{path}: a page of figures is HTML; name it .html, and save a figure as PNG by its button in the page"
            )
        write_text(Path(path), self._pieces())

    def _with(self, block: str) -> Page:
        return replace(self, body=(*self.body, block))


@cache
def _asset(name: str) -> str:
    return files("ohmward.report").joinpath(name).read_text(encoding="utf-8")


def _theme() -> str:
    """The colours: light, dark where the reader prefers it, light on paper."""
    return (
        f":root{{{css_variables('light')}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{css_variables('dark')}}}}}"
    )


def _content_policy(code: str) -> str:
    """Policy by which the browser loads nothing and runs only this code, whatever the texts of the page contain."""
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    return f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"


def _contents(headings: Sequence[str]) -> str:
    if len(headings) < 3:
        return ""
    links = (f'<a href="#{_anchor(i, text)}">{escape(text)}</a>' for i, text in enumerate(headings))
    return f'<nav aria-label="Contents">{"".join(links)}</nav>'


def _anchor(number: int, text: str) -> str:
    words = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
    return f"{number + 1}-{words}".rstrip("-")
