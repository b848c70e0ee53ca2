"""Tables of [T] and [P] beside ours: `python benchmarks/publications.py` writes publications.md, in four minutes.

The numbers are those of `ohmward reproduce thesis` and `ohmward reproduce paper`; with the measured data also those of
`ohmward reproduce thesis --data`. The whole table of the observers of
[T] goes into dissertation.md, two of its drives into docs/pictures.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from figure import DATA, HERE, table
from ohmward_lab.cli.reproduce import HEADER, cells
from ohmward_lab.reproduce.measured import nmc_item
from ohmward_lab.reproduce.publications import PUBLICATIONS, Publication, label, select
from ohmward_lab.reproduce.thesis_observer import AUKF, AUKF_T, DRIVES, STARTS, UKF, drives_of, errors_of, pictures
from svg import to_svg

PAGE, OBSERVERS = HERE / "publications.md", HERE / "dissertation.md"
PICTURES = HERE.parent / "docs" / "pictures"
TABLE = """| drive | noise at first | filter | v [mm/s] | omega [rad/s] | slip [mm/s] | yaw rate [mrad/s] | NEES of v |
|---|---|---|---|---|---|---|---|
"""


def lines(publication: Publication) -> Iterator[str]:
    """A table for each item, and why its numbers differ."""
    yield f"### {publication.title}\n"
    for item in select(publication):
        print(f"{publication.short} {label(item)}: {item.title}", file=sys.stderr, flush=True)
        rows = item.make().rows
        yield f"\n**{label(item)}: {item.title}**\n\n"
        yield "\n".join([*table(HEADER, [[cell.replace("|", " ") for cell in cells(row)] for row in rows]), ""])
        reasons = list(dict.fromkeys(row.why for row in rows if row.why))
        if reasons:
            yield "\n" + "".join(f"- {reason}.\n" for reason in reasons)
    yield "\n"


def with_measured_cell() -> Iterator[Publication]:
    """The publications, [T] with the measured cell where its records are there."""
    for name, publication in PUBLICATIONS.items():
        if name == "thesis":
            try:
                publication = publication._replace(items=(*publication.items, nmc_item(DATA)))
            except FileNotFoundError as missing:
                print(f"{missing} is absent (set OHMWARD_DATA to the folder of the data)", file=sys.stderr)
        yield publication


def observers() -> Iterator[str]:
    """Every figure of every observer of [T]."""
    yield TABLE
    for name, drive in DRIVES.items():
        for wrong in STARTS:
            for kind in (UKF, AUKF, AUKF_T):
                values = " | ".join(f"{value:.2g}" for value in errors_of(name, wrong, kind))
                yield f"| {drive.title.lower()} | {wrong.name} | {kind.name} | {values} |\n"


def main() -> None:
    """Write the pages and the pictures."""
    for name, drive in DRIVES.items():
        svg = to_svg(*pictures(drive.title, drives_of(name)[0], STARTS[1]))
        (PICTURES / f"dissertation-{name}.svg").write_text(svg, encoding="utf-8")
    OBSERVERS.write_text("".join(observers()), encoding="utf-8")
    PAGE.write_text("".join(line for p in with_measured_cell() for line in lines(p)), encoding="utf-8")


if __name__ == "__main__":
    main()
