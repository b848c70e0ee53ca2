"""Arguments of `ohmward run`."""

from __future__ import annotations

import argparse

EXAMPLES = """\
  ohmward run robot.toml
  ohmward run robot.toml > states.jsonl < messages.jsonl
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument("setup", metavar="SETUP.toml", help="sources, estimators and sinks of this robot")
