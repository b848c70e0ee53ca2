"""Cells of a text table (numbers with units, thousands separators, a decimal comma; dates), and its header.

The header is the rows of cells above the first rows of values, below any text that a logger writes first.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.dates import MONTHS
from ohmward.logs.table import MISSING, Note, counted, number
from ohmward.logs.units import Unit, split_unit, unit_of

#: Thousands separators: non-breaking spaces, and the Swiss apostrophe.
_SPACES = "\u00a0\u202f\u2009"
_BETWEEN = f"[{_SPACES}'’ ]"
_SIGNS = str.maketrans({"\u2212": "-", "\uff0d": "-", "\u2013": "-"})
_DIGITS = rf"\d+(?:(?<=\d){_BETWEEN}\d{{3}})*"
#: A number, then perhaps its unit.
_MEASURED = re.compile(
    rf"^\s*(?P<number>[-+]?(?:{_DIGITS}(?:[.,]\d*)*|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s.,;:/()-][^\d\s:]*(?:/\w+)?)?\s*$"
)
_TIME_OF_DAY = r"\d{1,2}:\d\d(?::\d\d(?:[.,:]\d+)?)?(?:\s*[AaPp]\.?[Mm]\.?)?"
_DATE_MARKS = r"\d{1,4}\s*[-/.年년]\s*(?:\d{1,2}|[A-Za-z]{3,9})\s*[-/.月월]\s*\d{1,4}|\d{4}-\d{3}"
_TIME = re.compile(
    rf"{_TIME_OF_DAY}|{_DATE_MARKS}|\b(?:{MONTHS})[a-z]*\b.*\d{{4}}|^\s*\d{{8}}T?\d{{6}}|^P(?:\d+[YMWD]|T)",
    re.IGNORECASE,
)
_DATE = re.compile(_DATE_MARKS)
#: Delimiters of cells that occur in no date and no number.
_MARKS = re.compile(r"[;|\t]")
_GROUPS_OF_THREE = re.compile(r"^[-+]?[1-9]\d{0,2}(?:,\d{3})+(?P<fraction>\.\d+)?$")
_GROUPS_BY_POINTS = re.compile(r"^[-+]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?$")
#: Fewest of them: of a few numbers all may have three decimals by chance.
_FEWEST_GROUPED = 20
_COMMA = re.compile(r"^[-+]?\d*,\d+(?:[eE][-+]?\d+)?$")


class Marks(NamedTuple):
    """Notation of numbers: a decimal comma; the thousands separator."""

    decimal_comma: bool = False
    thousands: str = ""


def is_value(cell: str) -> bool:
    """True for a number, a measured quantity, a date, a duration; not for an empty cell."""
    cell = cell.strip()
    if not cell or _MARKS.search(cell):
        return False
    try:
        int(cell, 16) if cell[:2] in ("0x", "0X") else float(cell)
    except ValueError:
        known = cell.lower() in MISSING or _TIME.search(cell) is not None
        return known or _MEASURED.match(cell.translate(_SIGNS)) is not None
    return True


def unit_in_cells(cells: Iterable[str]) -> Unit | None:
    """The unit after the first number that has one, if all cells are numbers; else None."""
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
    """The notation of the numbers in columns of cells; None if a comma may be decimal or a thousands separator."""
    comma = [
        [cell for cell in map(_bare, cells) if "," in cell and (_COMMA.match(cell) or _GROUPS_OF_THREE.match(cell))]
        for cells in columns
    ]
    cells_with = [cell for cells in comma for cell in cells]
    if not cells_with:
        return Marks(thousands="" if delimiter == "," else _points(columns, decimal_comma=False))
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
    return Marks(decimal_comma=True, thousands=_points(columns, decimal_comma=True))


def _points(columns: Sequence[Sequence[str]], decimal_comma: bool) -> str:
    """The point, if it separates thousands in numbers like `13.041` and never stands before another number of digits.

    Without a decimal comma it may be that of decimals, of which three would be written for a 0, too.
    """
    bare = [[_bare(cell) for cell in cells] for cells in columns]
    pointed = [[cell for cell in cells if "." in cell] for cells in bare]
    grouped = [cell for cells in pointed for cell in cells]
    if len(grouped) < _FEWEST_GROUPED or not all(map(_GROUPS_BY_POINTS.match, grouped)):
        return ""
    beside = [cell for cells, found in zip(bare, pointed, strict=True) if found for cell in cells]
    is_plain = decimal_comma or any(cell.count(".") > 1 or re.fullmatch(r"[-+]?\d{1,3}", cell) for cell in beside)
    return "." if is_plain else ""


def parse_cells(cells: Sequence[str], marks: Marks, unit: Unit | None = None) -> np.ndarray:
    """The cells (T,) as float64 if each is a number, perhaps with a unit, or missing; else as text (dtype object).

    unit: of the column; cells in another unit of the same dimension are converted.

    Raises:
        InputError: points separate thousands, but not in all cells.
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


