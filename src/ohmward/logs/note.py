"""Notes on a recording: everything that was assumed, converted, dropped or found on the way to it."""

from __future__ import annotations

from typing import NamedTuple


class Note(NamedTuple):
    """One thing that was assumed, converted, dropped or found; `level` is "info" or "warning"."""

    text: str
    level: str = "info"
    options: tuple[str, ...] = ()  #: words of a command line that mend it, if it is a fault

    def __str__(self) -> str:
        return f"{self.level}: {self.text}"


def counted(count: int, noun: str) -> str:
    """A count with its noun for a message: "1 row", "2 rows"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
