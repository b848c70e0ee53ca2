"""`ohmward reproduce`: tables and figures of [T] and [P] reproduced, printed numbers beside those found here."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ohmward.battery.file import load_battery
from ohmward.battery.log_check import check_log, with_contradictions
from ohmward.cli.battery_inputs import read_battery_log, read_options
from ohmward.cli.outcome import Outcome, progress
from ohmward.cli.wording import bullets, paragraphs, table
from ohmward.errors import InputError
from ohmward.logs.log import ReadOptions
from ohmward.report import Page
from ohmward_lab.reproduce.errata import ERRATA, check
from ohmward_lab.reproduce.measured import measured_item, nmc_item
from ohmward_lab.reproduce.publications import PUBLICATIONS, Publication, label, select
from ohmward_lab.reproduce.row import Item, Result, ResultRow


def run(args: argparse.Namespace) -> Outcome:
    """Compute the items of a publication, or check the errata."""
    if args.subject == "errata":
        if args.only:
            raise InputError("--only selects a table or figure; the errata are checked together")
        return _errata()
    publication = with_nmc_cell(PUBLICATIONS[args.subject], args.data)
    if args.log is not None:
        publication = with_measured(publication, args.log, read_options(args), args.battery, args.initial_soc)
    with progress() as report:
        items, results = select(publication, args.only or ()), []
        for done, item in enumerate(items):
            if report:
                report(item.title, done / len(items))
            results.append((item, item.make()))
    figures = {
        "command": "reproduce",
        "publication": publication.title,
        # one row for each number, with its item
        "rows": [{"item": label(item), **row._asdict()} for item, result in results for row in result.rows],
    }
    return Outcome(figures, describe(publication, results), page=partial(make_page, publication, results))


def with_nmc_cell(publication: Publication, data: str | None) -> Publication:
    """The publication; for the thesis also the measured NMC cell where its records are available.

    data: folder given by `--data`; by default the one in OHMWARD_DATA, which need not hold the records.

    Raises:
        InputError: `--data` without the records, or for another subject than the thesis.
    """
    if data and publication.short != "[T]":
        raise InputError("--data adds a cell to the thesis; write `ohmward reproduce thesis --data ...`")
    folder = data or os.environ.get("OHMWARD_DATA")
    if not folder or publication.short != "[T]":
        return publication
    try:
        return publication._replace(items=(*publication.items, nmc_item(Path(folder).expanduser())))
    except FileNotFoundError as missing:
        if not data:
            return publication
        raise InputError(
            f"--data must name the folder that holds tue_cells (docs/data.md); {missing} is absent"
        ) from None


def with_measured(
    publication: Publication, log: str, reading: ReadOptions, battery: str | None, start_soc: float | None
) -> Publication:
    """The thesis with the log given by `--log` as an additional item; battery: path of its file.

    Raises:
        InputError: a log without battery or start, or for another subject than the thesis.
    """
    if publication.short != "[T]":
        raise InputError("--log runs the filters of the thesis; write `ohmward reproduce thesis --log ...`")
    if battery is None or start_soc is None:
        raise InputError(
            "--log needs --battery FILE.toml and --initial-soc S: both are taken as given, as in the thesis"
        )
    known = load_battery(battery)
    checked = with_contradictions(check_log(read_battery_log(log, reading, ()), known), known)
    return publication._replace(items=(*publication.items, measured_item(checked, known, start_soc)))


HEADER = ["quantity", "unit", "printed", "as printed", "corrected", "default"]
_ERRATA = ["Text", "Place", "In the text we worked from", "Must be", "Check"]


def describe(publication: Publication, results: Sequence[tuple[Item, Result]]) -> str:
    """Text for people: a table for each item, and why its numbers differ."""
    parts = [publication.title]
    for item, result in results:
        parts.append(f"{label(item)}: {item.title}")
        parts.append(table(HEADER, [cells(row) for row in result.rows]))
        if reasons := [row.why for row in result.rows if row.why]:
            parts.append(bullets("Why they differ", list(dict.fromkeys(reasons))))
    return paragraphs(*parts)


def cells(row: ResultRow) -> list[str]:
    """Cells of the row as text; a dash where there is no number, "nan" where a method ended in nan."""
    numbers = (row.printed, row.as_printed, row.corrected, row.default)
    return [row.quantity, row.unit, *("-" if n is None else f"{n:.3g}" for n in numbers)]


def errata_rows(found: Sequence[bool]) -> list[list[str]]:
    """Rows of the table of errata."""
    return [
        [e.text, e.place, e.printed, e.correct, "holds" if ok else "fails"] for e, ok in zip(ERRATA, found, strict=True)
    ]


_COLUMNS = (
    "Printed is the publication's number; as printed its method with its equations as they are printed; corrected the "
    "same with the corrected equations; default the method that ohmward chooses. Batteries and robots are simulated, "
    "but for a log that you name."
)


def make_page(publication: Publication, results: Sequence[tuple[Item, Result]]) -> Page:
    """Table and figures of each item, then the errata of the publication."""
    page = Page(f"{publication.title}, made again", f"{len(results)} tables and figures").text(_COLUMNS)
    for item, result in results:
        page = page.heading(f"{label(item)}: {item.title}")
        page = page.table(HEADER, [[None if c == "-" else c for c in cells(row)] for row in result.rows])
        for why in dict.fromkeys(row.why for row in result.rows if row.why):
            page = page.text(f"Why they differ: {why}.")
        for figure in result.figures:
            page = page.plot(figure)
    rows = [row for row in errata_rows(check(ERRATA)) if row[0] == publication.short]
    return page.heading("Errors in the text").table(_ERRATA, rows)


def _errata() -> Outcome:
    found = check(ERRATA)
    entries = [e._asdict() | {"holds": ok} for e, ok in zip(ERRATA, found, strict=True)]
    figures = [{name: value for name, value in entry.items() if name != "check"} for entry in entries]
    rows = errata_rows(found)
    lines = [f"{text} {place}: {printed} -> {correct} (the check {ok})" for text, place, printed, correct, ok in rows]
    title = f"{len(ERRATA)} errors in the texts we worked from, {sum(found)} of their checks pass; printed -> must be"
    page = Page("Errors in [T] and [P]", "each with a check that runs").table(_ERRATA, rows)
    text = bullets(title, lines)
    return Outcome({"command": "reproduce", "errata": figures}, text, page=lambda: page, status=0 if all(found) else 1)
