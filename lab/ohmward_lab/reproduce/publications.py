"""The two publications, and the selection of their tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from ohmward.errors import InputError
from ohmward_lab.reproduce import paper, thesis_battery, thesis_cases, thesis_observer
from ohmward_lab.reproduce.row import Item


class Publication(NamedTuple):
    """A publication."""

    short: str  #: as the documentation cites it
    title: str  #: with author and year
    items: tuple[Item, ...]  #: its tables and figures with results, in its order


#: Chapters 3 to 5.
_THESIS = (
    Item(
        ("3.1", "3.6", "3.7", "3.8", "3.9"), "Offline and updated model, parameters", thesis_battery.offline_and_updated
    ),
    Item(("3.2", "3.11", "3.12"), "Voltage by EKF, AEKF, UKF and AUKF", thesis_battery.voltage_by_method),
    Item(("3.3", "3.10", "3.13", "3.14", "3.15"), "State of charge, 98 to 90 %", thesis_battery.soc_by_method),
    Item(("3.3-whole",), "State of charge over the whole range", thesis_battery.whole_range),
    Item(tuple(f"4.{k}" for k in range(7, 17)), "Observer of speed, slip and yaw rate", thesis_observer.observers),
    Item(("5.6", "5.7"), "Case I: braking on the slippery floor", thesis_cases.case_1),
    Item(("5.8", "5.9"), "Case II: from the normal to the slippery floor", thesis_cases.case_2),
)
_PAPER = (
    Item(("3", "2.2"), "Pulse test, the 75 % rule, C_s from the first 500 ms", paper.pulse_test),
    Item(("5", "6"), "Relaxations with one and with two time constants", paper.relaxations),
    Item(("7",), "The circuit before and after the nonlinear fit", paper.fit),
    Item(("8",), "Open-circuit voltage", paper.open_circuit),
    Item(("10", "11"), "Sealed lead-acid, 100 to 60 %", partial(paper.discharge, "lead-acid")),
    Item(("12",), "A wrong start taken as given", paper.wrong_start),
    Item(("13",), "LFP, 100 to 20 %", partial(paper.discharge, "lfp")),
    Item(("section 5",), "The methods compared, with the hybrid", paper.comparison),
)

PUBLICATIONS = {
    "thesis": Publication("[T]", "[T] Partovibakhsh 2015", _THESIS),
    "paper": Publication("[P]", "[P] Monsalve and others 2023", _PAPER),
}


def label(item: Item) -> str:
    """All numbers of an item."""
    return ", ".join(item.numbers)


def select(publication: Publication, only: Sequence[str] = ()) -> tuple[Item, ...]:
    """Items that carry one of these numbers; all where none is given.

    Raises:
        InputError: a number that no item carries.
    """
    known = [number for item in publication.items for number in item.numbers]
    for number in only:
        if number not in known:
            raise InputError(f"--only must be one of {', '.join(known)} for {publication.short}, got {number!r}")
    return tuple(item for item in publication.items if not only or set(only) & set(item.numbers))
