"""Speed beside other packages: `make bench` writes benchmarks/speed.md.

    python benchmarks/speed.py                     everything, some minutes
    python benchmarks/speed.py --against COMMIT    and this checkout beside another commit, in turns
    python benchmarks/speed.py --quick             a little of each, to see that it runs; writes nothing

Every peer is optional; `pip install --group bench` installs them all. Each runs the same model on the same samples and
must come to the same numbers. Times are medians of what one core takes in one run: they belong to the machine, ratios
are what travels.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import platform
import subprocess
import sys
import warnings
from collections.abc import Iterator
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import against
import filter_speed
import fleet_speed
import machine_speed
import peers
import scaling
from figure import table
from observer_speed import step_times
from peers.battery_packages import battery_packages
from svg import to_svg
from timing import Goal, Picture, Section, Times, duration, goal_rows, page, spread, wall

PAGE = Path(__file__).resolve().parent / "speed.md"
PICTURES = PAGE.parents[1] / "docs" / "pictures"


class Effort(NamedTuple):
    """Extent of the measurement."""

    repeats: int
    steps: int
    logs: int
    states: tuple[int, ...]
    lengths: tuple[int, ...]
    numbers: tuple[int, ...]
    whole: bool


FULL = Effort(5, filter_speed.STEPS, filter_speed.LOGS, scaling.STATES, scaling.LENGTHS, scaling.LOGS, True)
QUICK = Effort(1, 2000, 16, (2, 3), (1000, 2000), (1, 16), False)


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a little of each, to see that it runs; writes nothing")
    parser.add_argument("--against", metavar="COMMIT", help="beside this checkout, another commit of it")
    arguments = parser.parse_args(words)
    quick = arguments.quick
    warnings.simplefilter("ignore")
    sections = [against.against(arguments.against)] if arguments.against else []
    with machine_speed.empty_cache():
        for section in all_sections(QUICK if quick else FULL):
            sections.append(section)
            print("\n".join(page(section)), flush=True)
    text = "\n".join(
        [*head(), *goals_page(sections), *overviews(sections), *(line for s in sections for line in page(s))]
    )
    print("\n".join(goals_page(sections)))
    if not quick:
        write(text, [s.picture for s in sections if s.picture])
    return 0


def write(text: str, pictures: list[Picture]) -> None:
    """The page and its pictures."""
    for picture in pictures:
        (PICTURES / f"{picture.name}.svg").write_text(to_svg(picture.figure), encoding="utf-8")
    PAGE.write_text(text, encoding="utf-8")


def all_sections(effort: Effort) -> Iterator[Section]:
    """In the order of the page."""
    machine = machine_speed.measured_machine()
    yield from filter_speed.one_log(machine, effort.repeats, effort.steps)
    machine = machine_speed.measured_again(machine)
    yield from filter_speed.many_logs(machine, effort.repeats, effort.steps, effort.logs)
    machine = machine_speed.measured_again(machine)
    yield own_filters(effort.repeats)
    yield machine_speed.public_section(machine, effort.repeats, effort.steps)
    yield observers(effort.repeats)
    yield machine_speed.live_section(effort.repeats)
    yield machine_speed.compilation_section(effort.repeats)
    yield start_up(effort.repeats)
    yield scaling.states_section(effort.repeats, effort.states)
    yield scaling.length_section(effort.repeats, effort.lengths)
    yield scaling.logs_section(effort.repeats, effort.numbers)
    if effort.whole:
        yield fleet()
        yield from long_logs()
    yield machine_speed.machine_section(machine)


def own_filters(repeats: int) -> Section:
    """Other packages' own filters on their own models."""
    rows = []
    for title, how, found in battery_packages(repeats):
        if isinstance(found, Times):
            rows.append((title, how, duration(found.median), spread(found)))
        else:
            rows.append((title, f"not installed: pip install {found.package}", "", ""))
    text = (
        "What a user of these packages gets: their own filters on their own models, so neither model nor numbers are "
        "those of the tables above. PyBatterySE's model is identified from the same drive by PyBatteryID."
    )
    return Section("Battery packages", text, ("package", "filter", "a step", "least to most"), rows)


def observers(repeats: int) -> Section:
    """The speed observer of the traction half on one log."""
    rows, goals = [], []
    for name, seconds, operations in step_times(repeats):
        rows.append((name, str(operations), duration(seconds)))
        if "AUKF" in name:
            goals.append(Goal(f"speed observer: {name}, Python source", seconds, 30e-6))
    text = "One log as Python source, which needs NumPy alone."
    return Section("Speed observers", text, ("observer", "operations", "a step"), rows, tuple(goals))


#: What a program imports that uses these.
IMPORTS = {
    "ohmward": "import ohmward",
    "ohmward's estimators": "from ohmward import SocEstimator, make_estimator",
    "FilterPy": "import filterpy.kalman",
    "pykalman": "import pykalman",
    "Stone Soup": "import stonesoup.updater.kalman, stonesoup.predictor.kalman",
    "CasADi": "import casadi",
    "Numba": "import numba",
    "JAX": "import jax",
    "dynamax": "import dynamax.nonlinear_gaussian_ssm",
    "PyBatterySE": "import pybatteryse",
    "ProgPy": "import progpy.state_estimators",
}
FIRST_ESTIMATE = """
from ohmward import SocEstimator, make_estimator
from ohmward.battery.chemistries import generic_battery

SocEstimator(generic_battery("nmc", 2.0), lowering={lowering!r}).update(0.0, -0.5, 3.7)
"""


