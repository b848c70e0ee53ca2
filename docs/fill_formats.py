"""Fill the table of formats in `docs/logs.md` from those that the tests read: `python docs/fill_formats.py`."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from marked_block import replaced

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from logs.formats.population import FORMATS  # noqa: E402

PAGE = ROOT / "docs" / "logs.md"
#: Families that the page describes in a paragraph: their names are those of notations, not of programs.
NOTATIONS = ("text tables", "time")


def main() -> None:
    """Rewrite the blocks between the markers."""
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def filled(text: str) -> str:
    """The text of the page with the tables made anew."""
    return replaced(replaced(text, "formats", format_lines()), "flags", flag_lines())


def format_lines() -> Iterator[str]:
    """A line for each family of formats that are read at once."""
    yield from ("| | read at once |", "|---|---|")
    for family in dict.fromkeys(about.family for about in FORMATS if about.family not in NOTATIONS):
        names = [about.name for about in FORMATS if about.family == family and not about.flags]
        yield f"| {family} ({len(names)}) | {'; '.join(without_variants(names))} |"


def without_variants(names: list[str]) -> list[str]:
    """Names, those that differ behind the first comma only as one."""
    heads = Counter(name.partition(", ")[0] for name in names)
    return list(dict.fromkeys(head if heads[head := name.partition(", ")[0]] > 1 else name for name in names))


def flag_lines() -> Iterator[str]:
    """A line for each format that needs a word of its user."""
    yield from ("| format | the error asks for |", "|---|---|")
    yield from (f"| {about.name} | `{' '.join(about.flags)}` |" for about in FORMATS if about.flags)


if __name__ == "__main__":
    main()
