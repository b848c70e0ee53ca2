"""Limits of the methods: `python benchmarks/assess.py` writes limits.md by `ohmward assess`, in five minutes.

An interrupted run goes on: what is done is kept in ../build/assess.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ohmward.assess.cell import CellFigures
from ohmward.assess.methods import METHODS
from ohmward.assess.recommendation import recommend
from ohmward.assess.study import assess
from ohmward.cli.assess.result import (
    RECOMMENDED,
    RULE,
    covered_percent,
    found_minutes,
    grid,
    recommended_cells,
    rmse_points,
)

HERE = Path(__file__).resolve().parent
PAGE, DONE = HERE / "limits.md", HERE.parent / "build" / "assess"
RUNS, SEED = 12, 1


def rows(header: Sequence[str], cells: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table in Markdown."""
    yield f"| {' | '.join(header)} |\n|{'---|' * len(header)}\n"
    yield from (f"| {' | '.join(row)} |\n" for row in cells)
    yield "\n"


def heat(found: Sequence[CellFigures], text: Callable[[CellFigures], str], caption: str) -> Iterator[str]:
    """One figure of every method under every condition."""
    header, *cells = grid(found, text)
    yield f"{caption}\n\n"
    yield from rows(header, cells)


def page(found: Sequence[CellFigures], time_of_all: str) -> Iterator[str]:
    """The recommendation, then the figures of each chemistry, then the cost."""
    yield f"{len(found) * RUNS:,} shifts, {time_of_all}.\n\n## Recommendation\n\n{RULE}.\n\n"
    yield from rows(RECOMMENDED, [recommended_cells(row) for row in recommend(found)])
    for chemistry in dict.fromkeys(row.chemistry for row in found):
        here = [row for row in found if row.chemistry == chemistry]
        yield f"## {chemistry}\n\n"
        yield from heat(here, rmse_points, "RMSE after the first hour, points of percent:")
        yield from heat(here, covered_percent, "Samples with the truth in the 95 % band, %:")
        yield from heat(here, found_minutes, "Minutes until the error stays within 5 points, median of the shifts:")
    yield "## Cost\n\nOperations of a step, the largest of the chemistries.\n\n"
    operations = {m.name: max((f.operations for f in found if f.method == m.name), default=0) for m in METHODS}
    yield from rows(["method", "", "operations"], [[m.name, m.title, f"{operations[m.name]:,}"] for m in METHODS])


def main() -> None:
    """Run the study and write the page."""
    began, processes = time.monotonic(), os.cpu_count() or 1
    found = assess(DONE, RUNS, SEED, (), processes, lambda done, total: print(done, "of", total, file=sys.stderr))
    minutes = (time.monotonic() - began) / 60.0
    PAGE.write_text("".join(page(found, f"{minutes:.1f} minutes in {processes} processes")), encoding="utf-8")


if __name__ == "__main__":
    main()
