"""Arguments of `ohmward simulate`."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options
from ohmward.cli.parser import count

EXAMPLES = """\
  ohmward simulate --list
  ohmward simulate onto-ice --report onto-ice.html
  ohmward simulate --example > my.toml
  ohmward simulate my.toml -o drive.parquet --report drive.html
  ohmward slip drive.parquet --robot rlma --truth speed_true_m_s
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="a scenario file (.toml), or the name of one of --list"
    )
    parser.add_argument("--list", action="store_true", help="what scenarios come with ohmward")
    parser.add_argument("--example", action="store_true", help="print a commented scenario file with every key")
    parser.add_argument("--seed", type=count, metavar="N", help="another seed than the file's: other noise")
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the log of the drive: .csv or .parquet")
