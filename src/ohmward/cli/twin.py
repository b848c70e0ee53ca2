"""`ohmward twin`: run a log through an exported C library on this machine, bit for bit as on the microcontroller."""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

from ohmward.battery.log_check import with_contradictions
from ohmward.battery.soc.estimator import samples_of as battery_samples_of
from ohmward.battery.soc.fit_check import voltage_missed
from ohmward.cli.battery_inputs import given_start, load_with_sensor, read_battery_log, read_options
from ohmward.cli.drive_inputs import drive_options
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.wording import fields, paragraphs, table
from ohmward.embedded.battery import battery_export, curve_error_of_pack_V
from ohmward.embedded.c_library import Export
from ohmward.embedded.comparison import compare
from ohmward.embedded.traction import observer_export
from ohmward.embedded.twin import Twin, first_of, output_columns
from ohmward.errors import InputError
from ohmward.figures.numbers import flagged
from ohmward.logs import DriveLog, Log, write_table
from ohmward.logs.write import TABLES
from ohmward.traction import load_robot
from ohmward.traction.friction.terrain import terrain_named
from ohmward.traction.motion.sample import samples_of as drive_samples_of

#: A member that only samples of a battery have, and one that only samples of a drive have.
_BATTERY, _DRIVE = "voltage_V", "wheel_speed_rad_s"
#: Members of the output of a filter that predicts the voltage.
_PREDICTED = {"voltage_V", "innovation_V"}


class Replay(NamedTuple):
    """A log as samples of the library, and the estimator to compare with, if one is named."""

    log: Log | DriveLog
    samples: Any
    arguments: dict[str, float]
    export: Export | None = None


def run(args: argparse.Namespace) -> Outcome:
    """Compile, replay, compare, write.

    Raises:
        InputError: as `prepare`.
    """
    check_output("--output", args.output, TABLES, [args.log])
    twin = Twin(args.library, args.name)
    figures = replayed(twin, prepare(twin, args), args.output) | {"library": args.library, "output": args.output}
    return Outcome(figures, describe(figures), figures["notes"])


def prepare(twin: Twin, args: argparse.Namespace) -> Replay:
    """The log of a command line as samples of a library.

    Raises:
        InputError: the library takes no samples of a log, a drive comes without its robot, or an option does not fit.
    """
    members = twin.Sample._fields
    if _BATTERY in members:
        if (args.battery is None) != (args.filter is None):
            raise InputError("--battery and --filter go together: they name the estimator to compare with")
        log = read_battery_log(args.log, read_options(args), extra=())
        given = given_start(args)
        replay = Replay(log, battery_samples_of(log), start_arguments(twin, given))
        if args.battery is None:
            return replay
        battery, _ = load_with_sensor(args.battery, args)  # the options of the export: no contradiction
        curve_V = curve_error_of_pack_V(battery, args.curve_error)
        exported = {"sample_time_s": args.sample_time, "curve_error_V": curve_V}
        replay = replay._replace(log=with_contradictions(log, battery))
        return replay._replace(export=battery_export(battery, args.filter, twin.name, **given, **exported))
    if _DRIVE not in members:
        raise InputError(
            f"library {twin.name!r} takes {', '.join(members)}, which no log has; use ohmward.embedded.Twin in Python"
        )
    if args.robot is None:
        raise InputError("a log of a drive needs --robot FILE.toml: it says which wheels there are")
    robot = load_robot(args.robot)
    terrain = terrain_named(args.terrain, robot.wheel)
    drive = drive_options(args, robot).read(args.log, extra=())
    export = observer_export(robot, terrain, args.filter) if args.filter else None
    return Replay(drive, drive_samples_of(drive, robot), {}, export)


def replayed(twin: Twin, replay: Replay, output: str | None) -> dict[str, Any]:
    """Figures of a run of the log through the library; its outputs go to the file `output`, if one is named."""
    began = time.perf_counter()
    twin.start(first_of(replay.samples), **replay.arguments)
    outputs = twin.run(replay.samples)
    seconds = time.perf_counter() - began
    columns, export = output_columns(outputs), replay.export
    log = replay.log
    warnings = voltage_missed(log.voltage_V, outputs) if isinstance(log, Log) and columns.keys() >= _PREDICTED else ()
    if output:
        write_table({"time_s": log.time_s} | columns, output)
    return {
        "command": "twin",
        "name": twin.name,
        "log": log.name,
        "steps": len(log),
        "seconds": seconds,
        "final": {name: float(column[-1]) for name, column in columns.items()},
        "flags": twin.flag_counts(outputs),
        "compared_with": export.title if export else None,
        "differences": compare(twin, export, outputs, replay.samples, tuple(replay.arguments.values()))
        if export
        else None,
        "notes": [str(note) for note in (*log.notes, *warnings)],
    }


def start_arguments(twin: Twin, given: dict[str, float]) -> dict[str, float]:
    """Arguments of the start, from the command line or else from the export of the library.

    Raises:
        InputError: the start takes no such argument, or the value of one is unknown.
    """
    if foreign := sorted(set(given) - set(twin.arguments)):
        raise InputError(
            f"the start of library {twin.name!r} takes no {foreign[0]}: it always starts as it was exported; leave out "
            f"--initial-{foreign[0].replace('_', '-')}, or export it with that"
        )
    known = twin.example | given
    if missing := [word for word in twin.arguments if word not in known]:
        raise InputError(
            f"library {twin.name!r} needs {', '.join(missing)} to start, and its folder lacks test_{twin.name}.c, "
            "which says what it was exported with; export it again"
        )
    return {word: known[word] for word in twin.arguments}


def describe(figures: dict[str, Any]) -> str:
    """Text for people."""
    step_s = figures["seconds"] / max(figures["steps"], 1)
    rows = {name: f"{value:.6g}" for name, value in figures["final"].items()} | {
        "flagged samples": flagged(figures["flags"]),
        "steps": f"{figures['steps']:,}, {1e9 * step_s:.0f} ns each",
    }
    differences = [[name, f"{value:.2g}"] for name, value in (figures["differences"] or {}).items()]
    return paragraphs(
        f"{figures['log']} through {figures['name']!r} of {figures['library']}, after the last sample",
        fields(rows),
        f"Compared with double precision. {figures['compared_with']}:" if differences else "",
        table(["", "largest difference"], differences) if differences else "",
    )
