"""Limits of the methods: `python benchmarks/assess.py` writes limits.md and limits_traction.md by `ohmward assess`.

Ten minutes on two processors; an interrupted run goes on: what is done is kept in ../build/assess.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence

from figure import HERE, table
from ohmward_lab.assess.study import STUDIES, assess
from ohmward_lab.cli.assess import HEATS, Assessed, cost, grid, recommended, rule, worse

DONE = HERE.parent / "build" / "assess"
PAGES = {"battery": HERE / "limits.md", "traction": HERE / "limits_traction.md"}
RUNS, SEED = 12, 1


def rows(header: Sequence[str], cells: Iterable[Sequence[str]]) -> str:
    """A table in Markdown, and an empty line."""
    return "\n".join([*table(header, cells), "", ""])


def page(assessed: Assessed, time_of_all: str) -> Iterator[str]:
    """The recommendation, what does harm, then the figures of each subject, then the cost."""
    study, found = assessed.study, assessed.found
    yield f"{assessed.headline}, {time_of_all}.\n\n## Recommendation\n\n{rule(assessed)}.\n\n"
    yield rows(*recommended(assessed))
    if said := worse(assessed):
        yield "".join(f"- {sentence}\n" for sentence in said) + "\n"
    for subject in dict.fromkeys(row.subject for row in found):
        yield f"## {subject}\n\n"
        for heat in HEATS[study.name]:
            header, *cells = grid([row for row in found if row.subject == subject], heat.text)
            yield f"{heat.caption}:\n\n"
            yield rows(header, cells)
    yield f"## Cost\n\nOperations of a step, for the {study.subject} that takes most.\n\n"
    yield rows(["method", "", "operations"], [row[:3] for row in cost(assessed)])


def main() -> None:
    """Run the studies and write their pages."""
    processes = os.cpu_count() or 1
    for name, path in PAGES.items():
        began, folder = time.monotonic(), DONE / name
        found = assess(
            STUDIES[name],
            folder,
            RUNS,
            SEED,
            (),
            processes,
            lambda done, total: print(done, "of", total, file=sys.stderr),
        )
        assessed = Assessed(STUDIES[name], RUNS, SEED, folder, found)
        minutes = (time.monotonic() - began) / 60.0
        path.write_text("".join(page(assessed, f"{minutes:.1f} minutes in {processes} processes")), encoding="utf-8")


if __name__ == "__main__":
    main()
