"""Arguments of `ohmward calibrate`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import LOG, ROBOT, add_drive_options, add_output_options, add_truth_options
from ohmward.cli.parser import floats

EXAMPLES = """\
  ohmward calibrate drive.csv --robot start.toml --truth speed_true_m_s -o robot.toml
  ohmward calibrate table.parquet --each exp --robot robotino --motor-shaft --pose xpos,ypos,ang \\
      --pose-scale 1.84046e-3,-1.83716e-3 --pose-turn 91.4 --wheel-load 30.4,49.5,30.3 -o robot.toml
  ohmward calibrate carpet.csv --robot robot.toml --truth gnss_speed --floor carpet --floors floors.toml
  ohmward slip day.csv --robot robot.toml --floors floors.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help=f"drives on one floor: each {LOG}")
    group = parser.add_argument_group("robot and floor")
    group.add_argument("--robot", required=True, metavar="FILE.toml", help=f"what is known before: {ROBOT}")
    group.add_argument("--what", metavar="LIST", help="of radius,track,motor (default: all shown, none with --floor)")
    group.add_argument("--floor", metavar="NAME", help="learn the floor of these drives; the robot must be calibrated")
    group.add_argument("--floors", metavar="FILE.toml", help="where the floor goes, beside those that it has")
    group.add_argument(
        "--rolling", type=floats, metavar="C[,STD]", help="rolling resistance of the floor over the load"
    )
    group.add_argument("--wheel-load", type=floats, metavar="N,N,...", help="load of each wheel as weighed [N]")
    add_truth_options(parser)
    parser.add_argument("--each", metavar="COLUMN", help="every value of this column is a recording of its own")
    add_drive_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the robot file")
