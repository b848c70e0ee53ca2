"""`ohmward export`: an estimator as a C99 library for a microcontroller."""

from __future__ import annotations

import argparse
from pathlib import Path

from ohmward.cli import wording
from ohmward.cli.outcome import Outcome
from ohmward.cli.parser import add_command, positive, share

_EXAMPLES = """\
  ohmward export battery.toml -o firmware/soc
  ohmward export battery.toml --filter textbook-ukf --name cell --flash-kb 16 -o firmware/cell
"""


def add_parser(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(commands, "export", "an estimator as a C99 library for a microcontroller", _EXAMPLES)
    parser.add_argument("battery", metavar="FILE.toml", help="battery file, made by `ohmward identify`")
    parser.add_argument("--filter", default="ekf", metavar="NAME", help="as in `ohmward soc` (default %(default)s)")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write, made if there is none")
    parser.add_argument(
        "--name", default="battery", metavar="WORD", help="prefix of files and symbols (default %(default)s)"
    )
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
    group.add_argument("--flash-kb", type=positive, metavar="K", help="refuse what takes more flash")
    group.add_argument("--ram-kb", type=positive, metavar="K", help="refuse what takes more RAM")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> Outcome:
    """Write the library."""
    from ohmward.battery.battery_file import load_battery
    from ohmward.export import battery_export, library, write_library
    from ohmward.export.library import check_fits, size

    battery = load_battery(args.battery)
    start = args.initial_soc, args.initial_soc_std
    export = battery_export(battery, args.filter, args.name, *start, args.sample_time)
    check_fits(export, *(1024 * k if k else None for k in (args.flash_kb, args.ram_kb)))
    paths = write_library(library(export), Path(args.output))
    needed = size(export)
    figures = {
        "command": "export",
        "battery": battery.name,
        "filter": args.filter,
        "name": args.name,
        "sample_time_s": args.sample_time,
        "operations": needed.operations,
        "flash_bytes_estimated": needed.flash,
        "state_bytes": needed.state,
        "vectors": len(export.samples),
        "output": args.output,
        "files": [path.name for path in paths],
    }
    rows = {
        "operations": f"{needed.operations:,}",
        "flash": f"about {needed.flash / 1024:.1f} KB on a Cortex-M",
        "state": f"{needed.state} bytes",
        "files": ", ".join(figures["files"]),
    }
    text = wording.paragraphs(
        f"{args.output}: {export.title}",
        wording.fields(rows),
        f"compile and check it here:\n  make -C {args.output} test",
    )
    return Outcome(figures, text)
