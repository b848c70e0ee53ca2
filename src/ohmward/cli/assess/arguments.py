"""Arguments of `ohmward assess`."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options
from ohmward.cli.parser import count

EXAMPLES = """\
  ohmward assess --report limits.html
  ohmward assess --only lfp --only "current offset" --runs 50
  ohmward assess --only ekf --only default --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="WORD",
        help="this chemistry, factor of the conditions or method; may be given again; a wrong one is answered by all",
    )
    parser.add_argument(
        "--runs", type=count, default=12, metavar="N", help="shifts of eight hours for each cell (default %(default)s)"
    )
    parser.add_argument(
        "--seed", type=count, default=1, metavar="N", help="another one draws other shifts (default %(default)s)"
    )
    parser.add_argument(
        "-o",
        "--output",
        default="ohmward-assess",
        metavar="DIR",
        help="folder for summary.csv and what is done so far: the same command goes on there (default %(default)s)",
    )
    parser.add_argument("--processes", type=count, metavar="N", help="side by side; default: one for each processor")
    add_output_options(parser)
