"""Files that learn from use: `make learning` writes benchmarks/learning.md, `learning.py week nmc` a part of it.

Words choose the parts whose names contain all of them. Measured batteries need what is not part of the repository,
`../shared/data` or the folder named by OHMWARD_DATA; without it they are skipped with a message. The first run
simulates the cells, for an hour or two; later ones take them from build/lives.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from figure import HERE, Figure, verdict
from figure import table as markdown_table
from learning_parts import Part, parts

PAGE = HERE / "learning.md"
INTRODUCTION = """\
# Files that learn from use

Written by `make learning`. Nobody tested these batteries: each file begins as `ohmward generic` makes it, from the
chemistry and the label, and learns from logs, one after the other, with the defaults. Records that teach never judge.
*label*: the file before, a fresh filter; *label, filter runs on*: the same without `learn`, its filter running through
all days; *full test*: the file that `identify` makes of pulses and a low-rate test of the new cell. RMSE in points of
percent, after the first hour where the start is unknown; covered: share of the samples after the first half hour whose
truth lies in the 95 % band; interval: mean score of that band (its width, and 40 times the distance of each truth
beyond it). A record counts as one. Errors in sigmas are to be within the 95 % band.
"""
SECTIONS = {
    "week": """## Five everyday days

A simulated robot drives through eight hours and more of each day, with two charges in between and a full one at night,
at 18 to 24 degC; two later days, at 20 and 12 degC, judge. RMSE is to be within 1.5 times that of the full test. Then
the same from labels that say a tenth less and a tenth more.
""",
    "aged": """## An aged cell

Five cycles of a cell that has 80 % of its capacity and about 1.5 times its resistance, with the file of the new cell
from pulses at 25 degC; a sixth judges.
""",
    "same": """## The same file

From the label through three days: in another order, with one of them twice, with one cut in two. Differences in sigmas
of the file.
""",
    "tue": """## Cells of TU Eindhoven

From the label, without the open-circuit voltage that comes with the data; other records of the cell judge.
""",
    "other": """## Other cells at other temperatures

From the label through drives or pulses at one temperature; recordings at the others judge.
""",
    "bboxx": """## A solar battery

Telemetry at one sample a minute, lead-acid; the sensor has an offset.
""",
    "pack": """## Four unequal cells

One of four cells in series has 85 % of the capacity, 1.5 times the resistance, and begins 5 points lower; the voltages
of the cells are in the log. The file is that of the new cell, from pulses or from the label.
""",
    "nasa": """## Capacity over a life

Charges and the first half of each discharge teach; the truth is the charge of the whole discharge. Second halves are
never shown. The capacity is that of a [discharge](../docs/health.md), from full to where those before it have ended: at
4 A the resistance of these cells ends them while 5 to 20 % of the charge are left.
""",
    "i3": """## A car in summer and winter

Eight trips teach; others are estimated from an unknown start, judged by the charge that the car shows, after five
minutes.
""",
}


def main() -> int:
    chosen = arguments(sys.argv[1:])
    wanted = [part for part in parts() if all(word.lower() in part.name.lower() for word in chosen.words)]
    if not wanted:
        names = "; ".join(part.name for part in parts())
        print(f"no part has {' and '.join(chosen.words)} in its name; there are: {names}", file=sys.stderr)
        return 2
    with ProcessPoolExecutor(chosen.jobs) as pool:
        names = [part.name for part in wanted]
        found = dict(zip(names, pool.map(partial(figures_of, began=time.monotonic()), names), strict=True))
    if chosen.json:
        print(json.dumps([figure._asdict() for figures in found.values() for figure in figures or ()]))
    skipped = [name for name, figures in found.items() if figures is None]
    if not chosen.words and not skipped:
        PAGE.write_text(page(wanted, found), encoding="utf-8")
    elif skipped:
        print(f"skipped {', '.join(skipped)}: {PAGE.name} is unchanged", file=sys.stderr)
    return 0


def arguments(given: Sequence[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description="Files that learn from use.")
    parser.add_argument(
        "words", nargs="*", metavar="WORD", help="every part whose name has all these words; all by default"
    )
    parser.add_argument("--jobs", type=int, default=2, help="parts at a time, each in a process; default %(default)s")
    parser.add_argument("--json", action="store_true", help="every figure as JSON on standard output")
    return parser.parse_args(given)


def figures_of(name: str, began: float) -> list[Figure] | None:
    """The figures of a part, reported when they are there; None where its data are absent."""
    (part,) = (part for part in parts() if part.name == name)
    try:
        figures = [*(part.base() if part.base else ()), *part.learn()]
    except FileNotFoundError as missing:
        print(f"{name}: {missing} is absent (set OHMWARD_DATA to the folder of the data)", file=sys.stderr)
        return None
    missed = sum(figure.met is False for figure in figures)
    judged = sum(figure.met is not None for figure in figures)
    print(
        f"{time.monotonic() - began:5.0f} s {name}: {judged - missed} of {judged} bars met", file=sys.stderr, flush=True
    )
    return figures


def page(wanted: Sequence[Part], found: dict[str, list[Figure] | None]) -> str:
    """The page: how many bars are met, then the sections."""
    lines = [INTRODUCTION, *summary(wanted, found), ""]
    for section, introduction in SECTIONS.items():
        lines.append(introduction)
        for part in wanted:
            if part.section == section:
                lines += [*table(found[part.name] or [], part.kept_out), ""]
    return "\n".join(lines)


def summary(wanted: Sequence[Part], found: dict[str, list[Figure] | None]) -> list[str]:
    """Bars met by section."""
    rows = []
    for section, introduction in SECTIONS.items():
        figures = [figure for part in wanted if part.section == section for figure in found[part.name] or ()]
        judged = [figure.met for figure in figures if figure.met is not None]
        title = introduction.splitlines()[0].removeprefix("## ")
        rows.append((title, f"{sum(judged)} of {len(judged)}"))
    return markdown_table(("section", "bars met"), rows)


def table(figures: Sequence[Figure], kept_out: bool) -> list[str]:
    """Figures of a part in Markdown: one row for each quantity, a column for each file."""
    methods = list(dict.fromkeys(figure.method for figure in figures))
    lines = []
    for data in dict.fromkeys(figure.data for figure in figures):
        of_data = [figure for figure in figures if figure.data == data]
        note = ", kept out of every choice of settings" if kept_out else ""
        rows = []
        for quantity in dict.fromkeys(figure.quantity for figure in of_data):
            values = {figure.method: figure for figure in of_data if figure.quantity == quantity}
            cells = [values[method].value if method in values else "" for method in methods]
            bars = [figure for figure in values.values() if figure.met is not None]
            bar, met = (bars[0].bar, bars[0].met) if bars else ("", None)
            rows.append((quantity, *cells, bar, verdict(met)))
        lines += ["", f"**{data}**{note}", "", *markdown_table(("", *methods, "to reach", ""), rows)]
    return lines


if __name__ == "__main__":
    sys.exit(main())
