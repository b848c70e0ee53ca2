"""Exceptions of ohmward, in one family, so that a caller can catch them all."""

from __future__ import annotations

from collections.abc import Sequence


class OhmwardError(Exception):
    """Base of every error that ohmward raises on purpose.

    >>> try:
    ...     ow.read_log("none.csv")
    ... except ow.OhmwardError:
    ...     print("not read")
    not read
    """


class InputError(OhmwardError):
    """Invalid input from the caller or a file; the message names the item, the rule, the value and the fix.

    >>> try:
    ...     ow.read_log("none.csv")
    ... except ow.InputError as error:
    ...     print(error)
    none.csv: there is no such file; check the path

    The command line prints the message and ends with status 2.

    options: command-line options that solve the problem, where they are known.
    """

    def __init__(self, text: str = "", options: Sequence[str] = ()) -> None:
        super().__init__(text)
        self.options = tuple(options)
