"""`ohmward twin`: a log through an exported C library on this machine, bit by bit what the microcontroller computes."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from ohmward.cli import wording
from ohmward.cli.driving import DEFAULT_TERRAIN, add_drive_options
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.parser import add_command, positive, share
from ohmward.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from ohmward.export.c_library import Export
    from ohmward.export.twin import Twin
    from ohmward.logs import DriveLog, Log

_EXAMPLES = """\
  ohmward export battery.toml --filter ekf -o firmware/soc
  ohmward twin firmware/soc day.csv -o twin.csv
  ohmward twin firmware/soc day.csv --battery battery.toml --filter ekf --initial-soc 1.0
  ohmward twin firmware/speed drive.csv --robot robot.toml --filter ekf --json
"""
#: A member of the sample that only a battery's, or only a drive's has.
_BATTERY, _DRIVE = "voltage_V", "wheel_speed_rad_s"


class Replay(NamedTuple):
    """A log as samples of the library, and the estimator to compare with, if one is named."""

    log: Log | DriveLog
    samples: Any
    arguments: dict[str, float]
    export: Export | None


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        commands, "twin", "a log through an exported C library on this machine: the firmware's own bits", _EXAMPLES
    )
    parser.add_argument("library", metavar="DIR", help="folder that `ohmward export` has written")
    parser.add_argument("log", metavar="LOG", help="a CSV, Parquet or BDF file")
    parser.add_argument("--name", metavar="WORD", help="prefix of the library, where the folder holds several")
    group = parser.add_argument_group("what was exported")
    group.add_argument("--filter", metavar="NAME", help="as in `ohmward export`: compare with it in double precision")
    group.add_argument("--battery", metavar="FILE.toml", help="battery file of that filter")
    group.add_argument("--sample-time", type=positive, metavar="S", help="as given to `ohmward export`")
    group.add_argument("--curve-error", type=positive, metavar="MV", help="the same")
    group.add_argument("--robot", metavar="FILE.toml", help="robot file, rlma or robotino; needed for logs of drives")
    group.add_argument(
        "--terrain", default=DEFAULT_TERRAIN, metavar="NAME", help="as in `ohmward export` (default %(default)s)"
    )
    group.add_argument(
        "--initial-soc", type=share, metavar="S", help="of the start, if it takes one; default: that of the export"
    )
    group.add_argument("--initial-soc-std", type=positive, metavar="S", help="how sure that is; default: as above")
    add_drive_options(parser)
    parser.add_argument(
        "--current-sign",
        choices=("auto", "charge", "discharge"),
        default="auto",
        help="of a battery's log: what a positive current in the file does to it (default %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("-o", "--output", metavar="FILE", help="write what the firmware says: .csv or .parquet")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Compile, replay, compare, write."""
    from ohmward.export.twin import Twin

    check_output("--output", args.output, (".csv", ".parquet"), [args.log])
    twin = Twin(args.library, args.name)
    replay = prepare(twin, args)
    began = time.perf_counter()
    twin.start(first_of(replay.samples), **replay.arguments)
    outputs = twin.run(replay.samples)
    seconds = time.perf_counter() - began
    if args.output:
        from ohmward.logs import write_table

        write_table({"time_s": replay.log.time_s} | columns(outputs), args.output)
    figures = summary(twin, replay, outputs, seconds) | {"library": args.library, "output": args.output}
    return Outcome(figures, describe(figures), figures["notes"])


def prepare(twin: Twin, args: argparse.Namespace) -> Replay:
    """The log in the samples of the library.

    Raises:
        InputError: the library takes no samples of a log, or a drive comes without its robot.
    """
    members = twin.Sample._fields
    if _BATTERY in members:
        return _battery_replay(twin, args)
    if _DRIVE not in members:
        raise InputError(
            f"library {twin.name!r} takes {', '.join(members)}, which no log has; use ohmward.export.Twin in Python"
        )
    if args.robot is None:
        raise InputError("a log of a drive needs --robot FILE.toml: it says which wheels there are")
    return _drive_replay(args)


