"""Arguments of the commands of the laboratory, as `ohmward.cli.arguments` has them of the others."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_log_options, add_output_options
from ohmward.cli.parser import count, number, positive, share
from ohmward_lab.assess import LARGEST_RMSE


def demo(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward demo`.

    ohmward demo
    ohmward demo --out my-demo --seed 7
    """
    parser.add_argument("--out", default="ohmward-demo", metavar="FOLDER", help="default: %(default)s")
    parser.add_argument("--seed", type=count, default=1, metavar="N", help="another seed, another day (default 1)")


#: Records and models of a cell, repeated from `simulate.electrochemical` so that the help needs no NumPy.
RECORDS, MODELS = ("pulse-test", "low-rate-test", "day"), ("SPMe", "DFN", "lead-acid")

#: Options that apply to a cell only, not to a robot.
OF_CELLS = ("record", "model", "n_series", "ambient_degc", "aged_to", "resistance")


def simulate(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ohmward simulate`.

    ohmward simulate --list
    ohmward simulate onto-ice --report onto-ice.html
    ohmward simulate --example > my.toml
    ohmward simulate my.toml -o drive.parquet --report drive.html
    ohmward slip drive.parquet --robot rlma --truth speed_true_m_s
    ohmward simulate --cell Prada2013 --record pulse-test -o test.csv
    ohmward simulate --cell Prada2013 --record day --ambient-degc -10 --aged-to 0.8 -o day.csv
    """
    parser.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="a scenario file (.toml), or the name of one of --list"
    )
    parser.add_argument("--list", action="store_true", help="what scenarios come with ohmward")
    parser.add_argument("--example", action="store_true", help="print a commented scenario file with every key")
    parser.add_argument("--seed", type=count, metavar="N", help="another seed than the file's: other noise")
    _add_cell_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the log: .csv, .parquet or .mcap")


def _add_cell_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "a battery alone: cells of porous electrodes, simulated with PyBaMM, a package of its own"
    )
    group.add_argument(
        "--cell", metavar="SET", help="PyBaMM's name of its parameters: Prada2013, ORegan2022, Sulzer2019, ..."
    )
    group.add_argument("--record", choices=RECORDS, help="what to record, from full (default: day)")
    group.add_argument("--model", choices=MODELS, help="default: SPMe, which is quick; lead-acid for its set")
    group.add_argument("--n-series", type=count, metavar="N", help="cells in series (default: 1)")
    group.add_argument("--ambient-degc", type=number, metavar="T", help="ambient temperature (default: 25)")
    group.add_argument(
        "--aged-to", type=share, metavar="S", help="share of its capacity that is left: 0.8 (default: 1)"
    )
    group.add_argument("--resistance", type=positive, metavar="R", help="its resistance over a new one's (default: 1)")


def assess(parser: argparse.ArgumentParser) -> None:
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


#: Publications, and the list of their errors, repeated from `ohmward_lab.reproduce` so that the help needs no NumPy.
SUBJECTS = ("thesis", "paper", "errata")


def reproduce(parser: argparse.ArgumentParser) -> None:
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
