"""Paragraphs and lists of a text for the terminal; imports little, since every command line loads it."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Literal, TextIO

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
