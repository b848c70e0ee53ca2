"""Tables and fields as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ohmward import __version__
from ohmward.cli.paragraphs import styled
from ohmward.report import Page

FOOTER = f"ohmward {__version__}"


def with_assumptions(page: Page, notes: Sequence[str]) -> Page:
    """The page with everything that was assumed: warnings stand out, the rest is a list."""
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
    rule = "  ".join("-" * width for width in widths)
    return "\n".join([styled(_line(header, widths)), rule, *(_line(row, widths) for row in rows)])


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    """The cells of a row, the first to the left, the others to the right."""
    first, *others = zip(cells, widths, strict=True)
    aligned = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return "  ".join(aligned).rstrip()


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
