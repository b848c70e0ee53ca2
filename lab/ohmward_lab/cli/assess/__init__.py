"""Arguments of `ohmward assess`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options
from ohmward.cli.parser import count, positive
from ohmward_lab.assess import LARGEST_RMSE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward assess`.

    ohmward assess --report limits.html
    ohmward assess --only lfp --only "current offset" --runs 50
    ohmward assess --only ekf --only default --json
    ohmward assess traction --report limits.html
    ohmward assess traction --only rlma --only "patches of ice" --largest-error 5
    """
    parser.add_argument(
        "study",
        nargs="?",
        default="battery",
        choices=("battery", "traction"),
        help="battery: methods for its charge, the default; traction: observers of speed and slip",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="WORD",
        help="this chemistry or robot, factor of the conditions or method; may be given again; a wrong one is answered "
        "by all",
    )
    parser.add_argument(
        "--runs",
        type=count,
        default=12,
        metavar="N",
        help="shifts of eight hours, or drives of two minutes, for each cell (default %(default)s)",
    )
    parser.add_argument(
        "--seed", type=count, default=1, metavar="N", help="another one draws other runs (default %(default)s)"
    )
    parser.add_argument(
        "--largest-error",
        type=positive,
        default=100.0 * LARGEST_RMSE,
        metavar="ERROR",
        help="largest RMSE of a method that is recommended: points of charge, or cm/s (default %(default)g)",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        help="folder for summary.csv and what is done so far: the same command goes on there; default: "
        "ohmward-assess/STUDY",
    )
    parser.add_argument("--processes", type=count, metavar="N", help="side by side; default: one for each processor")
    add_output_options(parser)
