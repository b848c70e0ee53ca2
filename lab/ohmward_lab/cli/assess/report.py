"""Report of `ohmward assess`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ohmward.cli.report_parts import FOOTER
from ohmward.report import Page
from ohmward.report.blocks import HeatCell
from ohmward_lab.cli.assess.heat import HEATS, Heat, grid
from ohmward_lab.cli.assess.result import Assessed, recommended, rule, worse


def make_page(assessed: Assessed) -> Page:
    """Recommendation, then the heat maps of each subject, and the cost."""
    study, found = assessed.study, assessed.found
    page = Page(f"Limits of the methods: {study.name}", f"{assessed.headline}, seed {assessed.seed}", FOOTER)
    page = page.heading("Recommendation")
    page = page.text(rule(assessed)).table(*recommended(assessed))
    for sentence in worse(assessed):
        page = page.text(sentence)
    for subject in dict.fromkeys(row.subject for row in found):
        page = page.heading(subject)
        for heat in HEATS[study.name]:
            page = _map(page, [row for row in found if row.subject == subject], heat)
    return page.heading("Cost").table(["method", "in words", "operations", "ns a sample"], cost(assessed))


def _map(page: Page, found: Sequence[Any], heat: Heat) -> Page:
    """A table whose cells are darker the worse they are."""
    by_place = {(row.condition, row.method): row for row in found}
    (_, *methods), *rows = grid(found, heat.text)
    shaded = []
    for condition, *cells in rows:
        here = [by_place.get((condition, method)) for method in methods]
        shaded.append([condition, *(_shade(cell, row, heat) for cell, row in zip(cells, here, strict=True))])
    return page.table(["condition", *methods], shaded, heat.caption)


def _shade(text: str, row: Any, heat: Heat) -> HeatCell | None:
    return HeatCell(text, heat.level(row)) if row and text else None


def cost(assessed: Assessed) -> list[list[str]]:
    """Operations of a step, the most of all subjects, and the time of a sample, many runs side by side, here."""
    rows = []
    for method in assessed.study.methods:
        of = [row for row in assessed.found if row.method == method.name]
        if of:
            operations, ns = max(row.operations for row in of), min(row.ns for row in of)
            rows.append([method.name, method.title, f"{operations:,}", f"{ns:.0f}"])
    return rows
