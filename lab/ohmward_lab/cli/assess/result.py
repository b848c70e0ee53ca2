"""Tables of `ohmward assess`, for programs and for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.cli import wording
from ohmward.fleet.run import SUMMARY
from ohmward_lab.assess.recommendation import COVERS, LARGEST_RMSE, Recommendation, Worse
from ohmward_lab.assess.study import Study
from ohmward_lab.cli.assess.heat import HEATS, UNITS, grid, hundredths


class Assessed(NamedTuple):
    """A study that was run: its settings, its folder, the figures of each cell, the largest RMSE to recommend."""

    study: Study
    runs: int
    seed: int
    folder: Path
    found: Sequence[Any]
    largest_rmse: float = LARGEST_RMSE

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
        "rule": rule(assessed),
        "recommended": [row._asdict() for row in assessed.study.recommended(assessed.found, assessed.largest_rmse)],
        "worse": worse(assessed),
    }


def describe(assessed: Assessed) -> str:
    """Text for people: RMSE of each method under each condition, then the recommendation."""
    study, found = assessed.study, assessed.found
    rmse, *_ = HEATS[study.name]
    parts = [f"{assessed.headline}; {rmse.caption}"]
    for subject in dict.fromkeys(row.subject for row in found):
        header, *rows = grid([row for row in found if row.subject == subject], rmse.text)
        parts += [subject, wording.table(header, [[cell or "-" for cell in row] for row in rows])]
    parts += [rule(assessed), wording.table(*recommended(assessed)), "\n".join(worse(assessed))]
    return wording.paragraphs(*parts, f"all figures: {assessed.folder / SUMMARY}")


def rule(assessed: Assessed) -> str:
    """The rule of the recommendation."""
    study = assessed.study
    bar = f"{100.0 * assessed.largest_rmse:g} {UNITS[study.name]}"
    plain = "none where there is no such method"
    among = f"whose band covers {COVERS:.0%} there and whose RMSE is {bar} at most"
    if study.plain:
        among += f", and no larger than that of {study.plain} alone"
        plain = f"else {study.plain} alone, without a band, up to {bar}; else none"
    return (
        "Recommended, of the methods whose step the processor holds: the smallest RMSE in the worst condition of the "
        f"situation, among those {among}; {plain}. Beside none stand what helps, by the other rows, and the smallest "
        "RMSE of all"
    )


def recommended(assessed: Assessed) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the recommendation."""
    study = assessed.study
    header = [study.subject, "situation", "processor", "method", "worst RMSE", "least covered"]
    rows = study.recommended(assessed.found, assessed.largest_rmse)
    return header, [_cells(row, UNITS[study.name]) for row in rows]


def worse(assessed: Assessed) -> list[str]:
    """Sentences on the methods that are worse than the plain one, or worse with the truth than without."""
    return [_sentence(row, UNITS[assessed.study.name]) for row in assessed.study.worse(assessed.found)]


def _cells(row: Recommendation, unit: str) -> list[str]:
    rmse = f"{hundredths(row.worst_rmse)} {unit}"
    covered = "no band" if math.isnan(row.least_covered) else f"{hundredths(row.least_covered, 0)} %"
    if row.method is None:
        helps = f"what helps: {' or '.join(row.helps)}" if row.helps else "no row of this table helps"
        return [row.subject, row.situation, row.processor, f"none; {helps}", f"{rmse} ({row.closest})", covered]
    return [row.subject, row.situation, row.processor, row.method, rmse, covered]


def _sentence(row: Worse, unit: str) -> str:
    methods = (
        "every filter" if row.every else " and ".join(filter(None, [", ".join(row.methods[:-1]), row.methods[-1]]))
    )
    verb = "is" if row.every or len(row.methods) == 1 else "are"
    sizes = f"{_range(row.rmse)} {unit} against {_range(row.than_rmse)}"
    return f"{row.subject}, {row.where}: {methods} {verb} worse than {row.than} ({sizes})"


def _range(values: Sequence[float]) -> str:
    """Smallest and largest, or the one there is."""
    return " to ".join(dict.fromkeys(map(hundredths, (min(values), max(values)))))
