"""Lives beyond the test bench: `make lives` writes benchmarks/lives.md, `python benchmarks/lives.py lfp` runs a part.

Parts are chemistries, simulated here, and "measured": `measured_lives.py`. The measured part needs what is not part of
the repository, `../shared/data` or the folder named by OHMWARD_DATA; without it, the part is skipped with a message.
The first run simulates the cells, for half an hour; later ones take them from build/lives.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import lives_cases
import lives_peers
from figure import HERE, Figure, verdict
from figure import table as markdown_table
from lives_cells import CELLS
from lives_health import health, health_table
from lives_peers import PeerRow
from lives_table import LifeRow, figures, line, missed_bars, missed_pooled_bars, pooled, table

PAGE = HERE / "lives.md"
MEASURED = "measured"
INTRODUCTION = """\
# Lives beyond the test bench

Written by `make lives`. A battery is tested once, in a warm room, and then lives: in the cold, with charges in between,
for years. Each row identifies a battery with the defaults from the tests in its first column, and estimates another
record. Simulated cells are those of [PyBaMM](https://www.pybamm.org), which no model of this package describes exactly:
with its single particle model and electrolyte (SPMe), the model of Doyle, Fuller and Newman (DFN), and its full model
of lead-acid. Nothing is tuned per cell or record. Tests and lives have dates: a new cell lives on the day after, one
that has aged to 90 or 80 % two or four years later.

A day has eight hours and more of drives with regeneration and idle draw, rests, and two charges in between, with the
temperature named and 3 K to either side. After a restart in mid-drive the estimator has seen no current before, as in
the field's blind benchmark, whose offsets of 0.1 and 0.3 A on 4.6 Ah are 2.2 and 6.5 % of C. RMSE in points of percent;
where the start was wrong or unknown, from the first hour on. From the first half hour on: *covered*, the share of
samples whose truth lies in the 95 % band (%); *interval*, the mean interval score of the band (points; its width, and
40 times the distance of each truth beyond it); the root mean square of *error / sigma*; the share of samples beyond 4
sigma (%). Other methods: RMSE (covered). Every row is to cover 90 %, to have fewer than 0.1 % beyond 4 sigma, and to be
no worse than the better of `textbook-ukf` and `rc` by more than 0.3 points.
"""
HEALTH_INTRODUCTION = """\
Five days at 25 degC, each charged fully, of a cell that has aged to 80 % of its capacity and about 1.5 times its
resistance, with the file of the new cell from pulses at 25 degC and the right start.
"""
PEERS_INTRODUCTION = """\
[PyBatterySE](https://github.com/muizabdul29/PyBatterySE) on the cells of its authors, with their models' structures and
the settings of their examples; both are identified from the records named and the open-circuit voltage that comes with
the data, and both are told the same start. Met where the default's RMSE is no larger and its band covers 90 %.
"""


def main() -> int:
    chosen = arguments(sys.argv[1:])
    parts = chosen.parts or all_parts()
    with ProcessPoolExecutor(chosen.jobs) as pool:
        found = dict(zip(parts, pool.map(partial(of_part, began=time.monotonic()), parts), strict=True))
    skipped = [part for part, rows in found.items() if rows is None]
    rows = [row for part in found.values() for row in part or ()]
    if chosen.json:
        print(json.dumps([as_dict(row) for row in rows]))
    if not chosen.parts and not skipped:
        PAGE.write_text(page(rows, health(), list(lives_peers.rows())), encoding="utf-8")
    elif skipped:
        print(f"skipped {', '.join(skipped)}: {PAGE.name} is unchanged", file=sys.stderr)
    print(*summary_table(rows), sep="\n", file=sys.stderr)
    return 0


def arguments(given: Sequence[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description="Estimators over lives beyond the test bench.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(all_parts())}; all by default")
    parser.add_argument("--jobs", type=int, default=2, help="parts at a time, each in a process; default %(default)s")
    parser.add_argument("--json", action="store_true", help="every row as JSON on standard output")
    chosen = parser.parse_args(given)
    if unknown := set(chosen.parts) - set(all_parts()):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(all_parts())}")
    return chosen


def all_parts() -> tuple[str, ...]:
    """Names of the parts: the chemistries of the simulated cells, and the measured data."""
    return (*dict.fromkeys(cell.chemistry for cell in CELLS), MEASURED)


def of_part(part: str, began: float) -> list[LifeRow] | None:
    """The rows of a part, reported as they come; None where its data are absent."""
    rows = []
    try:
        for row in part_rows(part):
            rows.append(row)
            print(f"{time.monotonic() - began:5.0f} s {line(row)}", file=sys.stderr, flush=True)
    except FileNotFoundError as missing:
        print(f"{part}: {missing} is absent (set OHMWARD_DATA to the folder of the data)", file=sys.stderr)
        return None
    return rows


def part_rows(part: str) -> Iterator[LifeRow]:
    """The rows of a part."""
    if part == MEASURED:
        import measured_lives

        yield from measured_lives.rows()
    for cell in CELLS:
        if cell.chemistry == part:
            yield from lives_cases.rows(cell)


def page(rows: Sequence[LifeRow], of_health: Sequence[Figure], beside: Sequence[PeerRow] = ()) -> str:
    """The page: the summary, then a table for each chemistry, simulated before measured."""
    lines = [INTRODUCTION, *summary_table(rows), ""]
    for chemistry in dict.fromkeys(row.chemistry for row in rows):
        of_chemistry = [row for row in rows if row.chemistry == chemistry]
        lines += [f"## {chemistry}", *table(of_chemistry), ""]
    lines += ["## State of health", "", HEALTH_INTRODUCTION, *health_table(of_health), ""]
    if beside:
        lines += ["## Beside PyBatterySE", "", PEERS_INTRODUCTION, *lives_peers.table(beside), ""]
    return "\n".join(lines)


def summary_table(rows: Sequence[LifeRow]) -> list[str]:
    """Each chemistry in one line: how many rows meet the bars, each and all, and the pooled band."""
    bars = ("RMSE", "covered", "plain filter", "4 sigma")
    head = ["", "rows", "all met", *(f"{bar} met" for bar in bars)]
    head += ["covered", "error / sigma", "> 4 sigma", "pooled bars"]
    lines = []
    for chemistry in dict.fromkeys(row.chemistry for row in rows):
        of_chemistry = [row for row in rows if row.chemistry == chemistry]
        missed = [missed_bars(row) for row in of_chemistry]
        counts = [sum(not any(words.startswith(bar) for words in row) for row in missed) for bar in bars]
        counts[0] -= sum(row.rmse_bar is None for row in of_chemistry)
        judged = sum(row.rmse_bar is not None for row in of_chemistry)
        if (found := pooled(of_chemistry)) is not None:
            _, covered, _, ratio, beyond = figures(found)
            pooled_missed = ", ".join(missed_pooled_bars(found))
            word = f"{verdict(False)}: {pooled_missed}" if pooled_missed else verdict(True)
            cells = [chemistry, len(of_chemistry), missed.count(()), f"{counts[0]} of {judged}", *counts[1:]]
            lines.append([*cells, covered, ratio, beyond, word])
    return markdown_table(head, lines)


def as_dict(row: LifeRow) -> dict:
    """A row as JSON has it."""
    scores = {
        name: {method: found and found._asdict() for method, found in getattr(row, name).items()}
        for name in ("bands", "errors")
    }
    return row._asdict() | scores | {"missed": missed_bars(row)}


if __name__ == "__main__":
    sys.exit(main())
