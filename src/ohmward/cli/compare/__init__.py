"""Arguments of `ohmward compare`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options, add_soc_options

EXAMPLES = """\
  ohmward compare day.csv --battery battery.toml
  ohmward compare day.csv --battery battery.toml --truth soc_true --report compare.html
  ohmward compare day.csv --battery battery.toml --truth soc_true --filters coulomb,ekf,ukf --initial-soc 0.8 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    add_soc_options(parser)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--filters", metavar="A,B,...", help="only these; default: all that the battery file allows")
    which.add_argument("--published", action="store_true", help="with those that reproduce a publication")
    add_output_options(parser)
