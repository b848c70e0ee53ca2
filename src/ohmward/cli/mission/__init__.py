"""Arguments of `ohmward mission`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli import options
from ohmward.cli.parser import number, positive, share

EXAMPLES = """\
  ohmward mission drive.csv --robot robot.toml --battery battery.toml -o table.toml --report drive.html
  ohmward mission day.csv --mass-kg 42 --terrain grass --battery battery.toml --column speed=gnss_speed
  ohmward mission --plan-example > plan.toml
  ohmward mission --plan plan.toml --battery battery.toml --soc 0.6 --soc-std 0.03 --consumption table.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("log", metavar="LOG", nargs="?", help=f"battery and speed or wheels in {options.LOG}")
    parser.add_argument("--battery", metavar="FILE.toml", help="battery file, made by `ohmward identify`")
    parser.add_argument("--plan", metavar="FILE.toml", help="the mission ahead")
    parser.add_argument("--plan-example", action="store_true", help="print a plan with comments, and nothing else")
    robot = parser.add_argument_group("robot and ground")
    robot.add_argument("--robot", metavar="FILE.toml", help=options.ROBOT)
    robot.add_argument("--mass-kg", type=positive, metavar="M", help="where there is no robot file")
    robot.add_argument(
        "--terrain",
        default="ground",
        metavar="NAME",
        help="ground of the log, where it has no column 'terrain' (default: %(default)s)",
    )
    robot.add_argument("--payload-kg", type=number, default=0.0, metavar="M", help="load during the log (default 0)")
    robot.add_argument("--consumption", metavar="FILE.toml", help="what was learned before; default: from the robot")
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the consumption learnt, this log included")
    _add_battery_options(parser)
    options.add_log_options(parser)
    options.add_shaft_options(parser.add_argument_group("reading wheels"))
    options.add_output_options(parser)


def _add_battery_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("battery")
    group.add_argument("--soc", type=share, metavar="S", help="state of charge now; default: estimated from the log")
    group.add_argument("--soc-std", type=positive, default=0.03, metavar="S", help="how sure --soc is (%(default)s)")
    options.add_start_options(group, "at the log's start; default: from the voltage")
    group.add_argument(
        "--filter", default="default", metavar="NAME", help="SoC estimator, see `soc` (default %(default)s)"
    )
    group.add_argument("--reserve-soc", type=share, metavar="S", help="to be left; default: the plan's, else 0.1")
    options.add_sensor_options(group)
    group.add_argument("--cutoff-v", type=positive, metavar="V", help="voltage at which the robot stops")
    group.add_argument(
        "--confidence", type=share, default=0.95, metavar="P", help="of the latest point of return (%(default)s)"
    )
