"""Argument parser that raises InputError, and the types of its arguments."""

from __future__ import annotations

import argparse
import math
from typing import NoReturn

from ohmward.errors import InputError

#: Larger than any gain error in a data sheet; a number above it was meant in percent.
LARGEST_GAIN_STD = 0.5


class Parser(argparse.ArgumentParser):
    """Argument parser that raises InputError, as the rest of ohmward does, instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        """Raise the message that argparse would print."""
        raise InputError(f"{message}; see `{self.prog} --help`")


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
    """A number from 0 to 1; a percentage is refused, and the message gives the number that was meant."""
    value = number(text)
    if not 0.0 <= value <= 1.0:
        meant = f"; for {value:g} % write {value / 100:g}" if 1.0 < value <= 100.0 else ""
        raise argparse.ArgumentTypeError(f"must be between 0 and 1, got {text}{meant}")
    return value


def offset_std(text: str) -> float:
    """A standard deviation >= 0."""
    if (value := number(text)) < 0:
        raise argparse.ArgumentTypeError(f"is a standard deviation, >= 0, got {text}")
    return value


def gain_std(text: str) -> float:
    """A share up to `LARGEST_GAIN_STD`; a percentage is refused, and the message gives the number that was meant."""
    value = number(text)
    if not 0.0 <= value <= LARGEST_GAIN_STD:
        meant = f": {value / 100:g} for {value:g} %" if value > 0 else ""
        raise argparse.ArgumentTypeError(f"is a share between 0 and {LARGEST_GAIN_STD:g}{meant}, got {text}")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text!r}")
    return int(text)


def floats(text: str) -> list[float]:
    """Numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers separated by commas, got {text!r}") from None
