"""Report of `ohmward assess`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

from ohmward.assess import recommendation
from ohmward.assess.cell import CellFigures
from ohmward.assess.methods import METHODS
from ohmward.assess.recommendation import recommend
from ohmward.cli.assess.result import (
    RECOMMENDED,
    covered_percent,
    found_minutes,
    grid,
    recommended_cells,
    rmse_points,
)
from ohmward.cli.report_parts import FOOTER
from ohmward.report import Page
from ohmward.report.blocks import HeatCell

#: RMSE [share], uncovered share and minutes at which the shade of a cell begins, from the lightest on.
_RMSE = (0.01, 0.02, 0.04, 0.08)
_UNCOVERED = (0.05, 0.1, 0.2, 0.4)
_MINUTES = (10.0, 60.0, 180.0, 480.0)


def make_page(args: argparse.Namespace, found: Sequence[CellFigures]) -> Page:
    """Recommendation, then three heat maps for each chemistry, and the cost."""
    runs = f"{len(found) * args.runs:,} simulated shifts of eight hours, seed {args.seed}"
    page = Page("Limits of the methods", runs, FOOTER).heading("Recommendation")
    page = page.text(" ".join((recommendation.__doc__ or "").split("\n\n")[1].split()))
    page = page.table(RECOMMENDED, [recommended_cells(row) for row in recommend(found)])
    for chemistry in dict.fromkeys(row.chemistry for row in found):
        here = [row for row in found if row.chemistry == chemistry]
        page = page.heading(chemistry)
        page = _heat(page, here, rmse_points, lambda row: _level(row.rmse, _RMSE), "RMSE after the first hour, points")
        page = _heat(
            page,
            here,
            covered_percent,
            lambda row: _level(1.0 - row.covered, _UNCOVERED),
            "Samples with the truth in the 95 % band, %",
        )
        page = _heat(
            page,
            here,
            found_minutes,
            lambda row: _level(row.found_min, _MINUTES),
            "Minutes until the error stays within 5 points, the median of the runs",
        )
    return _cost(page.heading("Cost"), found)


def _heat(
    page: Page,
    found: Sequence[CellFigures],
    text: Callable[[CellFigures], str],
    level: Callable[[CellFigures], int],
    caption: str,
) -> Page:
    """A table whose cells are darker the worse they are."""
    by_place = {(row.condition, row.method): row for row in found}
    (_, *methods), *rows = grid(found, text)
    shaded = []
    for condition, *cells in rows:
        here = [by_place.get((condition, method)) for method in methods]
        shaded.append([condition, *(_shade(cell, row, level) for cell, row in zip(cells, here, strict=True))])
    return page.table(["condition", *methods], shaded, caption)


def _shade(text: str, row: CellFigures | None, level: Callable[[CellFigures], int]) -> HeatCell | None:
    return HeatCell(text, level(row)) if row and text else None


def _level(value: float, edges: Sequence[float]) -> int:
    """Number of the edges that the value is at or beyond; that of the worst where it is no number."""
    return len(edges) if value != value else sum(value >= edge for edge in edges)


def _cost(page: Page, found: Sequence[CellFigures]) -> Page:
    """Operations of a step, and the time of a sample with many runs side by side on this machine."""
    rows = []
    for method in METHODS:
        of = [row for row in found if row.method == method.name]
        if of:
            rows.append([method.name, method.title, str(of[0].operations), f"{min(row.ns for row in of):.0f}"])
    return page.table(["method", "in words", "operations", "ns a sample"], rows)
