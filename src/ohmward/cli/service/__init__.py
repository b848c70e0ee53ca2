"""Arguments of `ohmward service`; `command` carries it out."""

from __future__ import annotations

import argparse

EXAMPLES = """\
  ohmward service install --print                   the unit of systemd, to look at
  sudo ohmward service install                      for /etc/ohmward/robot.toml
  sudo ohmward service install /etc/ohmward/other.toml --replace
"""

#: The setup that a service runs by default.
SETUP = "/etc/ohmward/robot.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("action", choices=("install",), help="write the unit into /etc/systemd/system")
    parser.add_argument(
        "setup", nargs="?", default=SETUP, metavar="SETUP.toml", help="of `ohmward run`; by default %(default)s"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--print", action="store_true", help="print the unit and write nothing")
    what.add_argument(
        "--replace", action="store_true", help="replace a unit that is there; it stays beside it, .before"
    )
