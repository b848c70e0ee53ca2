"""Building blocks of a page as HTML text; every text is escaped."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Final, Literal, NamedTuple, get_args

from ohmward.checks import require_one_of
from ohmward.errors import InputError
from ohmward.report.axis import WallClock
from ohmward.report.figure import Figure
from ohmward.report.payload import stack

Level = Literal["info", "warning", "error"]


class HeatCell(NamedTuple):
    """A cell of a heat map: its text, and how dark it is, 0 to 4."""

    text: str
    level: int


Cell = str | int | float | HeatCell | None

_LEADING_NUMBER: Final = re.compile(r"([+\-−]?\d[\d.,]*(?:e[+-]?\d+)?\s?%?)(.*)", re.DOTALL)


def heading(text: str, anchor: str) -> str:
    """A section title that links can point to."""
    return f'<h2 id="{escape(anchor)}">{escape(text)}</h2>'


def subheading(text: str) -> str:
    """A title within a section."""
    return f"<h3>{escape(text)}</h3>"


def paragraphs(text: str) -> str:
    """Paragraphs, split at blank lines."""
    return "".join(f"<p>{escape(part.strip())}</p>" for part in re.split(r"\n\s*\n", text) if part.strip())


def callout(level: Level, text: str) -> str:
    """A note that stands out; its level is written, not only coloured."""
    require_one_of("level", level, get_args(Level))
    return f'<div class="callout {level}" role="note"><b>{level.capitalize()}</b><div>{paragraphs(text)}</div></div>'


def numbers(values: Mapping[str, str]) -> str:
    """A row of key figures: label and value with unit, the leading number large."""
    cards = (f"<div><dt>{escape(label)}</dt><dd>{_value(value)}</dd></div>" for label, value in values.items())
    return f'<dl class="numbers">{"".join(cards)}</dl>'


def table(header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = "") -> str:
    """A table; columns of numbers are aligned right, None is shown as a dash.

    Raises: InputError for a row that is not as long as the header.
    """
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
    return f"<td{column_class}>{escape(_text(cell))}</td>"


def plot(figures: Sequence[Figure], clock: WallClock | None = None) -> str:
    """Figures above each other on one x axis; `assets/plots.js` draws them from the embedded data."""
    captions = "".join(f"<figure><figcaption>{escape(f.title)}</figcaption></figure>" for f in figures)
    data = embed(stack(figures, clock))
    return f'<div class="stack">{captions}<script type="application/json">{data}</script></div>'


def folded(blocks: Iterable[str]) -> Iterator[str]:
    """The blocks, each heading with those below it as a section that can be folded away."""
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


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    return f"{cell:.5g}" if isinstance(cell, float) else str(cell)


def _all_numbers(column: Sequence[Cell]) -> bool:
    present = [cell for cell in column if cell is not None]
    return bool(present) and all(not isinstance(c, str) or _LEADING_NUMBER.fullmatch(c) is not None for c in present)
