"""Arguments of `ohmward doctor`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import ROBOT, add_log_options, add_output_options, add_shaft_options

EXAMPLES = """\
  ohmward doctor test.csv
  ohmward doctor test.csv day.csv --report logs.html
  ohmward doctor battery.toml robot.toml
  ohmward doctor drive.csv --robot robot.toml
  ohmward doctor test.csv --column current=current_A --unit current=A --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a log of a battery, a drive or both (any format of docs/logs.md, - for standard input), or a file of a "
        "battery, a robot or a setup (.toml)",
    )
    add_log_options(parser)
    group = parser.add_argument_group("drives")
    group.add_argument("--robot", metavar="FILE.toml", help=f"checks the drive with it: {ROBOT}")
    add_shaft_options(group)
    add_output_options(parser)
