"""The two publications, and the choice of their tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward_lab.reproduce import paper, thesis
from ohmward_lab.reproduce.row import Item, Result


class Publication(NamedTuple):
    """A publication."""

    short: str  #: as the documentation cites it
    title: str  #: with author and year
    items: tuple[Item, ...]  #: its tables and figures with results, in its order


class Reproduced(NamedTuple):
    """An item and its result."""

    item: Item
    result: Result


PUBLICATIONS = {
    "thesis": Publication("[T]", "[T] Partovibakhsh 2015", thesis.ITEMS),
    "paper": Publication("[P]", "[P] Monsalve and others 2023", paper.ITEMS),
}


def label(item: Item) -> str:
    """All numbers of an item."""
    return ", ".join(item.numbers)


def select(publication: Publication, only: Sequence[str] = ()) -> tuple[Item, ...]:
    """Items that carry one of these numbers; all where none is given.

    Raises:
        InputError: a number that none carries.
    """
    known = [number for item in publication.items for number in item.numbers]
    for number in only:
        if number not in known:
            raise InputError(f"--only must be one of {', '.join(known)} for {publication.short}, got {number!r}")
    return tuple(item for item in publication.items if not only or set(only) & set(item.numbers))