def _battery_replay(twin: Twin, args: argparse.Namespace) -> Replay:
    from ohmward.battery.soc.estimator import samples_of
    from ohmward.cli.reading import read

    log = read(args.log, args, extra=())
    given = {"soc": args.initial_soc, "soc_std": args.initial_soc_std}
    given = {word: value for word, value in given.items() if value is not None}
    arguments = start_arguments(twin, given)
    if (args.battery is None) != (args.filter is None):
        raise InputError("--battery and --filter go together: they name the estimator to compare with")
    export = None
    if args.battery:
        from ohmward.battery.file import load_battery
        from ohmward.export.battery import battery_export, curve_error_of_pack_V

        battery = load_battery(args.battery)
        curve_V = curve_error_of_pack_V(battery, args.curve_error)
        exported = {"sample_time_s": args.sample_time, "curve_error_V": curve_V}
        export = battery_export(battery, args.filter, twin.name, **given, **exported)
    return Replay(log, samples_of(log), arguments, export)


def _drive_replay(args: argparse.Namespace) -> Replay:
    from ohmward.cli.driving import make_robot, make_terrain, read_drive_log
    from ohmward.export.traction import observer_export
    from ohmward.traction.dynamics.forces import scene
    from ohmward.traction.speed_observer.speed_observer import SpeedObserver
    from ohmward.traction.speed_observer.track import samples_of

    robot = make_robot(args.robot)
    terrain, log = make_terrain(args.terrain, robot), read_drive_log(args.log, robot, args, extra=())
    export = observer_export(robot, terrain, args.filter) if args.filter else None
    return Replay(log, samples_of(log, SpeedObserver(scene(robot, terrain))), {}, export)


def start_arguments(twin: Twin, given: dict[str, float]) -> dict[str, float]:
    """What the start is given: what the command line says, else what the library was exported with.

    Raises:
        InputError: the start takes no such argument, or nobody says its value.
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
            "which says what it was exported with; export it anew"
        )
    return {word: known[word] for word in twin.arguments}


def first_of(samples: Any) -> Any:
    """The first sample of a log."""
    return type(samples)(*(x[0] if getattr(x, "ndim", 0) else x for x in samples))


def columns(outputs: Any) -> dict[str, np.ndarray]:
    """Members of the output (T, ...) as columns (T,); those of an array are numbered."""
    found: dict[str, np.ndarray] = {}
    for name, values in outputs._asdict().items():
        found |= {f"{name}_{k}": column for k, column in enumerate(values.T)} if values.ndim > 1 else {name: values}
    return found


def summary(twin: Twin, replay: Replay, outputs: Any, seconds: float) -> dict[str, Any]:
    """The object of --json."""
    import numpy as np

    steps = len(replay.log)
    flags = getattr(outputs, "flags", np.zeros(steps))
    known = flags[np.isfinite(flags)].astype(int)
    counts = {name.lower(): int(np.count_nonzero(known & bit)) for name, bit in twin.flags.items()}
    compared = None
    if replay.export:
        from ohmward.export.comparison import compare

        compared = compare(twin, replay.export, outputs, replay.samples, tuple(replay.arguments.values()))
    return {
        "command": "twin",
        "name": twin.name,
        "log": replay.log.name,
        "steps": steps,
        "seconds": seconds,
        "final": {name: float(column[-1]) for name, column in columns(outputs).items()},
        "flags": {name: count for name, count in counts.items() if count},
        "compared_with": replay.export.title if replay.export else None,
        "differences": compared,
        "notes": [str(note) for note in replay.log.notes],
    }


def describe(figures: dict[str, Any]) -> str:
    """The same for people."""
    rows = {name: f"{value:.6g}" for name, value in figures["final"].items()}
    flags = ", ".join(f"{name.replace('_', ' ')} {count:,}" for name, count in figures["flags"].items())
    spent = figures["seconds"] / max(figures["steps"], 1)
    rows |= {"flagged samples": flags or "none", "steps": f"{figures['steps']:,}, {1e9 * spent:.0f} ns each"}
    differences = figures["differences"] or {}
    table = [[name, f"{value:.2g}"] for name, value in differences.items()]
    return wording.paragraphs(
        f"{figures['log']} through {figures['name']!r} of {figures['library']}, after the last sample",
        wording.fields(rows),
        f"Compared with double precision. {figures['compared_with']}:" if table else "",
        wording.table(["", "largest difference"], table) if table else "",
        wording.bullets("Assumed", [note.removeprefix("info: ") for note in figures["notes"]]),
    )
