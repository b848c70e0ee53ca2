"""`ohmward calibrate`: radius, motors and floors of a robot, from drives whose true motion is known."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ohmward.cli.drive_inputs import drive_options, read_calibration_drive
from ohmward.cli.outcome import Outcome, check_output, counting, progress
from ohmward.cli.wording import bullets, fields, paragraphs, table
from ohmward.errors import InputError
from ohmward.figures.numbers import percent
from ohmward.figures.slip import calibration_figure, law_figure
from ohmward.filters.consistency import BAND_95
from ohmward.logs.read import open_table
from ohmward.logs.selection import split_selection
from ohmward.report import Page
from ohmward.runs import duration
from ohmward.traction import load_robot, save_robot
from ohmward.traction.calibration import Calibration, calibrate, with_wheel_loads
from ohmward.traction.calibration.calibrate import PARTS
from ohmward.traction.calibration.parameters import ROLLING, Parameter
from ohmward.traction.terrain.floor import Floor, Floors, load_floors, save_floors

PARAMETERS = ["parameter", "value", "95 % interval", ""]


def run(args: argparse.Namespace) -> Outcome:
    """Calibrate, write the robot and its floors."""
    if (args.floor is None) != (args.floors is None):
        raise InputError("--floor NAME and --floors FILE.toml belong together: the floor's name, and where it is kept")
    inputs = [str(split_selection(text)[0]) for text in args.logs]
    check_output("--output", args.output, (".toml",), inputs)
    check_output("--floors", args.floors, (".toml",), inputs)
    robot = load_robot(args.robot)
    if args.wheel_load is not None:
        robot = with_wheel_loads(robot, args.wheel_load)
    options = drive_options(args, robot)
    with progress() as report:
        texts = [one for text in args.logs for one in recordings(text, args.each)]
        read = counting(report, "reading") or (lambda done, total: None)
        drives = []
        for k, text in enumerate(texts, start=1):
            drives.append(read_calibration_drive(text, robot, options, args))
            read(k, len(texts))
        parts = () if args.floor and args.what is None else wanted(args.what)
        found = calibrate(drives, robot, parts, args.floor, rolling(args.rolling))
    if args.output:
        save_robot(found.robot, args.output)
    if args.floors and found.floor:
        known = load_floors(args.floors) if Path(args.floors).exists() else Floors(found.robot.name)
        save_floors(known.with_floor(found.floor), args.floors)
    figures = summary(found) | {"output": args.output, "floors": args.floors, "report": args.report}
    return Outcome(figures, describe(found, figures), figures["notes"], partial(make_page, found, figures))


def wanted(what: str | None) -> tuple[str, ...] | None:
    """Parts of the robot to calibrate; None for the usual ones.

    Raises:
        InputError: --what names anything else.
    """
    names = None if what is None else tuple(name.strip() for name in what.split(","))
    if unknown := [name for name in names or () if name not in PARTS]:
        raise InputError(f"--what takes {', '.join(PARTS)}, separated by commas; got {unknown[0]!r}")
    return names


def rolling(given: list[float] | None) -> tuple[float, float]:
    """Rolling resistance of the floor and its standard deviation, by default half of it."""
    if given is None:
        return ROLLING
    return given[0], given[1] if len(given) > 1 else 0.5 * given[0]


def recordings(text: str, each: str | None) -> list[str]:
    """The file with each value of the column `each`, in order; the file itself without `each`.

    Raises:
        InputError: no such column.
    """
    if each is None:
        return [text]
    path, where = split_selection(text)
    file = open_table(path)
    if each not in file.names:
        raise InputError(f"{path}: there is no column {each!r} for --each; it has: {', '.join(file.names)}")
    values = np.unique(np.asarray(file.load({each}).columns[each], dtype=float))
    chosen = "".join(f"{name}={value}," for name, value in where.items())
    return [f"{path}:{chosen}{each}={value:g}" for value in values[np.isfinite(values)]]


def summary(found: Calibration) -> dict[str, Any]:
    """The object of --json, but for the files."""
    notes = [str(note) for drive in found.drives for note in drive.log.notes if note.level != "info"]
    notes += [str(note) for note in found.notes]
    return {
        "command": "calibrate",
        "robot": found.robot.name,
        "drives": len(found.drives),
        "duration_s": sum(drive.log.duration_s for drive in found.drives),
        "parameters": [parameter_facts(p) for p in found.parameters],
        "floor": found.floor,
        "notes": list(dict.fromkeys(notes)),
    }


def parameter_facts(p: Parameter) -> dict[str, Any]:
    """A parameter in the object of --json."""
    return {**p._asdict(), "identified": p.identified}


def describe(found: Calibration, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    title = (
        f"robot {found.robot.name!r}: {figures['drives']} drive{'s' if figures['drives'] > 1 else ''}, "
        f"{duration(figures['duration_s'])}"
    )
    files = {"robot file": figures["output"], "floors": figures["floors"] if found.floor else None}
    written = [f"{name}: {path}" for name, path in files.items() if path]
    return paragraphs(
        title,
        table(PARAMETERS, parameter_rows(found.parameters)) if found.parameters else "",
        fields(floor_fields(found.floor)) if found.floor else "",
        bullets("Not identified", [f"{p.name}: {p.reason}" for p in found.parameters if not p.identified]),
        "\n".join(written) or "No robot file written; name one with -o.",
    )


def parameter_rows(parameters: Sequence[Parameter]) -> list[list[str]]:
    """Each parameter with its interval."""
    return [
        [
            p.name,
            f"{p.value:.4g}",
            f"{p.value - BAND_95 * p.std:.4g} to {p.value + BAND_95 * p.std:.4g}" if p.identified else "-",
            "" if p.identified else "kept",
        ]
        for p in parameters
    ]


def floor_fields(floor: Floor) -> dict[str, str]:
    """A learnt floor with its 95 % bands, by name."""
    return {
        "floor": floor.name,
        "stiffness": f"{floor.stiffness:.3g} ± {percent(BAND_95 * floor.stiffness_std, 0)} (95 %)",
        "friction": f"{floor.friction:.3g} ± {percent(BAND_95 * floor.friction_std, 0)} (95 %)",
        "across, side, speed power": f"{floor.across:.2f}, {floor.side:.2f}, {floor.speed_power:.2f}",
        "slip left unexplained": f"{floor.slip_std:.3f} of each wheel from drive to drive",
        "rolling, rollers": f"{floor.rolling:.3f}, {floor.roller:.3f} of the load",
    }


def make_page(found: Calibration, figures: Mapping[str, Any]) -> Page:
    """Calibrated parameters, the speeds behind them, and the floor's law with the stretches it was learnt from."""
    what = f"{figures['drives']} drives, {duration(figures['duration_s'])}"
    page = Page(f"Robot {found.robot.name!r}", what)
    for p in found.parameters:
        if not p.identified:
            page = page.callout("warning", f"{p.name} was not identified: {p.reason}. The robot's own value is kept.")
    if found.parameters:
        page = (
            page.heading("Parameters")
            .table(PARAMETERS, parameter_rows(found.parameters))
            .plot(calibration_figure(found))
        )
    if found.floor:
        rows = list(floor_fields(found.floor).items())
        page = (
            page.heading(f"Floor {found.floor.name!r}")
            .plot(law_figure(found, found.floor))
            .table(["What", "Value"], rows)
        )
    return page
