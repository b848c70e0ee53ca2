"""`ohmward COMMAND ...`: the commands by name, and the exit status of every error."""

from __future__ import annotations

import argparse
import atexit
import difflib
import gc
import inspect
import io
import os
import shlex
import sys
import textwrap
import traceback
import warnings
from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from types import ModuleType

from ohmward import __version__
from ohmward.cli.outcome import Outcome, carry_out, close_output, show
from ohmward.cli.parser import Parser
from ohmward.cli.wording import Detail, styled, width
from ohmward.errors import InputError, OhmwardError

#: Commands grouped by purpose, in the order of the help. `cli.arguments.NAME` adds the arguments of each; `cli.NAME`,
#: loaded once they have been parsed, has `run`. Both are in `ohmward_lab` for those of the laboratory.
GROUPS = {
    "a log or a file, whatever it is": {
        "doctor": "what is in a log and what is wrong with it; what a battery file does not know",
    },
    "a battery": {
        "identify": "from logs of tests to a battery file",
        "learn": "from everyday logs to a battery file that knows more, log by log",
        "generic": "a battery file from chemistry and capacity alone, to start with",
        "soc": "state of charge along a log, with its uncertainty",
        "compare": "all estimators on one log, side by side",
        "health": "capacity and resistance of a battery over months of logs, and when it will be worn out",
    },
    "a robot": {
        "robot": "a robot file from sizes, a URDF or the name of a known robot; what is in one",
        "calibrate": "radius, motors and floors of a robot, from drives whose true motion is known",
        "slip": "speed and wheel slip along a drive, with their uncertainty",
        "mission": "where a drive's energy went, what the ground takes, how far the rest reaches",
    },
    "the process on the robot": {
        "setup": "the setup of `run` from a CAN database, a recording, or what is heard on a bus, a broker or a line",
        "run": "the process on the robot: sensors in, charge, speed, slip, pose and range out",
        "service": "`ohmward run` as a service of systemd, begun with the machine",
        "drive": "drive a robot that `run` controls, by keys or joystick: set speed and slip, see its state, stop",
        "store": "what the process on the robot has stored: list, query, export",
    },
    "a fleet": {
        "fleet": "state of charge of many logs, one row for each; can be resumed",
    },
    "a chip": {
        "export": "a filter or controller as a C99 library for a microcontroller",
        "twin": "a log through an exported C library on this machine: the firmware's own bits",
    },
    "the laboratory": {
        "demo": "a simulated robot, from pulse test to the way home",
        "simulate": "a robot and its battery driven in closed loop on a ground; or a battery alone",
        "assess": "limits of the methods: chemistries, sensors and faults on simulated shifts; which method for which",
        "reproduce": "tables and figures of the two publications, printed numbers beside those found; their errata",
    },
}
COMMANDS = {name: what for group in GROUPS.values() for name, what in group.items()}
#: Commands whose package is in `ohmward_lab`.
OF_THE_LABORATORY = set(GROUPS["the laboratory"])
REFUSED, BUG, INTERRUPTED, BROKEN_PIPE = 2, 70, 130, 141

_EPILOG = """\
a first look:
  ohmward demo                                      a simulated robot, from battery test to the way home
  ohmward simulate --list                           drives of a simulated robot in closed loop

with your own logs (CSV and other text tables, Excel, MATLAB, HDF5, Parquet, BDF, JSON, bags):
  ohmward doctor test.csv                           what is in a log, what was assumed, what is wrong
  ohmward identify test.csv --capacity-ah 12 -o battery.toml
  ohmward learn day.csv --battery battery.toml -o battery.toml
  ohmward soc day.csv --battery battery.toml --report day.html
  ohmward compare day.csv --battery battery.toml    all estimators side by side
  ohmward slip drive.csv --robot robot.toml         speed and wheel slip of a drive
  ohmward mission drive.csv --robot robot.toml --battery battery.toml

exit status: 0 done, 1 a log has errors (doctor) or fits no model (slip), 2 refused: the message says what to
             change, 70 a fault of ohmward itself
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line, by default that of sys.argv; returns the exit status."""
    # NumPy reads this once; the matrices are small: more threads only compete, and `identify` takes ten times as long
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    gc.set_threshold(100_000, 20, 20)  # modules and traces have no garbage, but 100,000 objects to look through for it
    atexit.register(gc.freeze)  # nor does the end of the process need to look through them
    for stream in (sys.stdout, sys.stderr):
        # a terminal that knows no ± gets a question mark, not a traceback
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    with warnings.catch_warnings():
        # on one line, as errors are: its place in the source is of no use on the command line
        warnings.showwarning = lambda message, *_, **__: print(f"ohmward: note: {message}", file=sys.stderr)
        return _status(sys.argv[1:] if argv is None else argv)


def _print_error(text: str) -> None:
    print(f"{styled('ohmward: error:', 'error', sys.stderr)} {text}", file=sys.stderr)


