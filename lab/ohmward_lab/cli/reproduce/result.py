"""Tables of `ohmward reproduce`, for programs and for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ohmward.cli import wording
from ohmward_lab.reproduce.errata import ERRATA
from ohmward_lab.reproduce.publications import Publication, Reproduced, label
from ohmward_lab.reproduce.row import ResultRow

HEADER = ["quantity", "unit", "printed", "as printed", "corrected", "default"]


def summary(publication: Publication, results: Sequence[Reproduced]) -> dict[str, Any]:
    """The object of --json: one row for each number, with its item."""
    return {
        "command": "reproduce",
        "publication": publication.title,
        "rows": [{"item": label(r.item), **row._asdict()} for r in results for row in r.result.rows],
    }


def describe(publication: Publication, results: Sequence[Reproduced]) -> str:
    """Text for people: a table for each item, and why its numbers differ."""
    parts = [publication.title]
    for item, result in results:
        parts.append(f"{label(item)}: {item.title}")
        parts.append(wording.table(HEADER, [cells(row) for row in result.rows]))
        if reasons := [row.why for row in result.rows if row.why]:
            parts.append(wording.bullets("Why they differ", list(dict.fromkeys(reasons))))
    return wording.paragraphs(*parts)


def cells(row: ResultRow) -> list[str]:
    """The row as texts; a dash where there is no number, "nan" where a method ended in none."""
    numbers = (row.printed, row.as_printed, row.corrected, row.default)
    return [row.quantity, row.unit, *("-" if n is None else f"{n:.3g}" for n in numbers)]


def errata_summary(found: Sequence[bool]) -> dict[str, Any]:
    """The object of --json for the errata."""
    rows = [e._asdict() | {"holds": ok} for e, ok in zip(ERRATA, found, strict=True)]
    return {"command": "reproduce", "errata": [{k: v for k, v in row.items() if k != "check"} for row in rows]}


def describe_errata(found: Sequence[bool]) -> str:
    """Text for people: place, what is printed, what it must be, result of the check."""
    lines = [
        f"{text} {place}: {printed} -> {correct} (the check {check})"
        for text, place, printed, correct, check in errata_rows(found)
    ]
    title = f"{len(ERRATA)} errors in the texts we worked from, {sum(found)} of their checks pass"
    return wording.bullets(f"{title}; printed -> must be", lines)


def errata_rows(found: Sequence[bool]) -> list[list[str]]:
    """Rows of the table of errata."""
    return [
        [e.text, e.place, e.printed, e.correct, "holds" if ok else "fails"] for e, ok in zip(ERRATA, found, strict=True)
    ]
