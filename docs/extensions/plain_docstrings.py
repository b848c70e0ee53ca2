"""Docstrings as they are written here: plain text with `code`, formulas, and lists of `name: what`.

They are read in an editor far more often than in a browser, so they carry no markup; this turns them into the
reStructuredText that autodoc wants. A record is shown with the meanings that stand behind its fields.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from itertools import groupby
from textwrap import dedent

from sphinx.application import Sphinx

from ohmward.embedded.comments import field_comments

SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:")
ITEM = re.compile(r"(\w+(?:, \w+)*): ")


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc."""
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}


def process(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Rewrite the lines in place, as the event asks for."""
    if isinstance(value, type) and (behind := _behind_fields(value)):
        lines += ["", "Attributes:", *(f"    {name}: {text}" for name, text in behind.items()), ""]
    lines[:] = [line for paragraph in _paragraphs(lines) for line in (*_as_markup(paragraph), "")]


def skip(app: Sphinx, what: str, name: str, value: object, skipped: bool, options: object) -> bool | None:
    """Leave out the fields of a record: their class describes them."""
    module, owner = app.env.temp_data.get("autodoc:module"), app.env.temp_data.get("autodoc:class")
    cls = getattr(sys.modules.get(module or ""), owner or "", None)
    return True if name in getattr(cls, "__annotations__", ()) else None


@cache
def _behind_fields(cls: type) -> dict[str, str]:
    """Meanings that stand behind fields, not in the docstring."""
    found = field_comments(cls) if cls.__module__.startswith("ohmward") and inspect.get_annotations(cls) else {}
    listed = cls.__doc__ or ""
    return {name: text for name, text in found.items() if not re.search(rf"\b{name}(?:, \w+)*: ", listed)}


def _paragraphs(lines: list[str]) -> Iterator[list[str]]:
    for blank, paragraph in groupby(lines, key=lambda line: not line.strip()):
        if not blank:
            yield list(paragraph)


def _as_markup(paragraph: list[str]) -> list[str]:
    head = paragraph[0].strip()
    if head in SECTIONS:
        return [f"**{head.removesuffix(':')}**", "", *_as_list(dedent("\n".join(paragraph[1:])).splitlines())]
    if _is_verbatim(paragraph):
        return ["::", "", *(f"    {line}" for line in paragraph)]
    if any(ITEM.match(line) for line in paragraph):
        return _as_list(paragraph)
    return [_escaped(line) for line in paragraph]


def _is_verbatim(paragraph: list[str]) -> bool:
    """A program, or formulas that stand below each other."""
    first = paragraph[0]
    aligned = any(re.search(r"\S {3,}\S", line) for line in paragraph) or all(" = " in line for line in paragraph)
    return first.startswith((" ", ">>>")) or first.endswith(("(", "[", "{")) or aligned


def _as_list(lines: list[str]) -> list[str]:
    """One entry for each `name: what`; other lines belong to the entry before them."""
    entries = []
    for k, line in enumerate(lines):
        item = ITEM.match(line)
        if item:
            entries.append(f"- ``{item[1]}``: {_escaped(line[item.end() :])}")
        else:
            entries.append(f"{'  ' if k else '- '}{_escaped(line.strip())}")
    return entries


def _escaped(line: str) -> str:
    """The line with `code` as literals and every other character standing for itself."""
    parts = re.split(r"`([^`]*)`", line)
    return "".join(f"``{p}``" if k % 2 and p else re.sub(r"([\\*|_])", r"\\\1", p) for k, p in enumerate(parts))