def without_words(
    source: str, columns: Mapping[str, np.ndarray], marks: Marks, units: Mapping[str, Unit]
) -> tuple[dict[str, np.ndarray], list[Note]]:
    """Columns of text as numbers if all but a few words among them, such as `OL`, are numbers; and notes on these.

    A cell with a digit in it may be a number that is written in another way: then all of its column stay text.

    Raises:
        InputError: a row of different words in all columns of numbers, which is another header.
    """
    found, notes = dict(columns), []
    rows_of_words = []
    for name, cells in columns.items():
        unit, first = units.get(name), cells[:_FIRST_CELLS]
        if cells.dtype != object:
            continue
        if parse_cells(np.where(are_words(first), "", first).tolist(), marks, unit).dtype == object:  # dates, states
            continue
        words = are_words(cells)
        numbers = parse_cells(np.where(words, "", cells).tolist(), marks, unit) if words.any() else cells
        if numbers.dtype != object:
            example = cells[np.argmax(words)].strip()
            text = f"{counted(int(words.sum()), 'cell')} of {name!r} treated as missing: no number ({example!r})"
            notes.append(Note(text, "warning"))
            found[name] = numbers
            rows_of_words.append(np.flatnonzero(words))
    if len(rows_of_words) > 1 and len(rows_of_words) == sum(values.dtype != object for values in found.values()):
        for row in reduce(np.intersect1d, rows_of_words):
            header = {str(columns[name][row]): name for name in found if columns[name].dtype == object}
            is_same = all(cell == name.partition(" [")[0] for cell, name in header.items())
            if len(header) >= len(rows_of_words) and not is_same:
                raise InputError(
                    f"{source}: another header ({', '.join(header)}) stands below {counted(int(row), 'row')}: another "
                    "table; split the file there"
                )
    return found, notes


def are_words(cells: np.ndarray) -> np.ndarray:
    """Mask (T,) of the cells without any digit that do not mean a missing value; none if more than a few are such."""
    words = np.array([_DIGIT.search(cell) is None and cell.strip().lower() not in MISSING for cell in cells], bool)
    return words if words.sum() <= _MOST_WORDS * words.size else np.zeros(words.size, bool)


