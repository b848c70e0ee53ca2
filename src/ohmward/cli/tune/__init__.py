"""Arguments of `ohmward tune`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_initial_soc_option, add_log_options, add_output_options, add_sensor_options

EXAMPLES = """\
  ohmward tune day.csv --battery battery.toml
  ohmward tune 'logs/*.csv' --battery battery.toml -o tuned.toml --report tune.html
  ohmward tune monday.csv tuesday.csv --battery battery.toml --initial-soc monday=1.0 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "logs", nargs="+", metavar="LOG", help="days of one battery, six hours at least: files, patterns or folders"
    )
    parser.add_argument("--battery", required=True, metavar="FILE.toml", help="battery file whose noise is wanted")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE.toml",
        help="battery file to write with the tuned noise; one that is there is kept as FILE.toml.bak",
    )
    group = parser.add_argument_group("the battery")
    add_initial_soc_option(group, "it is known")
    add_sensor_options(group)
    add_log_options(parser)
    add_output_options(parser)
