"""Tables of `ohmward assess`, for programs and for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.cli import wording
from ohmward.fleet.run import SUMMARY
from ohmward_lab.assess.recommendation import COVERS, Recommendation
from ohmward_lab.assess.study import Study
from ohmward_lab.cli.assess.heat import HEATS, UNITS, grid, hundredths

RULE = (
    "Recommended, of the methods whose step the processor holds: the smallest RMSE in the worst condition of the "
    f"situation, among those whose band covers {COVERS:.0%} there"
)


class Assessed(NamedTuple):
    """A study that was run: its settings, its folder, and the figures of each cell."""

    study: Study
    runs: int
    seed: int
    folder: Path
    found: Sequence[Any]

    @property
    def headline(self) -> str:
        """The number of runs, in words."""
        return f"{len(self.found) * self.runs:,} {self.study.run}"


def summary(assessed: Assessed) -> dict[str, Any]:
    """The object of --json."""
    return {
        "command": "assess",
        "study": assessed.study.name,
        "runs": assessed.runs,
        "seed": assessed.seed,
        "summary": str(assessed.folder / SUMMARY),
        "cells": [row._asdict() for row in assessed.found],
        "recommended": [row._asdict() for row in assessed.study.recommended(assessed.found)],
    }


def describe(assessed: Assessed) -> str:
    """Text for people: RMSE of each method under each condition, then the recommendation."""
    study, found = assessed.study, assessed.found
    rmse, *_ = HEATS[study.name]
    parts = [f"{assessed.headline}; {rmse.caption}"]
    for subject in dict.fromkeys(row.subject for row in found):
        header, *rows = grid([row for row in found if row.subject == subject], rmse.text)
        parts += [subject, wording.table(header, [[cell or "-" for cell in row] for row in rows])]
    parts += [RULE, wording.table(*recommended(study, found))]
    return wording.paragraphs(*parts, f"all figures: {assessed.folder / SUMMARY}")


def recommended(study: Study, found: Sequence[Any]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the recommendation."""
    header = [study.subject, "situation", "processor", "method", "worst RMSE", "least covered"]
    return header, [_cells(row, UNITS[study.name]) for row in study.recommended(found)]


def _cells(row: Recommendation, unit: str) -> list[str]:
    covered = f"{hundredths(row.least_covered, 0)} %"
    band = covered if row.trusted else f"{covered}: do not trust the band"
    if math.isnan(row.least_covered):
        band = "no band"
    return [row.subject, row.situation, row.processor, row.method, f"{hundredths(row.worst_rmse)} {unit}", band]
