"""Paragraphs, lists, fields and tables as text for a terminal; imports little, since every command line loads it."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TextIO

if TYPE_CHECKING:
    from ohmward.report import Page

#: Assumptions that are printed: all of them, the warnings and the number of the others, or the warnings alone.
Detail = Literal["all", "usual", "answer"]

_WIDEST, _NARROWEST = 100, 40
#: Select Graphic Rendition of ECMA-48.
_STYLES = {"strong": "1", "warning": "1;33", "error": "1;31"}


def width() -> int:
    """Columns at which text is wrapped: those of the terminal, or of a wide one in a file."""
    columns = shutil.get_terminal_size((_WIDEST, 24)).columns if sys.stdout.isatty() else _WIDEST
    return min(max(columns, _NARROWEST), _WIDEST)


def styled(text: str, style: Literal["strong", "warning", "error"] = "strong", stream: TextIO | None = None) -> str:
    """The text with a terminal's emphasis; plain in a file or a pipe, or where NO_COLOR is set.

    stream: where it will be printed; None is standard output.
    """
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or not (stream or sys.stdout).isatty():
        return text
    return f"\x1b[{_STYLES[style]}m{text}\x1b[0m"


def bullets(title: str, lines: Sequence[str], style: Literal["strong", "warning"] = "strong") -> str:
    """A title and wrapped lines below it; empty without lines."""
    if not lines:
        return ""
    columns = width()
    wrapped = (textwrap.fill(line, columns, initial_indent="  - ", subsequent_indent="    ") for line in lines)
    return "\n".join([styled(textwrap.fill(f"{title}:", columns), style), *wrapped])


def paragraphs(*parts: str) -> str:
    """The parts that are not empty, with an empty line between them."""
    return "\n\n".join(part for part in parts if part)


def assumptions(notes: Sequence[str], detail: Detail) -> str:
    """What was assumed, as a list; warnings are never left out."""
    if detail == "all":
        return bullets("Assumed", [note.removeprefix("info: ") for note in notes])
    warnings = [note.removeprefix("warning: ") for note in notes if note.startswith("warning: ")]
    rest = len(notes) - len(warnings)
    more = f"Assumed {rest} thing{'s' if rest > 1 else ''} that the input contains or leaves open; -v lists them."
    return paragraphs(
        bullets("Warnings", warnings, "warning"), textwrap.fill(more, width()) if rest and detail == "usual" else ""
    )


def with_assumptions(page: Page, notes: Sequence[str]) -> Page:
    """The page with everything that was assumed: warnings stand out, the rest is a list."""
    if not notes:
        return page
    page = page.heading("What was assumed")
    for note in notes:
        if note.startswith("warning: "):
            page = page.callout("warning", note.removeprefix("warning: "))
    plain = [note.removeprefix("info: ") for note in notes if not note.startswith("warning: ")]
    return page.table(["Assumption"], [[note] for note in plain]) if plain else page


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}" + ("" if text.endswith((".", "?", "!")) else ".")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns aligned under their header, the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    rule = "  ".join("-" * width for width in widths).rstrip()
    return "\n".join([styled(_line(header, widths)), rule, *(_line(row, widths) for row in rows)])


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    """The cells of a row, the first to the left, the others to the right."""
    return "  ".join([cells[0].ljust(widths[0]), *map(str.rjust, cells[1:], widths[1:])]).rstrip()


def fields(values: Mapping[str, str]) -> str:
    """Names and values, one a line, indented and aligned."""
    width = max(map(len, values))
    return "\n".join(f"  {name.ljust(width)}  {value}" for name, value in values.items())


def known_rows(rows: Mapping[str, str]) -> dict[str, str]:
    """The rows that have a value; empty ones, and those whose first word is "-", are left out."""
    return {name: value for name, value in rows.items() if value and value.split()[0] != "-"}


def written_battery(figures: Mapping[str, Any]) -> str:
    """Names of the battery file that was written (`output`) and of the previous one (`backup`)."""
    return f"battery file: {figures['output']}" + (f"; before: {figures['backup']}" if figures["backup"] else "")
