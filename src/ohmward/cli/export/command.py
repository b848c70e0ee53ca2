"""`ohmward export`: an estimator as a C99 library for a microcontroller, or as one file of Python."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from ohmward.battery.soc.registry import DEFAULT
from ohmward.cli import wording
from ohmward.cli.battery_inputs import load_battery_with_sensor
from ohmward.cli.drive_inputs import make_terrain
from ohmward.cli.options import BUILT_IN
from ohmward.cli.outcome import Outcome
from ohmward.errors import InputError
from ohmward.export.battery import WITH_LOOPS, battery_export, curve_error_of_pack_V
from ohmward.export.c_library import Export, check_fits, library, size, write_library
from ohmward.export.python_file import python_file
from ohmward.export.traction import CONTROLLERS, ODOMETRY, controller_export, observer_export, odometry_export
from ohmward.toml_file import noun_of
from ohmward.traction import load_robot

#: Filter for a microcontroller unless another is named.
_SMALL = "ekf"

#: Module of a Python file unless another is named: blind benchmarks import `Model` from `Model.py`.
_MODULE = "Model"


def run(args: argparse.Namespace) -> Outcome:
    """Write the library, or the file."""
    if args.filter is None:
        args.filter = DEFAULT if args.language == "python" else _SMALL
    if args.language == "python":
        return _write_python(args)
    args.name = args.name or _symbol(args.output)
    export, contradictions = (_robot_export(args), []) if _is_robot(args.file) else _battery_export(args)
    notes = [f"warning: {text}" for text in contradictions]
    check_fits(export, *(1024 * k if k else None for k in (args.flash_kb, args.ram_kb)))
    paths = write_library(library(export), Path(args.output))
    needed = size(export)
    figures = {
        "command": "export",
        "language": args.language,
        "title": export.title,
        "filter": args.filter,
        "name": args.name,
        "sample_time_s": args.sample_time,
        "style": args.style,
        "curve_error_mV": args.curve_error,
        "operations": needed.operations,
        "flash_bytes_estimated": needed.flash,
        "state_bytes": needed.state,
        "vectors": len(export.samples),
        "output": args.output,
        "files": [path.name for path in paths],
        "notes": notes,
    }
    rows = {
        "operations": f"{needed.operations:,}",
        "flash": f"about {needed.flash / 1024:.1f} KB on a Cortex-M with -Os",
        "state": f"{needed.state} bytes",
        "files": ", ".join(figures["files"]),
    }
    text = wording.paragraphs(
        f"{args.output}: {export.title}",
        wording.fields(rows),
        wording.assumptions(notes),
        f"compile and check it here:\n  make -C {args.output} test",
    )
    return Outcome(figures, text, notes)


def _symbol(folder: str) -> str:
    """The folder's name as a prefix of C: small letters, digits and underscores."""
    word = re.sub(r"[^a-z0-9]+", "_", Path(folder).resolve().name.lower()).strip("_")
    return word if word[:1].isalpha() else f"filter_{word}".rstrip("_")


def _write_python(args: argparse.Namespace) -> Outcome:
    if args.style != "lines" or args.flash_kb or args.ram_kb:
        raise InputError("--style, --flash-kb and --ram-kb are for C; leave them out with --language python")
    if _is_robot(args.file):
        raise InputError(f"{args.file} is a robot; Python is written for batteries, leave out --language python")
    args.name = args.name or _MODULE
    export, contradictions = _battery_export(args)
    notes = [f"warning: {text}" for text in contradictions]
    files = {f"{export.name}.py": python_file(export, args.sample_time, **_given_start(args))}
    (path,) = write_library(files, Path(args.output))
    figures = {
        "command": "export",
        "language": args.language,
        "title": export.title,
        "filter": args.filter,
        "name": args.name,
        "sample_time_s": args.sample_time,
        "operations": len(export.step.nodes),
        "output": args.output,
        "files": [path.name],
        "notes": notes,
    }
    text = wording.paragraphs(
        f"{path}: {export.title}",
        wording.assumptions(notes),
        f"use it, with rows of current [A] (> 0 charges), voltage [V], temperature [degC]:\n"
        f"  from {export.name} import Model\n  soc, z = Model(X)",
    )
    return Outcome(figures, text, notes)


def _is_robot(file: str) -> bool:
    """True where it names a robot: one that comes with the package, or a file of that format."""
    return file.lower() in BUILT_IN or noun_of(file) == "robot"  # of all others the reader of battery files speaks


def _battery_export(args: argparse.Namespace) -> tuple[Export, list[str]]:
    """The filter, and a sentence for each option that contradicts the battery file."""
    battery, contradictions = load_battery_with_sensor(args.file, args)
    curve_V = curve_error_of_pack_V(battery, args.curve_error)
    export = battery_export(
        battery,
        args.filter,
        args.name,
        **_given_start(args),
        sample_time_s=args.sample_time,
        style=args.style,
        curve_error_V=curve_V,
    )
    return export, contradictions


def _given_start(args: argparse.Namespace) -> dict[str, float]:
    """The start that the command line gives; the rest is as of the language."""
    given = {"soc": args.initial_soc, "soc_std": args.initial_soc_std}
    return {word: value for word, value in given.items() if value is not None}


def _robot_export(args: argparse.Namespace) -> Export:
    if args.sensor_offset is not None or args.sensor_gain is not None:
        raise InputError("a current sensor is that of a battery; leave out --sensor-offset and --sensor-gain")
    if args.curve_error:
        raise InputError("a curve error is for the open-circuit voltage of a battery; leave out --curve-error")
    if args.style != "lines":
        raise InputError(f"{args.filter} of a robot has no loops, only {', '.join(WITH_LOOPS)} of a battery have")
    robot = load_robot(args.file)
    if args.filter in CONTROLLERS:
        return controller_export(robot, args.filter, args.name)
    if args.filter == ODOMETRY:
        return odometry_export(robot, args.name)
    return observer_export(robot, make_terrain(args.terrain, robot), args.filter, args.name)
