"""Arguments of `ohmward run`; `command` carries it out."""

from __future__ import annotations

import argparse

#: Formats of the log.
TEXT, JSON = "text", "json"

EXAMPLES = """\
  ohmward run --demo                                a simulated robot, with nothing attached
  ohmward run --demo --drive                        the same, driven by `ohmward drive` in another terminal
  ohmward run --example > robot.toml                a setup to edit
  ohmward run --check robot.toml                    is everything there, and wired as it should be?
  ohmward run robot.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument(
        "setup", nargs="?", metavar="SETUP.toml", help="battery, robot, sources and sinks; --example prints one"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--demo", action="store_true", help="run a simulated robot in real time, and show it")
    what.add_argument("--example", action="store_true", help="print a setup with comments, to edit")
    what.add_argument(
        "--check",
        action="store_true",
        help="listen for 10 s (or --seconds) and check every signal, its unit and its sign; drive a little meanwhile",
    )
    parser.add_argument(
        "--drive",
        action="store_true",
        help="with --demo: it waits for an operator, `ohmward drive` in another terminal",
    )
    parser.add_argument("--seconds", type=float, metavar="S", help="end after so long")
    parser.add_argument("--json", action="store_true", help="with --check: print the findings as JSON")
    parser.add_argument(
        "--log-format",
        choices=(TEXT, JSON),
        default=TEXT,
        help="of the log on standard error: lines for people, or a JSON object a line",
    )
