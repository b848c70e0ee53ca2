"""What the parsers of all commands share: argument types, the options of logs, examples in the help."""

from __future__ import annotations

import argparse
import math
from typing import NoReturn

from ohmward.errors import InputError


class Parser(argparse.ArgumentParser):
    """A parser that refuses as every other part of ohmward does, instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        """Raise what argparse would print."""
        raise InputError(f"{message}; see `{self.prog} --help`")


def add_command(commands: argparse._SubParsersAction, name: str, what: str, examples: str) -> Parser:
    """A subcommand with its one-line description and examples that can be pasted."""
    return commands.add_parser(
        name,
        help=what,
        description=f"{what[:1].upper()}{what[1:]}.",
        epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """How to read the logs, the same for every command."""
    group = parser.add_argument_group("reading logs (CSV, Parquet, BDF)")
    group.add_argument(
        "--current-sign",
        choices=("auto", "charge", "discharge"),
        default="auto",
        help="what a positive current in the file does to the battery; auto tells it from the voltage (default)",
    )
    for option, metavar, what in (
        ("--column", "KIND=NAME", "the column of time, current, voltage or temperature"),
        ("--unit", "KIND=UNIT", "its unit, where the name is silent or wrong: current=mA"),
        ("--where", "NAME=VALUE", "only the rows with this value, where a file holds several recordings"),
    ):
        text = f"{what}; may be repeated"
        group.add_argument(option, metavar=metavar, type=pair, action="append", default=[], help=text)
    group.add_argument("--sort-time", action="store_true", help="sort rows that are out of order")


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """What to do with the result, the same for every command."""
    group = parser.add_argument_group("results")
    group.add_argument("--json", action="store_true", help="print one JSON object on standard output and nothing else")
    group.add_argument("--report", metavar="FILE.html", help="write a page with plots, one file that needs no network")


def pair(text: str) -> tuple[str, str]:
    """`KIND=NAME` as its two parts; the name may contain further equals signs."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text!r}")
    return name, value


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text!r}")
    return value


def positive(text: str) -> float:
    """A finite number above zero."""
    if (value := number(text)) <= 0:
        raise argparse.ArgumentTypeError(f"must be above 0, got {text}")
    return value


def share(text: str) -> float:
    """A number from 0 to 1; a percentage is refused with the number that was meant."""
    value = number(text)
    if not 0.0 <= value <= 1.0:
        meant = f"; for {value:g} % write {value / 100:g}" if 1.0 < value <= 100.0 else ""
        raise argparse.ArgumentTypeError(f"must be between 0 and 1, got {text}{meant}")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text!r}")
    return int(text)
