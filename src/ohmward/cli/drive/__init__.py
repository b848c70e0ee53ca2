"""Arguments of `ohmward drive`; `command` carries it out."""

from __future__ import annotations

import argparse

EXAMPLES = """\
  ohmward drive                                      the robot on this machine, by keys
  ohmward drive robot.local:4720 --token DRIVE_TOKEN
  ohmward drive robot.local:4720 --token file:token --joystick /dev/input/js0
  ohmward drive --stop                               safe stop, whoever drives
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "robot", nargs="?", default="127.0.0.1:4720", metavar="HOST:PORT", help="of its control sink's operator"
    )
    parser.add_argument(
        "--token", metavar="WHERE", help="where the token is: name of an environment variable, or file:PATH of mode 600"
    )
    parser.add_argument("--joystick", metavar="DEVICE", help="of a joystick or gamepad: /dev/input/js0")
    parser.add_argument("--stop", action="store_true", help="stop the robot and end")
    parser.add_argument("--json", action="store_true", help="print how it ended as JSON")
