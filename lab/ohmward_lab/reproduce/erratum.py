"""An error in a publication, with a check that computes both what is printed and what it must be."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Erratum(NamedTuple):
    """An error in the text we worked from."""

    text: str  #: "[T]" or "[P]"
    place: str  #: number of the equation
    printed: str  #: what stands there
    correct: str  #: what it must be
    check: Callable[[], bool]  #: True where the correct form holds and the printed one does not


def differs(printed: float, correct: float, true: float, tolerance: float) -> bool:
    """True where `correct` is the true value within a relative tolerance and `printed` is not, by ten times it."""
    scale = max(abs(true), 1e-300)
    return bool(abs(correct - true) <= tolerance * scale and abs(printed - true) > 10 * tolerance * scale)
