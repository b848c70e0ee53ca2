"""`ohmward COMMAND ...`: the parser of all commands, and how errors become exit statuses."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence

from ohmward import __version__
from ohmward.cli import export, fleet, generic, twin
from ohmward.cli.calibrate import command as calibrate
from ohmward.cli.compare import command as compare
from ohmward.cli.demo import command as demo
from ohmward.cli.doctor import command as doctor
from ohmward.cli.identify import command as identify
from ohmward.cli.mission import command as mission
from ohmward.cli.outcome import Outcome, check_output, show, write_page
from ohmward.cli.parser import Parser
from ohmward.cli.simulate import command as simulate
from ohmward.cli.slip import command as slip
from ohmward.cli.soc import command as soc
from ohmward.errors import OhmwardError

COMMANDS = (doctor, identify, generic, soc, compare, calibrate, slip, mission, simulate, fleet, export, twin, demo)
REFUSED, INTERRUPTED, BROKEN_PIPE = 2, 130, 141

_EPILOG = """\
a first look:
  ohmward demo                                      a simulated robot, from battery test to the way home
  ohmward simulate --list                           drives of a simulated robot in closed loop

with your own logs (CSV, Parquet or BDF):
  ohmward doctor test.csv                           what is in a log, what was assumed, what is wrong
  ohmward identify test.csv --capacity-ah 12 -o battery.toml
  ohmward soc day.csv --battery battery.toml --report day.html
  ohmward compare day.csv --battery battery.toml    all estimators side by side
  ohmward slip drive.csv --robot robot.toml         speed and wheel slip of a drive
  ohmward mission drive.csv --robot robot.toml --battery battery.toml

exit status: 0 done, 1 a log has errors (doctor), 2 refused: the message says what to change
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line, sys.argv without it; returns the exit status."""
    # read once, by NumPy; small matrices: more threads only fight each other, and `identify` takes ten times as long
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        return _status(argv)


def _show_warning(message: Warning | str, *_where: object, **_more: object) -> None:
    """One line, as errors are: whoever types a command has no use for the place in the source."""
    print(f"ohmward: note: {message}", file=sys.stderr)


def _status(argv: Sequence[str] | None) -> int:
    """The exit status, once all is said."""
    try:
        arguments = build_parser().parse_args(argv)
        outcome = run(arguments)
        show(outcome, as_json=getattr(arguments, "json", False))
        return outcome.status
    except OhmwardError as error:
        print(f"ohmward: error: {error}", file=sys.stderr)
        return REFUSED
    except MemoryError as error:
        print(f"ohmward: error: out of memory ({error}); cut the log into parts, or free memory", file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader has gone: let the interpreter's last flush go nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE


def build_parser() -> Parser:
    """The parser of `ohmward` with all its commands."""
    parser = Parser(
        prog="ohmward",
        description="Charge, wheel slip and range of battery-powered robots, with uncertainties that hold.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"ohmward {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
    return parser


def run(arguments: argparse.Namespace) -> Outcome:
    """Run a parsed command and write its report."""
    report = getattr(arguments, "report", None)
    check_output("--report", report, (".html", ".htm"))
    outcome: Outcome = arguments.run(arguments)
    if report and outcome.page:
        write_page(outcome.page(), report)
    return outcome
