"""Arguments of `ohmward twin`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli import options
from ohmward.cli.parser import positive, share

EXAMPLES = """\
  ohmward export battery.toml --filter ekf -o firmware/soc
  ohmward twin firmware/soc day.csv -o twin.csv
  ohmward twin firmware/soc day.csv --battery battery.toml --filter ekf --initial-soc 1.0
  ohmward twin firmware/speed drive.csv --robot robot.toml --filter ekf --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("library", metavar="DIR", help="folder that `ohmward export` has written")
    parser.add_argument("log", metavar="LOG", help=options.LOG)
    parser.add_argument("--name", metavar="WORD", help="prefix of the library, where the folder holds several")
    group = parser.add_argument_group("what was exported")
    group.add_argument("--filter", metavar="NAME", help="as in `ohmward export`: compare with it in double precision")
    group.add_argument("--battery", metavar="FILE.toml", help="battery file of that filter")
    group.add_argument("--sample-time", type=positive, metavar="S", help="as given to `ohmward export`")
    group.add_argument("--curve-error", type=positive, metavar="MV", help="the same")
    options.add_sensor_options(group)
    group.add_argument("--robot", metavar="FILE.toml", help=f"{options.ROBOT}; needed for logs of drives")
    group.add_argument(
        "--terrain",
        default=options.DEFAULT_TERRAIN,
        metavar="NAME",
        help="as in `ohmward export` (default %(default)s)",
    )
    group.add_argument(
        "--initial-soc", type=share, metavar="S", help="of the start, if it takes one; default: that of the export"
    )
    group.add_argument("--initial-soc-std", type=positive, metavar="S", help="how sure that is; default: as above")
    options.add_drive_options(parser, interval=False)
    options.add_current_sign_option(
        parser, "of a battery's log: what a positive current in the file does to it (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("-o", "--output", metavar="FILE", help="write what the firmware says: .csv, .parquet or .mcap")