def start_up(repeats: int) -> Section:
    """Whole processes."""

    def process(*words: str) -> Times:
        command = [sys.executable, *words]
        return wall(lambda: subprocess.run(command, check=True, capture_output=True), repeats)

    process("-c", "import numpy")
    numpy = process("-c", "import numpy")
    rows = [("import numpy", duration(numpy.median), spread(numpy))]
    for title, line in IMPORTS.items():
        if find_spec(line.split()[1].split(".")[0].rstrip(",")) is None:
            continue
        took = process("-c", f"import numpy; {line}")
        rows.append((f"import {title}, beyond NumPy", duration(took.median - numpy.median), spread(took)))
        if title == "ohmward":
            goals = [Goal("import ohmward, beyond NumPy", max(0.0, took.median - numpy.median), 0.1)]
    for lowering in ("python", "machine"):
        took = process("-c", FIRST_ESTIMATE.format(lowering=lowering))
        rows.append((f"Python to first estimate of the default, {lowering}", duration(took.median), spread(took)))
    goals.append(Goal("Python to first estimate of the default, code from the cache", took.median, 0.5))
    took = process("-m", "ohmward", "--help")
    rows.append(("`ohmward --help`", duration(took.median), spread(took)))
    goals.append(Goal("`ohmward --help`", took.median, 0.2))
    text = "Wall time of whole processes; least and most with NumPy's import."
    return Section("Starting", text, ("process", "median", "least to most"), rows, tuple(goals))


def fleet() -> Section:
    """From Parquet to a row each."""
    seconds, count = fleet_speed.seconds_for_each(), fleet_speed.FLEET
    rows = [
        (
            f"{fleet_speed.PROCESSES}",
            duration(seconds),
            duration(seconds / fleet_speed.STEPS),
            duration(count * seconds),
        )
    ]
    text = (
        f"{fleet_speed.LOGS:,} logs of {fleet_speed.STEPS:,} samples through `ohmward fleet` with the default filter: "
        "read from Parquet, checked, filtered, summarised. Wall time."
    )
    header = ("processes", "a log", "a sample", f"{count:,} logs would take")
    goal = Goal(
        f"{count:,} logs of {fleet_speed.STEPS:,} samples, the default filter", count * seconds, fleet_speed.BAR_S
    )
    return Section("A fleet", text, header, rows, (goal,))


def long_logs() -> Iterator[Section]:
    """`ohmward soc` on ever longer logs."""
    import long_log

    rows, goals = [], []
    for row in long_log.rows():
        rows.append((row.what, row.how, f"{row.value:.3g} {row.unit}"))
        if row.bar is not None:
            goals.append(Goal(f"{row.what}, {row.how}", row.value, row.bar, row.unit))
    text = "The command as a user types it, a process each: wall time and peak of its resident memory."
    yield Section("One long log", text, ("command", "how", "measured"), rows, tuple(goals))


def head() -> list[str]:
    """Subject of the page, and the machine it was made on."""
    return [
        "# Speed",
        "",
        "Written by `make bench`; [docs/speed.md](../docs/speed.md) says what is compared, and how.",
        "",
        "<!-- tables -->",
        "",
        "Everything in one run, side by side, in turns: medians of one core's processor time, with the least and the "
        f"most beside them, unless a table says wall time. {platform.machine()}, {os.cpu_count()} processors{load()}, "
        f"Python {platform.python_version()}, {versions()}.",
        "",
        "*Agrees to* is the largest difference from the matrices in NumPy after "
        f"{filter_speed.CHECK_STEPS} samples: of means in their sigmas, of covariances in products of two. *Points "
        "redrawn* are sigma points drawn anew after the prediction: another filter, compared with its own reference.",
        "",
    ]


#: Sections of the same table, one for each filter: how they begin, and the heading of what they have in common.
OVERVIEWS = {"One log: ": "One log, in short", "Many logs: ": "Many logs at once, in short"}


def overviews(sections: list[Section]) -> list[str]:
    """Time of each package for each filter, and its ratio to ours."""
    lines = []
    for begin, title in OVERVIEWS.items():
        found = {s.title.removeprefix(begin): s for s in sections if s.title.startswith(begin)}
        cells = {(row[0], plain(row[1]), name): row for name, s in found.items() for row in s.rows}
        names = list(dict.fromkeys(a for a, _, _ in cells))
        who = sorted(dict.fromkeys((a, b) for a, b, _ in cells), key=lambda pair: names.index(pair[0]))
        rows = [(a, b, *(cell(cells.get((a, b, name))) for name in found)) for a, b in who]
        text = "Time of a step of a log, and how many times as long as ours in machine code."
        lines += page(Section(title, text, ("who", "how", *found), rows))
    return lines


def plain(how: str) -> str:
    """The way without the variant."""
    return how.removesuffix(", points redrawn")


def cell(row: tuple[str, ...] | None) -> str:
    """Time and ratio; empty for who has no such filter or is not installed."""
    return f"{row[2]} ({row[4]})" if row and row[2] else ""


def load() -> str:
    """Load of the machine: on an idle one, this run alone is a load of about 1."""
    return f" under a load of {os.getloadavg()[1]:.1f}" if hasattr(os, "getloadavg") else ""


def versions() -> str:
    """Of what was compared."""
    found = []
    for package in ("numpy", "llvmlite", *(p.package for p in peers.PEERS[1:]), "pybatteryse", "progpy"):
        if find_spec(package):
            found.append(f"{package} {metadata.version(package)}")
    return ", ".join(found)


def goals_page(sections: list[Section]) -> list[str]:
    """All goals in one table."""
    goals = [g for s in sections for g in s.goals]
    met = sum(g.met for g in goals)
    rows = goal_rows(goals)
    return ["## Goals", "", f"{met} of {len(goals)} met.", "", *table(("what", "measured", "goal", ""), rows), ""]


if __name__ == "__main__":
    sys.exit(main())