def with_decimal_commas(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns (T,), those of text with commas as numbers if the commas in their first cells are decimal."""
    texts = {name: v for name, v in columns.items() if v.dtype == object and any("," in cell for cell in v)}
    marks = find_marks([values[:_FIRST_CELLS].tolist() for values in texts.values()], ";")
    if marks is None or not marks.decimal_comma:
        return dict(columns)
    return {**columns, **{name: parse_cells(values.tolist(), marks) for name, values in texts.items()}}


def with_units_of_cells(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns (T,), those of numbers with units, `15.3 V`, as numbers, with the unit in their names."""
    found = {}
    for name, values in columns.items():
        unit = unit_in_cells(values[:_FIRST_CELLS]) if values.dtype == object else None
        numbers = parse_cells(values.tolist(), Marks(), unit) if unit else values
        found[name if numbers.dtype == object else with_unit_of_cells(name, unit)] = numbers
    return found


def units_beside(columns: Mapping[str, Sequence[str]]) -> dict[str, Unit]:
    """Units of columns behind which a column of their units stands: `Reading` and `Unit`, `Source`, `Source Unit`.

    columns: name -> cells, in the order of the file; those of a unit are all alike.
    """
    found = {}
    for (name, _), (other, cells) in pairwise(columns.items()):
        spelled = {_OF_DIRECT_CURRENT.sub("", cell.strip()) for cell in cells} if _OF_UNITS.search(other) else set()
        if len(spelled) == 1 and (unit := unit_of(spelled.pop())):
            found[name] = unit
    return found


#: Name of a column of units, perhaps numbered; `DC` behind a unit, as Keithley writes it.
_OF_UNITS, _OF_DIRECT_CURRENT = re.compile(r"\bunits?(?: \d+)?$", re.IGNORECASE), re.compile(r"\s+dc$", re.IGNORECASE)


def with_unit_of_cells(name: str, unit: Unit | None) -> str:
    """The name with the unit found in its cells, unless it has one."""
    silent = unit is None or unit.dimension == "share" or any(found for _, found in split_unit(name))
    return name if silent or unit is None else f"{name} [{unit.symbol}]"


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
    # the number as Python writes it
    text = re.sub(rf"(?<=\d){_BETWEEN}(?=\d{{3}})", "", found["number"])
    if marks.thousands == "." and "." in text and not _GROUPS_BY_POINTS.match(text):
        raise InputError(
            f"the point in {cell!r} stands before decimals, in other numbers between thousands; write the numbers "
            "without marks between thousands"
        )
    if marks.thousands:
        text = text.replace(marks.thousands, "")
    if marks.decimal_comma:
        text = text.replace(".", "").replace(",", ".") if "," in text and "." in text else text.replace(",", ".")
    try:
        return scale * number(text)
    except ValueError:
        return None


_DIGIT = re.compile(r"\d")
#: Largest share of words among the cells of a column of numbers; cells from which a notation is found.
_MOST_WORDS, _FIRST_CELLS = 0.1, 200
#: Units of quantities that no channel has, in lower case.
_OTHER_UNITS = frozenset(("ohm", "mohm", "ω", "mω", "hz"))


def _bare(cell: str) -> str:
    found = _MEASURED.match(cell.translate(_SIGNS))
    return found["number"] if found else ""


Row = Sequence[str]

#: The zone that Victron's portal writes below `timestamp`: "Europe/Berlin (+01:00)".
_ZONE = re.compile(r"^(?P<zone>[A-Z]\w+/[\w/-]+) \([+-]\d\d:\d\d\)$")
#: Length of the longest unknown unit, like "[Cnt]".
_LONGEST_UNIT = 7


class ValueBlock(NamedTuple):
    """Rows of values: the first one, their number, the usual number of cells, the share of cells that are values."""

    first: int
    length: int
    width: int
    share: float

    @property
    def weight(self) -> float:
        """Number of rows times the share of values in them."""
        return self.length * self.share


class Header(NamedTuple):
    """Names of the columns, units among them in brackets; the row of the names, and the first row of values."""

    names: tuple[str, ...]
    row: int | None  #: None where there is no header
    first: int
    timezone: str | None = None  #: that the header names, or None


def find_block(rows: Sequence[Row]) -> ValueBlock | None:
    """The longest run of rows of values; blank rows do not end one."""
    best: ValueBlock | None = None
    run: dict[int, tuple[int, int]] = {}
    for at, row in enumerate([*rows, ("end", "of", "rows")]):
        filled, values = _cells(row)
        if at < len(rows) and _are_data(filled, values):
            run[at] = filled, values
        elif filled and run:
            (width, _), *_ = Counter(len(rows[k]) for k in run).most_common(1)
            share = sum(values for _, values in run.values()) / sum(filled for filled, _ in run.values())
            block = ValueBlock(min(run), len(run), width, share)
            best = block if best is None or block.weight > best.weight else best
            run = {}
    return best


def _cells(row: Row) -> tuple[int, int]:
    """Number of filled cells, and of values among them; a single cell is not a value."""
    filled = [cell for cell in row if cell.strip()]
    return len(filled), sum(map(is_value, filled)) if len(row) > 1 else 0


def _are_data(filled: int, values: int) -> bool:
    return values > 0 and 2 * values >= filled


def is_data(row: Row) -> bool:
    """True for a row of at least two cells with a value, and no more texts than values."""
    return _are_data(*_cells(row))


def find_header(rows: Sequence[Row], block: ValueBlock) -> Header:
    """The header of a block of values.

    Above the block may stand rows of units and text that is no header. The values begin below the first row with more
    than half of these names, also if a note or another header interrupts them.
    """
    above = [at for at in range(block.first) if _may_be_header(rows[at], block.width)]
    of_units = [at for at in above if _is_unit_row(rows[at])]
    has_names_above = [at for at in of_units if at - 1 in above and at - 1 not in of_units]
    last = next((at for at in reversed(above) if at not in has_names_above), None)
    if last is None:
        return Header((), None, block.first)
    words = {at: {name.strip() for name in rows[at]} for at in above}
    first_alike = next(at for at in above if 2 * len(words[at] & words[last]) > len(words[last]))
    names = [name.strip() for name in rows[first_alike]]
    units = rows[first_alike + 1] if first_alike + 1 in of_units else None
    layered = rows[first_alike - 1] if first_alike - 1 in above else None
    names, timezone = _with_groups(names, layered)
    if units is not None:
        names = [with_unit(name, unit) for name, unit in zip(names, [*units, *[""] * len(names)], strict=False)]
    first = next((at for at in range(first_alike + 1, len(rows)) if is_data(rows[at])), first_alike + 1)
    # a header may name a remark that the rows do not have
    remark = len(names) == block.width + 1 and (not names[-1] or names[-1].lower() == "comment")
    return Header(tuple(names[: block.width] if remark else names), first_alike, first, timezone)


def _may_be_header(row: Row, width: int) -> bool:
    """True for a row of texts as long as the rows of values, except for empty cells and a last remark.

    A row with a date is none: it is one of values whose others are states, `unavailable`.
    """
    filled = [cell for cell in row if cell.strip()]
    if any(map(_DATE.search, filled)):
        return False
    long = len(row) in (width, width + 1) or (len(row) > width and not any(cell.strip() for cell in row[width:]))
    short = width > len(row) >= max(2, width - 1)
    return (long or short) and len(filled) >= max(2, width // 2 - 1) and not is_data(row)


def _is_unit_row(row: Row) -> bool:
    filled = [_bare_unit(cell) for cell in row if cell.strip()]
    others = [cell for cell in filled if not unit_of(cell)]
    return len(others) < len(filled) and all(len(cell) <= _LONGEST_UNIT for cell in others)


def _bare_unit(cell: str) -> str:
    return cell.strip().strip("[]()").strip()


def with_unit(name: str, unit: str) -> str:
    """The name with the unit of the row below in brackets, unless it has one."""
    bare = _bare_unit(unit)
    if not bare or unit_of(bare) is None or any(found for _, found in split_unit(name)):
        return name
    return f"{name} [{bare}]"


def _with_groups(names: list[str], above: Row | None) -> tuple[list[str], str | None]:
    """The names, with the group or device in the row above where a name is empty or repeated; and a time zone.

    A group covers the empty cells behind it.  Victron's portal writes the zone below `timestamp`.
    """
    if above is None:
        return names, None
    zone = _ZONE.match(names[0]) if above[0].strip() == "timestamp" else None
    names = ["", *names[1:]] if zone else names
    over_names = [group.strip() for name, group in zip(names, above, strict=False) if not name or names.count(name) > 1]
    if not any(over_names):
        return names, None
    groups = [""]
    for group in above:
        groups.append(group.strip() or groups[-1])
    groups += groups[-1:] * len(names)
    whole = [
        f"{group} {name}".strip() if not name or names.count(name) > 1 else name
        for name, group in zip(names, groups[1:], strict=False)
    ]
    return whole, zone["zone"] if zone else None
