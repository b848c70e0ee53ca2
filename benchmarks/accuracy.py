"""Accuracy: `make accuracy` writes benchmarks/accuracy.md, `python benchmarks/accuracy.py vrla robotino` parts of it.

The parts on measured data need what is not part of the repository: `../shared/data` or the folder named by
OHMWARD_DATA. A part without its data is skipped with a message. What was measured is kept in build/accuracy until the
part is measured again; the page is written where every part has its rows.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

import battery_accuracy as battery
from figure import HERE, Figure, table

Part = Callable[[], Iterator]
PAGE, KEPT = HERE / "accuracy.md", HERE.parent / "build" / "accuracy"
TRACTION = (
    "traction_mujoco",
    "observer_coverage",
    "observer_faults",
    "observer_noise",
    "odometry",
    "real_car",
    "real_warthog",
    "real_warthog_pose",
    "real_husky",
    "real_sand",
    "robotino",
    "slip_control",
    "range_accuracy",
)
INTRODUCTION = """\
# Accuracy

Written by `make accuracy`. The measured data are described and credited in [the documentation](../docs/data.md).

## State of charge
"""
TRACTION_INTRODUCTION = """\
## Speed, slip and range

Plants are MuJoCo's and our own; data sets are named by their folder. One set of numbers for all of them, nothing is
tuned per file or floor.
"""


def main() -> int:
    parts = chosen(sys.argv[1:])
    if isinstance(parts, str):
        print(parts, file=sys.stderr)
        return 2
    found = [row for name, part in parts.items() for row in measured(name, part)]
    absent = [name for name in all_parts() if not kept(name).exists()]
    if absent:
        print(f"{PAGE.name} is unchanged: no rows yet of {', '.join(absent)}", file=sys.stderr)
    else:
        PAGE.write_text(page(row for name in all_parts() for row in pickle.loads(kept(name).read_bytes())), "utf-8")
    missed = [row for row in found if row.met is False]
    print(f"{len(found)} rows, {sum(row.met is True for row in found)} bars met, {len(missed)} missed")
    return 0


def all_parts() -> dict[str, Part]:
    """Every part by its name: those of the battery, then `rows` of the modules beside this one."""
    return {part.__name__: part for part in battery.SECTIONS} | {name: import_module(name).rows for name in TRACTION}


def chosen(names: Sequence[str]) -> dict[str, Part] | str:
    """The parts of these names, all without a name; or what is wrong with the names."""
    parts = all_parts()
    if unknown := [name for name in names if name not in parts]:
        return f"no part {', '.join(unknown)}; there are {', '.join(parts)}"
    return {name: parts[name] for name in names} if names else parts


def kept(name: str) -> Path:
    """The file with the rows of a part."""
    return KEPT / f"{name}.pickle"


def measured(name: str, part: Part) -> list[battery.Row | Figure]:
    """The rows of a part, shown as they come and kept; none where its data are absent."""
    rows = []
    try:
        for row in part():
            rows.append(row)
            print(line(row), flush=True)
    except FileNotFoundError as missing:
        print(f"{name}: {missing} is absent (set OHMWARD_DATA to the folder of the data)", file=sys.stderr)
        return []
    KEPT.mkdir(parents=True, exist_ok=True)
    kept(name).write_bytes(pickle.dumps(rows))
    return rows


def line(row: battery.Row | Figure) -> str:
    """A row for the terminal."""
    if isinstance(row, battery.Row):
        return battery.line(row)
    data, method, quantity, value, bar, met = row.cells
    return f"{data:55s} {method:40s} {quantity}: {value} {bar} {met}"


def page(rows: Iterable[battery.Row | Figure]) -> str:
    """The page: a table for each half."""
    found = list(rows)
    of_battery = [row for row in found if isinstance(row, battery.Row)]
    figures = [row for row in found if isinstance(row, Figure)]
    first = [INTRODUCTION, battery.INTRODUCTION, *battery.table(of_battery)]
    header = ("data", "method", "quantity", "value", "to reach", "")
    return "\n".join([*first, "", TRACTION_INTRODUCTION, *table(header, [f.cells for f in figures]), ""])


if __name__ == "__main__":
    sys.exit(main())
