"""Docstrings as they are written here: plain text with `code`, indented formulas and lines that stay lines.

They are read in an editor far more often than in a browser, so they carry no markup; this turns them into the
reStructuredText that autodoc wants. Sections such as `Args:` are left to napoleon.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby

from sphinx.application import Sphinx

SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:", "Yields:", "Example:", "Examples:")


def setup(app: Sphinx) -> dict[str, bool]:
    """Run before napoleon, which listens to the same event at the default priority of 500."""
    app.connect("autodoc-process-docstring", process, priority=400)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}


def process(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Rewrite the lines in place, as the event asks for."""
    lines[:] = [line for paragraph in _paragraphs(lines) for line in (*_as_markup(paragraph), "")]


def skip(app: Sphinx, what: str, name: str, value: object, skipped: bool, options: object) -> bool | None:
    """Leave out fields of NamedTuples: their class describes them."""
    return True if type(value).__name__ == "_tuplegetter" else None


def _paragraphs(lines: list[str]) -> Iterator[list[str]]:
    for blank, paragraph in groupby(lines, key=lambda line: not line.strip()):
        if not blank:
            yield list(paragraph)


def _as_markup(paragraph: list[str]) -> list[str]:
    """A section for napoleon, a formula or program as it stands, otherwise lines of text."""
    if paragraph[0].strip() in SECTIONS:
        return [_escaped(line) for line in paragraph]
    if paragraph[0].startswith((" ", ">>>")) or paragraph[0].endswith(("(", "[", "{")):
        return ["::", "", *(f"    {line}" for line in paragraph)]
    if any(re.match(r"[\w, ]+: ", line) for line in paragraph):
        return [f"| {_escaped(line)}" if not line.startswith(" ") else f"  {_escaped(line)}" for line in paragraph]
    return [_escaped(line) for line in paragraph]


def _escaped(line: str) -> str:
    """The line with `code` as literals and every other character standing for itself."""
    parts = re.split(r"`([^`]*)`", line)
    return "".join(f"``{p}``" if k % 2 and p else re.sub(r"([\\*|_])", r"\\\1", p) for k, p in enumerate(parts))
