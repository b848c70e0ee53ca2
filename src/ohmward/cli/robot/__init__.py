"""Arguments of `ohmward robot`; `command` carries it out."""

from __future__ import annotations

import argparse

from ohmward.cli.options import add_drive_options, add_truth_options
from ohmward.cli.parser import positive

EXAMPLES = """\
  ohmward robot --radius 0.06 --track 0.3 --mass 12 -o robot.toml
  ohmward robot --layout mecanum --radius 0.05 --track 0.3 --wheelbase 0.25 --mass 9 -o robot.toml
  ohmward robot --layout tricycle --radius 0.12 --track 0.6 --wheelbase 1.1 --mass 200 -o robot.toml
  ohmward robot drive.mcap --topic /odom --mass 12 -o robot.toml
  ohmward robot drive.csv --truth gnss_speed --layout car --track 0.6 --mass 40 -o robot.toml
  ohmward robot robot.urdf -o robot.toml
  ohmward robot husky -o robot.toml
  ohmward robot robot.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "source",
        nargs="?",
        metavar="FILE|NAME",
        help="a URDF, a robot file, a robot that comes with ohmward: turtlebot4, husky, jackal ..., or a drive, which "
        "shows radius and track beside a speed or pose from outside (/odom, GNSS) and a gyro; none: sizes",
    )
    parser.add_argument("--radius", type=positive, metavar="M", help="radius of the wheels [m]")
    parser.add_argument(
        "--track", type=positive, metavar="M", help="between left and right wheels, or across the circle of omni-wheels"
    )
    parser.add_argument(
        "--wheelbase", type=positive, metavar="M", help="between the axles, or from axle to caster; default: the track"
    )
    parser.add_argument("--mass", type=positive, metavar="KG", help="of the robot with its load [kg]")
    parser.add_argument("--gear", type=positive, default=1.0, metavar="N", help="turns of a motor for one of its wheel")
    parser.add_argument(
        "--layout",
        default="two-wheel",
        metavar="NAME",
        help="two-wheel: two driven wheels and a caster (default), also for a car with encoders at both rear wheels; "
        "skid-steer: four driven wheels or tracks; car: one speed, of its motor, and a steering angle; tricycle: its "
        "front wheel is driven and steered; mecanum: four wheels with rollers at 45 degrees; omni: three omni-wheels",
    )
    parser.add_argument("--name", metavar="TEXT", help="what to call the robot")
    add_truth_options(parser)
    add_drive_options(parser)
    parser.add_argument("-o", "--output", metavar="FILE.toml", help="write the robot file; else it is only shown")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
