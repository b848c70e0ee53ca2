"""`ohmward assess`: the limits of the methods, on simulated runs with known truth."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.cli.outcome import Outcome, progress
from ohmward.cli.wording import paragraphs, table
from ohmward.fleet.run import SUMMARY
from ohmward.report import Page
from ohmward.report.page import HeatCell
from ohmward_lab.assess import LARGEST_RMSE
from ohmward_lab.assess.recommendation import COVERS
from ohmward_lab.assess.study import STUDIES, Study, assess


def run(args: argparse.Namespace) -> Outcome:
    """Run the study, or the rest of an interrupted one."""
    study = STUDIES[args.study]
    folder = Path(args.output or Path("ohmward-assess") / study.name)
    with progress() as report:
        found = assess(
            study,
            folder,
            args.runs,
            args.seed,
            args.only,
            args.processes or os.cpu_count() or 1,
            report and (lambda done, total: report(f"{done:,} of {total:,} cells", done / total)),
        )
    assessed = Assessed(study, args.runs, args.seed, folder, found, args.largest_error / 100.0)
    return Outcome(summary(assessed), describe(assessed), page=partial(make_page, assessed))


class Assessed(NamedTuple):
    """A finished study: its settings, its folder, the figures of each cell, the largest RMSE to recommend."""

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
    """Object printed by --json."""
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
        parts += [subject, table(header, [[cell or "-" for cell in row] for row in rows])]
    parts += [rule(assessed), table(*recommended(assessed)), "\n".join(worse(assessed))]
    return paragraphs(*parts, f"all figures: {assessed.folder / SUMMARY}")


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
    study, rows = assessed.study, []
    for row in study.recommended(assessed.found, assessed.largest_rmse):
        method, rmse = row.method, f"{hundredths(row.worst_rmse)} {UNITS[study.name]}"
        if method is None:
            helps = f"what helps: {' or '.join(row.helps)}" if row.helps else "no row of this table helps"
            method, rmse = f"none; {helps}", f"{rmse} ({row.closest})"
        covered = "no band" if math.isnan(row.least_covered) else f"{hundredths(row.least_covered, 0)} %"
        rows.append([row.subject, row.situation, row.processor, method, rmse, covered])
    return [study.subject, "situation", "processor", "method", "worst RMSE", "least covered"], rows


def worse(assessed: Assessed) -> list[str]:
    """Sentences on methods that are worse than the plain one, or worse when given the truth than without it."""
    lines = []
    for row in assessed.study.worse(assessed.found):
        few = " and ".join(filter(None, [", ".join(row.methods[:-1]), row.methods[-1]]))
        verb = "is" if row.every or len(row.methods) == 1 else "are"
        sizes = f"{_range(row.rmse)} {UNITS[assessed.study.name]} against {_range(row.than_rmse)}"
        methods = "every filter" if row.every else few
        lines.append(f"{row.subject}, {row.where}: {methods} {verb} worse than {row.than} ({sizes})")
    return lines


def _range(values: Sequence[float]) -> str:
    """Smallest and largest value, or one number where both print alike."""
    return " to ".join(dict.fromkeys(map(hundredths, (min(values), max(values)))))


class Heat(NamedTuple):
    """One figure of every method under every condition."""

    caption: str  #: in words, with its unit
    text: Callable[[Any], str]  #: text of a cell; empty where there is no such figure
    value: Callable[[Any], float]  #: value of a row; nan counts as the worst
    edges: tuple[float, ...]  #: values at which the shade becomes darker, lightest first

    def cell(self, row: Any) -> HeatCell | None:
        """Cell that is darker for each edge that the value reaches; None where there is no such figure."""
        text, value = self.text(row), self.value(row)
        level = len(self.edges) if math.isnan(value) else sum(value >= edge for edge in self.edges)
        return HeatCell(text, level) if text else None


def hundredths(value: float, digits: int = 1) -> str:
    """Text of a share in percentage points, or of a speed [m/s] in cm/s."""
    return f"{100.0 * value:.{digits}f}" if math.isfinite(value) else "nan"


_COVERED = Heat(
    "Samples with the truth in the 95 % band, %",
    lambda row: "" if math.isnan(row.covered) else hundredths(row.covered, 0),
    lambda row: 1.0 - row.covered,
    (0.05, 0.1, 0.2, 0.4),
)

#: Heat maps of each study; the first one, the RMSE, is also in the text output and decides the recommendation.
HEATS: Mapping[str, tuple[Heat, ...]] = {
    "battery": (
        Heat(
            "RMSE of the charge after the first hour, points of percent",
            lambda row: hundredths(row.rmse),
            lambda row: row.rmse,
            (0.01, 0.02, 0.04, 0.08),
        ),
        _COVERED,
        Heat(
            "Minutes until the error stays within 5 points, the median of the shifts",
            lambda row: "never" if math.isinf(row.found_min) else f"{row.found_min:.0f}",
            lambda row: row.found_min,
            (10.0, 60.0, 180.0, 480.0),
        ),
    ),
    "traction": (
        Heat(
            "RMSE of the speed, cm/s", lambda row: hundredths(row.rmse), lambda row: row.rmse, (0.01, 0.02, 0.05, 0.1)
        ),
        _COVERED._replace(caption="Samples with the truth in the 95 % band, %, the lesser of speed and slip"),
        Heat(
            "RMSE of the slip ratio, points of percent",
            lambda row: hundredths(row.slip_rmse),
            lambda row: row.slip_rmse,
            (0.02, 0.05, 0.1, 0.2),
        ),
        Heat(
            "Error of the distance, %", lambda row: hundredths(row.way), lambda row: row.way, (0.005, 0.01, 0.02, 0.05)
        ),
    ),
}

#: Unit of the RMSE: one hundredth of the unit of the figures.
UNITS: Mapping[str, str] = {"battery": "points", "traction": "cm/s"}


def grid(found: Sequence[Any], text: Callable[[Any], Any]) -> Iterator[list[Any]]:
    """Header, then a row for each condition with a cell for each method; an empty one where there are no figures."""
    methods = list(dict.fromkeys(row.method for row in found))
    by_place = {(row.condition, row.method): row for row in found}
    yield ["condition", *methods]
    for condition in dict.fromkeys(row.condition for row in found):
        here = [by_place.get((condition, method)) for method in methods]
        yield [condition, *(text(row) if row else "" for row in here)]


def make_page(assessed: Assessed) -> Page:
    """Recommendation, then the heat maps of each subject, and the cost."""
    study, found = assessed.study, assessed.found
    page = Page(f"Limits of the methods: {study.name}", f"{assessed.headline}, seed {assessed.seed}")
    page = page.heading("Recommendation")
    page = page.text(rule(assessed)).table(*recommended(assessed))
    for sentence in worse(assessed):
        page = page.text(sentence)
    for subject in dict.fromkeys(row.subject for row in found):
        page = page.heading(subject)
        here = [row for row in found if row.subject == subject]
        for heat in HEATS[study.name]:
            header, *rows = grid(here, heat.cell)
            page = page.table(header, [[cell or None for cell in row] for row in rows], heat.caption)
    return page.heading("Cost").table(["method", "in words", "operations", "ns a sample"], cost(assessed))


def cost(assessed: Assessed) -> list[list[str]]:
    """Most operations per step and shortest time per sample over all subjects, on this machine, runs side by side."""
    rows = []
    for method in assessed.study.methods:
        of = [row for row in assessed.found if row.method == method.name]
        if of:
            operations, ns = max(row.operations for row in of), min(row.ns for row in of)
            rows.append([method.name, method.title, f"{operations:,}", f"{ns:.0f}"])
    return rows
