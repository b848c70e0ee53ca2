"""Report of `ohmward reproduce`."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward.cli.report_parts import FOOTER
from ohmward.report import Page
from ohmward_lab.cli.reproduce.result import HEADER, cells, errata_rows
from ohmward_lab.reproduce.errata import ERRATA, check
from ohmward_lab.reproduce.publications import Publication, Reproduced, label

_COLUMNS = (
    "Printed is the publication's number; as printed its method with its equations as they are printed; corrected the "
    "same with the corrected equations; default the method that ohmward chooses. Batteries and robots are simulated, "
    "but for a log that you name."
)


def make_page(publication: Publication, results: Sequence[Reproduced]) -> Page:
    """Table and figures of each item, then the errata of the publication."""
    page = Page(f"{publication.title}, made again", f"{len(results)} tables and figures", FOOTER).text(_COLUMNS)
    for item, result in results:
        page = page.heading(f"{label(item)}: {item.title}")
        page = page.table(HEADER, [[None if c == "-" else c for c in cells(row)] for row in result.rows])
        for why in dict.fromkeys(row.why for row in result.rows if row.why):
            page = page.text(f"Why they differ: {why}.")
        for figure in result.figures:
            page = page.plot(figure)
    return with_errata(page, [e.text == publication.short for e in ERRATA])


def errata_page(found: Sequence[bool]) -> Page:
    """The errata of both publications."""
    page = Page("Errors in [T] and [P]", "each with a check that runs", FOOTER)
    return page.table(_HEADER, errata_rows(found))


_HEADER = ["Text", "Place", "In the text we worked from", "Must be", "Check"]


def with_errata(page: Page, chosen: Sequence[bool]) -> Page:
    """The page with the chosen errata, checked."""
    rows = errata_rows(check(ERRATA))
    return page.heading("Errors in the text").table(_HEADER, [r for r, c in zip(rows, chosen, strict=True) if c])
