"""Arguments of `ohmward simulate`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options
from ohmward.cli.parser import count, number, positive, share

#: Records and models of a cell, repeated from `simulate.electrochemical` so that the help needs no NumPy.
RECORDS, MODELS = ("pulse-test", "low-rate-test", "day"), ("SPMe", "DFN", "lead-acid")

#: Options that apply to a cell only, not to a robot.
OF_CELLS = ("record", "model", "n_series", "ambient_degc", "aged_to", "resistance")


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
