"""Cells of a text table: numbers with units, marks between thousands, a decimal comma; dates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.logs.table import MISSING, number
from ohmward.logs.units import Unit, unit_of

#: Spaces between thousands (those that break no line), and the apostrophe of Switzerland.
_SPACES = "\u00a0\u202f\u2009"
_BETWEEN = f"[{_SPACES}'’ ]"
_SIGNS = str.maketrans({"\u2212": "-", "\uff0d": "-", "\u2013": "-"})
_DIGITS = rf"\d+(?:(?<=\d){_BETWEEN}\d{{3}})*"
#: A number, then perhaps its unit.
_MEASURED = re.compile(
    rf"^\s*(?P<number>[-+]?(?:{_DIGITS}(?:[.,]\d*)*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s.,;:/-][^\d\s:]*(?:/\w+)?)?\s*$"
)
_TIME_OF_DAY = r"\d{1,2}:\d\d(?::\d\d(?:[.,:]\d+)?)?(?:\s*[AaPp]\.?[Mm]\.?)?"
_DATE_MARKS = r"\d{1,4}\s*[-/.年]\s*(?:\d{1,2}|[A-Za-z]{3,9})\s*[-/.月]\s*\d{1,4}日?|\d{4}-\d{3}"
_MONTH = r"\b(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*\b"
_TIME = re.compile(rf"{_TIME_OF_DAY}|{_DATE_MARKS}|{_MONTH}.*\d{{4}}|^\s*\d{{8}}T?\d{{6}}|^P(?:\d|T)", re.IGNORECASE)
#: Marks between cells that no date and no number holds.
_MARKS = re.compile(r"[;|\t]")
_GROUPS_OF_THREE = re.compile(r"^[-+]?[1-9]\d{0,2}(?:,\d{3})+(?P<fraction>\.\d+)?$")
_COMMA = re.compile(r"^[-+]?\d*,\d+(?:[eE][-+]?\d+)?$")


class Marks(NamedTuple):
    """Notation of numbers: a comma before decimals; marks between thousands."""

    decimal_comma: bool = False
    thousands: str = ""


def is_value(cell: str) -> bool:
    """True for a number, a measured quantity, a date, a duration; not for an empty cell."""
    cell = cell.strip()
    if not cell or _MARKS.search(cell):
        return False
    try:
        float(cell)
    except ValueError:
        known = cell.lower() in MISSING or _TIME.search(cell) is not None
        return known or _MEASURED.match(cell.translate(_SIGNS)) is not None
    return True


def unit_in_cells(cells: Iterable[str]) -> Unit | None:
    """The unit behind the first number that has one, where all cells are numbers; None for none."""
    first = None
    for cell in cells:
        if cell.strip().lower() in MISSING:
            continue
        found = _MEASURED.match(cell.translate(_SIGNS))
        if found is None:
            return None
        if first is None and found["unit"]:
            first = unit_of(found["unit"])
    return first


def find_marks(columns: Sequence[Sequence[str]], delimiter: str) -> Marks | None:
    """The notation of the numbers in columns of cells; None where a comma may be either mark."""
    comma = [
        [cell for cell in map(_bare, cells) if "," in cell and (_COMMA.match(cell) or _GROUPS_OF_THREE.match(cell))]
        for cells in columns
    ]
    cells_with = [cell for cells in comma for cell in cells]
    if not cells_with:
        return Marks()
    groups = [_GROUPS_OF_THREE.match(cell) for cell in cells_with]
    if all(groups):
        plain = any(
            found and (found["fraction"] or cell.count(",") > 1) for found, cell in zip(groups, cells_with, strict=True)
        )
        # whole numbers below a thousand in the column of numbers with groups of three digits
        beside = [cell for cells, found in zip(columns, comma, strict=True) if found for cell in cells]
        if plain or any(re.fullmatch(r"[-+]?\d{1,3}", _bare(cell)) for cell in beside):
            return Marks(thousands=",")
        return None if delimiter == "," else Marks(decimal_comma=True)
    return Marks(decimal_comma=True)


def parse_cells(cells: Sequence[str], marks: Marks, unit: Unit | None = None) -> np.ndarray:
    """(T,) float64 where every cell is a number, perhaps with a unit, or missing; else the text as dtype object.

    unit: of the column; cells in another one of its dimension are converted.
    """
    if not marks.thousands:
        numbers = [cell.replace(",", ".") for cell in cells] if marks.decimal_comma else cells
        for read in (float, number):
            try:
                return np.fromiter(map(read, numbers), float, len(numbers))
            except ValueError:
                pass
    values = np.empty(len(cells))
    for row, cell in enumerate(cells):
        value = _value(cell, marks, unit)
        if value is None:
            return np.array(cells, dtype=object)
        values[row] = value
    return values


def _value(cell: str, marks: Marks, unit: Unit | None) -> float | None:
    text = cell.translate(_SIGNS)
    if text.strip().lower() in MISSING:
        return float("nan")
    found = _MEASURED.match(text)
    if found is None:
        return None
    scale = 1.0
    if found["unit"]:
        own = unit_of(found["unit"])
        if own is not None and unit is not None and own.dimension == unit.dimension and own.offset == unit.offset:
            scale = own.scale / unit.scale
        elif own is not None or not (found["unit"].startswith("%") or found["unit"].lower() in _OTHER_UNITS):
            return None
    try:
        return scale * number(plain_number(found["number"], marks))
    except ValueError:
        return None


#: Units of quantities that no channel has.
_OTHER_UNITS = frozenset(("ah", "mah", "w", "wh", "kwh", "kw", "ohm", "mohm", "Ω", "mΩ", "hz"))


def plain_number(text: str, marks: Marks) -> str:
    """A number as Python writes it."""
    text = re.sub(rf"(?<=\d){_BETWEEN}(?=\d{{3}})", "", text)
    if marks.thousands:
        text = text.replace(marks.thousands, "")
    if marks.decimal_comma:
        text = text.replace(".", "").replace(",", ".") if "," in text and "." in text else text.replace(",", ".")
    return text


def _bare(cell: str) -> str:
    found = _MEASURED.match(cell.translate(_SIGNS))
    return found["number"] if found else ""
