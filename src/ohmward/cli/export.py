"""`ohmward export`: an estimator as a C99 library for a microcontroller."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, positive, share

if TYPE_CHECKING:
    from ohmward.export.c_library import Export

_EXAMPLES = """\
  ohmward export battery.toml -o firmware/soc
  ohmward export battery.toml --filter textbook-ekf --name cell --sample-time 1 --flash-kb 8 -o firmware/cell
  ohmward export battery.toml --filter textbook-joint --style loops --name joint -o firmware/joint
  ohmward export robot.toml --filter ekf --name speed -o firmware/speed
  ohmward export rlma --filter slip-controller --name wheel -o firmware/wheel
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "export", "a filter or controller as a C99 library for a microcontroller", _EXAMPLES)
    parser.add_argument(
        "file", metavar="FILE", help="battery file, made by `ohmward identify`; or robot file, rlma or robotino"
    )
    parser.add_argument(
        "--filter",
        default="ekf",
        metavar="NAME",
        help="as in `ohmward soc`, or textbook-joint for the parameters of the RC model; of a robot as in "
        "`ohmward slip`, or slip-controller or speed-controller (default %(default)s)",
    )
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write, made if there is none")
    parser.add_argument(
        "--name", default="filter", metavar="WORD", help="prefix of files and symbols (default %(default)s)"
    )
    parser.add_argument("--terrain", default="dry asphalt", metavar="NAME", help="of a robot (default %(default)s)")
    group = parser.add_argument_group("start and target")
    group.add_argument(
        "--initial-soc",
        type=share,
        default=0.5,
        metavar="S",
        help="state of charge of the example; filters that must start there say so (default %(default)s)",
    )
    group.add_argument(
        "--initial-soc-std", type=positive, default=0.3, metavar="S", help="how sure that is (default %(default)s)"
    )
    group.add_argument(
        "--sample-time",
        type=positive,
        metavar="S",
        help="samples always come so many seconds apart: smaller and faster, dt_s is not looked at",
    )
    group.add_argument(
        "--style",
        choices=("lines", "loops"),
        default="lines",
        help="lines: no loops, the fastest; loops: a few filters, the smallest (default %(default)s)",
    )
    group.add_argument(
        "--curve-error",
        type=positive,
        metavar="MV",
        help="of textbook-ekf and textbook-ukf: for a smaller table the open-circuit voltage of a cell may be so many "
        "millivolts off",
    )
    group.add_argument("--flash-kb", type=positive, metavar="K", help="refuse what takes more flash")
    group.add_argument("--ram-kb", type=positive, metavar="K", help="refuse what takes more RAM")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Write the library."""
    from ohmward.export.c_library import check_fits, library, size, write_library

    export = _robot_export(args) if _is_robot(args.file) else _battery_export(args)
    check_fits(export, *(1024 * k if k else None for k in (args.flash_kb, args.ram_kb)))
    paths = write_library(library(export), Path(args.output))
    needed = size(export)
    figures = {
        "command": "export",
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
        f"compile and check it here:\n  make -C {args.output} test",
    )
    return Outcome(figures, text)


def _is_robot(file: str) -> bool:
    """Whether it names a robot: one that comes with the package, or a file of that format."""
    from ohmward.cli.driving import BUILT_IN
    from ohmward.toml_file import noun_of

    return file.lower() in BUILT_IN or noun_of(file) == "robot"  # of all others the reader of battery files speaks


def _battery_export(args: argparse.Namespace) -> Export:
    from ohmward.battery.file import load_battery
    from ohmward.export.battery import battery_export, curve_error_of_pack_V

    battery, start = load_battery(args.file), (args.initial_soc, args.initial_soc_std)
    curve_V = curve_error_of_pack_V(battery, args.curve_error)
    return battery_export(battery, args.filter, args.name, *start, args.sample_time, args.style, curve_V)


def _robot_export(args: argparse.Namespace) -> Export:
    from ohmward.cli.driving import make_robot, make_terrain
    from ohmward.errors import InputError
    from ohmward.export.battery import WITH_LOOPS
    from ohmward.export.traction import CONTROLLERS, controller_export, observer_export

    if args.curve_error:
        raise InputError("a curve error is for the open-circuit voltage of a battery; leave out --curve-error")
    if args.style != "lines":
        raise InputError(f"{args.filter} of a robot has no loops, only {', '.join(WITH_LOOPS)} of a battery have")
    robot = make_robot(args.file)
    if args.filter in CONTROLLERS:
        return controller_export(robot, args.filter, args.name)
    return observer_export(robot, make_terrain(args.terrain, robot), args.filter, args.name)
