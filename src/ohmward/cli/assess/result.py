"""Tables of `ohmward assess`, for programs and for people."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ohmward.assess.cell import CellFigures
from ohmward.assess.recommendation import COVERS, Recommendation, recommend
from ohmward.cli import wording
from ohmward.fleet.run import SUMMARY

RULE = (
    "Recommended, of the methods whose step the processor holds: the smallest RMSE in the worst condition of the "
    f"situation, among those whose band covers {COVERS:.0%} there"
)
RECOMMENDED = ["chemistry", "situation", "processor", "method", "worst RMSE", "least covered"]


def summary(args: argparse.Namespace, found: Sequence[CellFigures]) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "assess",
        "runs": args.runs,
        "seed": args.seed,
        "summary": str(Path(args.output) / SUMMARY),
        "cells": [row._asdict() for row in found],
        "recommended": [row._asdict() for row in recommend(found)],
    }


def describe(args: argparse.Namespace, found: Sequence[CellFigures]) -> str:
    """Text for people: RMSE of each method under each condition, then the recommendation."""
    parts = [f"{len(found) * args.runs:,} shifts of eight hours; RMSE of the charge in points after the first hour"]
    for chemistry in dict.fromkeys(row.chemistry for row in found):
        header, *rows = grid([row for row in found if row.chemistry == chemistry], rmse_points)
        parts += [chemistry, wording.table(header, [[cell or "-" for cell in row] for row in rows])]
    rows = [recommended_cells(row) for row in recommend(found)]
    parts += [RULE, wording.table(RECOMMENDED, rows)]
    return wording.paragraphs(*parts, f"all figures: {Path(args.output) / SUMMARY}")


def grid(found: Sequence[CellFigures], text: Callable[[CellFigures], str]) -> Iterator[list[str]]:
    """Header, then a row for each condition with a cell for each method; an empty one where there are no figures."""
    methods = list(dict.fromkeys(row.method for row in found))
    by_place = {(row.condition, row.method): row for row in found}
    yield ["condition", *methods]
    for condition in dict.fromkeys(row.condition for row in found):
        here = [by_place.get((condition, method)) for method in methods]
        yield [condition, *(text(row) if row else "" for row in here)]


def rmse_points(row: CellFigures) -> str:
    """RMSE in points of percent."""
    return points(row.rmse)


def points(share: float) -> str:
    """A share in points of percent."""
    return f"{100.0 * share:.1f}" if math.isfinite(share) else "nan"


def covered_percent(row: CellFigures) -> str:
    """Covered share of the samples."""
    return "" if math.isnan(row.covered) else f"{100.0 * row.covered:.0f}"


def found_minutes(row: CellFigures) -> str:
    """Minutes until a start is found."""
    return "never" if math.isinf(row.found_min) else f"{row.found_min:.0f}"


def recommended_cells(row: Recommendation) -> list[str]:
    """Cells of a row of the recommendation."""
    covered = f"{100.0 * row.least_covered:.0f} %"
    band = covered if row.trusted else f"{covered}: do not trust the band"
    return [row.chemistry, row.situation, row.processor, row.method, f"{points(row.worst_rmse)} points", band]
