"""Arguments of `ohmward identify`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli import options
from ohmward.cli.parser import count, number, positive

EXAMPLES = """\
  ohmward identify test.csv --capacity-ah 12 -o battery.toml
  ohmward identify test.csv --capacity-ah 12 --chemistry lfp --n-series 4 --report identify.html -o battery.toml
  ohmward identify test.csv --capacity-ah 12 --model thevenin-1rc --initial-soc test=1.0 --json
  ohmward identify day.csv --capacity-ah 12 --n-series 3 --ocv ocv.csv --initial-soc 0.9 -o battery.toml
  ohmward identify test.csv day.csv --capacity-ah 12 --chemistry nmc --n-series 3 --initial-soc day=0.9 -o battery.toml

A file that holds several recordings may be named several times: ocv.parquet:script=1,temp_C=25
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="pulse tests, low-rate tests, drives of one battery")
    _add_battery_options(parser.add_argument_group("the battery"))
    options.add_log_options(parser)
    options.add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the battery file")


def _add_battery_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--capacity-ah", type=positive, required=True, metavar="Q", help="charge between full and empty [Ah]"
    )
    group.add_argument(
        "--model",
        default="thevenin",
        metavar="NAME",
        help="thevenin, its number of RC pairs chosen by evidence, or thevenin-0rc to thevenin-3rc, or rc (default "
        "%(default)s)",
    )
    group.add_argument("--chemistry", default="", metavar="NAME", help=options.CHEMISTRY)
    group.add_argument("--n-series", type=count, default=1, metavar="N", help="cells in series (default 1)")
    group.add_argument("--name", default="", help="what to call the battery; default: the first log's name")
    options.add_initial_soc_option(group, "they do not show it")
    group.add_argument(
        "--ocv",
        metavar="FILE",
        help="table of the open-circuit voltage that you have, of a cell or of the pack: columns soc (0 to 1 or "
        "percent) and ocv_V, or ocv_charge_V and ocv_discharge_V; optional dV/dT; no low-rate test is needed then",
    )
    group.add_argument(
        "--idle-current",
        type=number,
        metavar="A",
        help="what flows at every rest, <= 0: 0 in a laboratory, -0.7 on a robot that draws 0.7 A; goes into the "
        "battery file, and then each rest shows the current sensor's offset (default: not declared)",
    )
    options.add_sensor_options(group, "2.5 %% of 1 C", "1 %%")