def _status(words: Sequence[str]) -> int:
    """Exit status of a command line, once all its output has been printed."""
    try:
        arguments = parse(words)
        outcome = carry_out(run_of(arguments.command), arguments)
        show(outcome, as_json=getattr(arguments, "json", False), detail=_detail(arguments))
        return outcome.status
    except OhmwardError as error:
        _print_error(str(error))
        if options := getattr(error, "options", ()):
            print(f"ohmward: try: ohmward {shlex.join([*words, *options])}", file=sys.stderr)
        return REFUSED
    except MemoryError as error:
        _print_error(f"out of memory ({error}); cut the log into parts, or free memory")
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        close_output()
        return BROKEN_PIPE
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            _print_error(f"{error.filename}: the system refuses it ({error.strerror}); choose another path")
            return REFUSED
        traceback.print_exc()
        _print_error(
            f"this is a fault of ohmward, not of your input ({type(error).__name__}: {error}); please report the lines "
            "above with the command and, if you can, the file"
        )
        return BUG


def _detail(arguments: argparse.Namespace) -> Detail:
    """Level of detail that -v or -q sets; by default the usual one on a terminal, and everything elsewhere."""
    if getattr(arguments, "verbose", False):
        return "all"
    if getattr(arguments, "quiet", False):
        return "answer"
    return "usual" if sys.stdout.isatty() else "all"


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Arguments of a command line; only the command that was typed is loaded.

    Raises:
        InputError: no such command, or arguments that it does not take.
    """
    top = Parser(
        prog="ohmward",
        description="Charge, wheel slip and range of battery-powered robots, with uncertainties that hold.",
        epilog=f"{_groups()}\n\n{_EPILOG}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    top.add_argument("--version", action="version", version=f"ohmward {__version__}")
    top.add_argument("command", metavar="COMMAND", help="one of those below")
    if not words or words[0] == "help":
        words = [*words[1:], "--help"]
    first = next((k for k, word in enumerate(words) if not word.startswith("-")), len(words))
    name = top.parse_args(words[: first + 1]).command
    _require_known("command", name, COMMANDS, "ohmward")
    add_arguments = getattr(_module("arguments", name), name)
    parser = Parser(
        prog=f"ohmward {name}",
        description=f"{COMMANDS[name][:1].upper()}{COMMANDS[name][1:]}.",
        epilog=_examples(add_arguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add_arguments(parser)
    more = parser.add_argument_group("detail").add_mutually_exclusive_group()
    more.add_argument("-v", "--verbose", action="store_true", help="list everything that was assumed, as in a file")
    more.add_argument("-q", "--quiet", action="store_true", help="print the answer and its warnings alone")
    known = {option for action in parser._actions for option in action.option_strings}
    for k, word in enumerate(words[first + 1 :]):
        if word == "--":
            break
        if not word or (word.startswith("--") and word.endswith("=")):
            before = word[:-1] or words[first + k]
            why = "an unset variable of the shell?"
            raise InputError(f"the argument behind {before!r} is empty ({why}); give a value or leave it out")
        if word.startswith("--"):
            _require_known("option", word.partition("=")[0], known, parser.prog)
    arguments, left = parser.parse_known_args(words[first + 1 :])
    if left:  # as files are that follow an option which follows files
        arguments = parser.parse_intermixed_args(words[first + 1 :])
    return argparse.Namespace(command=name, **vars(arguments))


def _require_known(kind: str, name: str, known: Collection[str], prog: str) -> None:
    """Raise InputError for a command or an option that there is not, with the one that was perhaps meant."""
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        command = "ohmward " if kind == "command" else ""
        advice = f"did you mean `{command}{near[0]}`?" if near else f"see `{prog} --help`"
        raise InputError(f"there is no {kind} {name!r}; {advice}")


def _groups() -> str:
    """The commands and what they do, grouped by purpose."""
    indent = max(map(len, COMMANDS)) + 4
    lines = []
    for title, group in GROUPS.items():
        lines.append(f"{title}:")
        for name, what in group.items():
            text = f"  {name}".ljust(indent) + what
            lines.append(textwrap.fill(text, width(), subsequent_indent=" " * indent))
    return "\n".join(lines)


def _module(of: str, command: str) -> ModuleType:
    """The module `cli.OF` of the package of a command."""
    package = "ohmward_lab" if command in OF_THE_LABORATORY else "ohmward"
    return import_module(f"{package}.cli.{of}")


def _examples(add_arguments: Callable[[argparse.ArgumentParser], None]) -> str:
    """The examples in a docstring, behind its first line, and a remark below them."""
    _, _, below = inspect.cleandoc(add_arguments.__doc__ or "").partition("\n\n")
    examples, space, remark = below.partition("\n\n")
    return f"examples:\n{textwrap.indent(examples, '  ')}{space}{remark}\n"


def run_of(name: str) -> Callable[[argparse.Namespace], Outcome]:
    """`run` of a command, imported by this call."""
    run: Callable[[argparse.Namespace], Outcome] = _module(name, name).run
    return run
