"""Arguments of `ohmward doctor`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_log_options, add_output_options

EXAMPLES = """\
  ohmward doctor test.csv
  ohmward doctor test.csv day.csv --report logs.html
  ohmward doctor battery.toml
  ohmward doctor test.csv --column current=current_A --unit current=A --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a log (any format of docs/logs.md, - for standard input) or a battery file (.toml)",
    )
    add_log_options(parser)
    add_output_options(parser)
