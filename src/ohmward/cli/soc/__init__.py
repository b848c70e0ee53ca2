"""Arguments of `ohmward soc`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_output_options, add_soc_options

EXAMPLES = """\
  ohmward soc day.csv --battery battery.toml
  ohmward soc day.csv --battery battery.toml --initial-soc 1.0 --filter ukf -o estimates.csv --report soc.html
  ohmward soc day.csv --battery battery.toml --truth soc_true --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    add_soc_options(parser)
    parser.add_argument(
        "--filter",
        default="default",
        metavar="NAME",
        help="ekf, ukf, gsf, rc, textbook-ekf, textbook-ukf, coulomb or ocv (default gsf); as "
        "published: published.aekf, published.aukf, published.hybrid, published.rc-kf",
    )
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv, .parquet or .mcap")
