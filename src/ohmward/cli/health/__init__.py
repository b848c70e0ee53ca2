"""Arguments of `ohmward health`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_log_options, add_output_options, add_sensor_options
from ohmward.cli.parser import positive, share

EXAMPLES = """\
  ohmward health logs/ --battery battery.toml
  ohmward health logs/ --battery battery.toml --report health.html
  ohmward health 2024-*.csv 2025-*.csv --battery new.toml --worn 0.7 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs of one battery, or folders of them, in any order")
    group = parser.add_argument_group("the battery")
    group.add_argument(
        "--battery",
        required=True,
        metavar="FILE.toml",
        help="battery file of the battery when new: of `ohmward identify`, or of `ohmward generic`; it stays as it is",
    )
    group.add_argument(
        "--new-capacity-ah",
        type=positive,
        metavar="Q",
        help="capacity when new that all is measured against [Ah]; default: the battery file's",
    )
    group.add_argument(
        "--worn",
        type=share,
        default=0.8,
        metavar="SHARE",
        help="share of the capacity when new at which the battery is worn out (default %(default)s)",
    )
    add_sensor_options(group)
    add_log_options(parser)
    add_output_options(parser)
