"""Results of a publication beside those of the methods here, and the tables and figures that show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.report import Figure


class Erratum(NamedTuple):
    """An error in the text we worked from."""

    text: str  #: "[T]" or "[P]"
    place: str  #: number of the equation
    printed: str  #: the text as printed
    correct: str  #: the text as it must be
    check: Callable[[], bool]  #: True where the correct form holds and the printed one does not


def differs(printed: float, correct: float, true: float, tolerance: float) -> bool:
    """True where `correct` is the true value within a relative tolerance and `printed` is not, by ten times it."""
    scale = max(abs(true), 1e-300)
    return bool(abs(correct - true) <= tolerance * scale and abs(printed - true) > 10 * tolerance * scale)


class ResultRow(NamedTuple):
    """One number of a table or figure; None where there is none."""

    quantity: str  #: in words
    unit: str  #: of all the numbers
    printed: float | None = None  #: in the publication
    as_printed: float | None = None  #: by its method with its equations as printed
    corrected: float | None = None  #: by its method with the corrected equations
    default: float | None = None  #: by the method that this package chooses
    why: str = ""  #: reason of the difference


class Result(NamedTuple):
    """Rows and figures of an item."""

    rows: tuple[ResultRow, ...]
    figures: tuple[Figure, ...] = ()


class Item(NamedTuple):
    """A table or some figures of a publication that show the same."""

    numbers: tuple[str, ...]  #: as printed, such as "3.2"; any of them selects the item
    title: str  #: in words
    make: Callable[[], Result]  #: computes it


class Errors(NamedTuple):
    """Largest and mean absolute error; nan where the method ended in nan."""

    largest: float
    mean: float


def errors(error: np.ndarray) -> Errors:
    """Errors of a series (T,); nan if one of its samples is nan."""
    size = np.abs(error)
    return Errors(float(size.max()), float(size.mean()))


def error_rows(
    what: str,
    unit: str,
    printed: Errors | None,
    as_printed: Sequence[Errors],
    corrected: Sequence[Errors],
    default: Sequence[Errors],
    why: str = "",
) -> list[ResultRow]:
    """Rows of the largest and of the mean error, means over the runs; the reason is in the first row.

    default: empty where there is none.
    """
    found = [mean_errors(runs) if runs else None for runs in (as_printed, corrected, default)]

    def row(which: str) -> ResultRow:
        p, a, c, d = (getattr(of, which) if of else None for of in (printed, *found))
        return ResultRow(f"{what}: {which}", unit, p, a, c, d)

    return [row("largest")._replace(why=why), row("mean")]


def mean_errors(parts: Sequence[Errors]) -> Errors:
    """The mean over several runs."""
    return Errors(*(float(np.mean(column)) for column in zip(*parts, strict=True)))
