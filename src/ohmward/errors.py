"""Exceptions of ohmward, one family, so that a caller can catch them all."""

from __future__ import annotations

from collections.abc import Sequence


class OhmwardError(Exception):
    """Base of every error that ohmward raises on purpose."""


class InputError(OhmwardError):
    """Bad input of the caller or a file; the message names the thing, the rule, the value and the fix.

    The command line prints the message and ends with status 2.

    options: words to add to the command line that mend it, where they are known.
    """

    def __init__(self, text: str = "", options: Sequence[str] = ()) -> None:
        super().__init__(text)
        self.options = tuple(options)
