"""A report page: blocks combined into one HTML file that needs no network; every text is escaped.

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
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Final, Literal, NamedTuple, Protocol, get_args

from ohmward.atomic import write_text
from ohmward.checks import require_one_of
from ohmward.errors import InputError
from ohmward.report.axis import WallClock
from ohmward.report.figure import Figure, style_sheet
from ohmward.report.payload import stack

_CODE: Final = ("vendor/uplot/uPlot.iife.min.js", "assets/data.js", "assets/save.js", "assets/plots.js")

Level = Literal["info", "warning", "error"]


class HeatCell(NamedTuple):
    """A cell of a heat map: its text, and how dark it is, 0 to 4."""

    text: str
    level: int


Cell = str | int | float | HeatCell | None

_LEADING_NUMBER: Final = re.compile(r"([+\-−]?\d[\d.,]*(?:e[+-]?\d+)?\s?%?)(.*)", re.DOTALL)


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
        """A section title that links can point to; pages with several get a table of contents."""
        page = replace(self, headings=(*self.headings, text))
        return page._with(f'<h2 id="{escape(_anchor(len(self.headings), text))}">{escape(text)}</h2>')

    def text(self, text: str) -> Page:
        """Paragraphs, split at blank lines."""
        return self._with(_paragraphs(text))

    def callout(self, level: Level, text: str) -> Page:
        """A note that stands out; level: "info", "warning" or "error", shown as a word, not only by colour."""
        require_one_of("level", level, get_args(Level))
        title = f"<b>{level.capitalize()}</b>"
        return self._with(f'<div class="callout {level}" role="note">{title}<div>{_paragraphs(text)}</div></div>')

    def numbers(self, values: Mapping[str, str]) -> Page:
        """A row of key figures: label -> value with unit, such as {"Capacity": "3.02 Ah ± 0.01"}, the number large."""
        cards = (f"<div><dt>{escape(label)}</dt><dd>{_value(value)}</dd></div>" for label, value in values.items())
        return self._with(f'<dl class="numbers">{"".join(cards)}</dl>')

    def table(self, header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = "") -> Page:
        """A table; columns of numbers are aligned right, None is shown as a dash.

        Raises: InputError for a row that is not as long as the header.
        """
        return self._with(_table(header, rows, caption))

    def plot(self, *figures: Figure, clock: WallClock | None = None) -> Page:
        """Stacked figures on one x axis: they zoom and scroll together.

        clock: of a log with dates; figures over `TIME` show its dates.
        """
        captions = "".join(f"<figure><figcaption>{escape(f.title)}</figcaption></figure>" for f in figures)
        data = embed(stack(figures, clock))  # which `assets/plots.js` draws
        return self._with(f'<div class="stack">{captions}<script type="application/json">{data}</script></div>')

    def map(self, plane: Block) -> Page:
        """Lines in plan view, such as a `Map`."""
        return self._with(plane.block())

    def html(self) -> str:
        """The whole page."""
        return "".join(self._pieces())

    def _pieces(self) -> Iterator[str]:
        """The whole page piece by piece: its blocks may be large."""
        code = "\n".join(map(_asset, _CODE))
        digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
        values = {
            # the browser loads nothing and runs only this code, whatever the texts of the page contain
            "policy": f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'",
            "title": escape(self.title),
            "subtitle": f'<p class="subtitle">{escape(self.subtitle)}</p>' if self.subtitle else "",
            "contents": _contents(self.headings),
            "footer": f"<footer>{escape(self.footer)}</footer>" if self.footer else "",
            "style": f"{_asset('vendor/uplot/uPlot.min.css')}\n{style_sheet()}\n{_asset('assets/report.css')}",
            "licence": _asset("vendor/uplot/LICENSE"),
            "code": code,
        }
        before, after = _asset("assets/page.html").split("$body\n")
        yield Template(before).substitute(values)
        for block in _folded(self.body):
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


def _contents(headings: Sequence[str]) -> str:
    if len(headings) < 3:
        return ""
    links = (f'<a href="#{_anchor(i, text)}">{escape(text)}</a>' for i, text in enumerate(headings))
    return f'<nav aria-label="Contents">{"".join(links)}</nav>'


def _anchor(number: int, text: str) -> str:
    words = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
    return f"{number + 1}-{words}".rstrip("-")


def _paragraphs(text: str) -> str:
    """Paragraphs, split at blank lines."""
    return "".join(f"<p>{escape(part.strip())}</p>" for part in re.split(r"\n\s*\n", text) if part.strip())


def _table(header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = "") -> str:
    for number, row in enumerate(rows):
        if len(row) != len(header):
            raise InputError(f"row {number} has {len(row)} cells, the header has {len(header)}")
    classes = [' class="number"' if _all_numbers(column) else "" for column in zip(*rows, strict=True)]
    classes = classes or [""] * len(header)
    head = "".join(f'<th scope="col"{c}>{escape(name)}</th>' for name, c in zip(header, classes, strict=True))
    cells = ("".join(map(_cell, row, classes)) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    scroll = f'<div class="scroll" tabindex="0" role="group" aria-label="Table: {escape(", ".join(header))}">'
    return f"{scroll}<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def _cell(cell: Cell, column_class: str) -> str:
    if isinstance(cell, HeatCell):
        return f'<td class="number heat-{cell.level}">{escape(cell.text)}</td>'
    if cell is None:
        text = "–"
    else:
        text = f"{cell:.5g}" if isinstance(cell, float) else str(cell)
    return f"<td{column_class}>{escape(text)}</td>"


def _folded(blocks: Iterable[str]) -> Iterator[str]:
    """The blocks, each heading with those below it as a collapsible section."""
    within = False
    for block in blocks:
        if block.startswith("<h2"):
            yield f"{'</details>' * within}<details open><summary>{block}</summary>"
            within = True
        else:
            yield block
    yield "</details>" * within


def embed(data: object) -> str:
    """JSON that is safe inside a script element: no "<" that could close it or open a comment."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _value(text: str) -> str:
    match = _LEADING_NUMBER.fullmatch(text)
    if match is None:
        return f'<b class="word">{escape(text)}</b>'
    return f"<b>{escape(match[1])}</b><span>{escape(match[2])}</span>"


def _all_numbers(column: Sequence[Cell]) -> bool:
    present = [cell for cell in column if cell is not None]
    return bool(present) and all(not isinstance(c, str) or _LEADING_NUMBER.fullmatch(c) is not None for c in present)
