"""Arguments of `ohmward learn`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_initial_soc_option, add_log_options, add_output_options, add_sensor_options

EXAMPLES = """\
  ohmward learn day.csv --battery battery.toml --dry-run
  ohmward learn day.csv --battery battery.toml -o battery.toml --report learn.html
  ohmward learn 'logs/*.csv' --battery battery.toml -o battery.toml --json
  ohmward learn fleet-logs/ --battery type.toml -o batteries/

With a folder as --output every battery gets a file of its own, named by the serial number in its logs.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "logs",
        nargs="+",
        metavar="LOG",
        help="drives, charges, rests, days or weeks of one battery, the oldest first: files, patterns or folders",
    )
    parser.add_argument(
        "--battery",
        required=True,
        metavar="FILE.toml",
        help="file to start from, made by `generic`, `identify` or `learn`",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE.toml",
        help="battery file to write; one that is there is kept as FILE.toml.bak. A folder takes one file for each "
        "serial number",
    )
    parser.add_argument("--dry-run", action="store_true", help="say what would change, and write no battery file")
    group = parser.add_argument_group("the battery")
    add_initial_soc_option(group, "it is known")
    add_sensor_options(group)
    add_log_options(parser)
    add_output_options(parser)
