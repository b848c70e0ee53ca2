"""Arguments of `ohmward reproduce`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_log_options, add_output_options
from ohmward.cli.parser import share

#: Publications, and the list of their errors, repeated from `ohmward_lab.reproduce` so that the help needs no NumPy.
SUBJECTS = ("thesis", "paper", "errata")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward reproduce`.

    ohmward reproduce paper --report paper.html
    ohmward reproduce thesis --only 3.2
    ohmward reproduce thesis --json
    ohmward reproduce thesis --only measured --log day.csv --battery battery.toml --initial-soc 0.9
    ohmward reproduce thesis --only nmc --data ~/battery-data
    ohmward reproduce errata
    """
    parser.add_argument(
        "subject",
        choices=SUBJECTS,
        metavar="{thesis,paper,errata}",
        help="Partovibakhsh 2015, or Monsalve and others 2023, or the errors of both, each with its check",
    )
    parser.add_argument(
        "--only", action="append", metavar="N", help="this table or figure, such as 3.2; may be given again"
    )
    group = parser.add_argument_group("the filters of the thesis along a measured log too")
    group.add_argument("--log", metavar="LOG", help="a log, or rows of a file: cells.parquet:cell=nmc,test=drive")
    group.add_argument("--battery", metavar="FILE.toml", help="its battery file, made by `ohmward identify`")
    group.add_argument("--initial-soc", type=share, metavar="S", help="state of charge at the start of the log, 0 to 1")
    group.add_argument(
        "--data",
        metavar="FOLDER",
        help="folder of measured data that holds tue_cells: an NMC cell too; default: OHMWARD_DATA, if it is set",
    )
    add_log_options(parser)
    add_output_options(parser)
