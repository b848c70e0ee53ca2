"""Arguments of `ohmward slip`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import DEFAULT_TERRAIN, LOG, ROBOT, TRUTHS, add_drive_options, add_output_options

EXAMPLES = """\
  ohmward slip drive.csv --robot robot.toml
  ohmward slip drive.csv --robot rlma --terrain gravel --truth speed_true_m_s --json
  ohmward slip drive.csv --robot robot.toml -o slip.csv --report slip.html
  ohmward slip gray.parquet --robot robotino --where exp=5 --motor-shaft
  ohmward slip gray.parquet --robot robot.toml --floors floors.toml --where exp=5 --motor-shaft
  ohmward slip gray.parquet --robot robot.toml --floors floors.toml --floor gray --where exp=5 --motor-shaft
  ohmward slip husky.csv --robot husky.toml --unit wheel_speed=m/s --column yaw_rate=gyro_up
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("log", metavar="LOG", help=LOG)
    group = parser.add_argument_group("robot and ground")
    group.add_argument("--robot", required=True, metavar="FILE.toml", help=ROBOT)
    group.add_argument(
        "--terrain",
        default=DEFAULT_TERRAIN,
        metavar="NAME",
        help="ground that is assumed at first, 'gravel' or 'soft soil' for example (default: %(default)s)",
    )
    group = parser.add_argument_group("estimation")
    group.add_argument("--filter", default="ukf", metavar="NAME", help="ekf, aekf, ukf or aukf (default %(default)s)")
    group.add_argument(
        "--floors", metavar="FILE.toml", help="floors that `ohmward calibrate` has learnt: slip by motor currents alone"
    )
    group.add_argument(
        "--floor",
        action="append",
        default=[],
        metavar="NAME",
        help="floor of --floors that the robot drives on; repeat for several; otherwise it is recognised",
    )
    group.add_argument(
        "--truth", metavar="COLUMN[,...]", help=f"references in the log to compare with: {', '.join(TRUTHS)}"
    )
    add_drive_options(parser)
    add_output_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the estimates: .csv, .parquet or .mcap")
