"""The header of a table: rows of cells above the first rows of values, below whatever text a logger writes first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from ohmward.logs.cells import is_value
from ohmward.logs.units import split_unit, unit_of

Row = Sequence[str]

#: The zone that Victron's portal writes below `timestamp`: "Europe/Berlin (+01:00)".
_ZONE = re.compile(r"^(?P<zone>[A-Z]\w+/[\w/-]+) \([+-]\d\d:\d\d\)$")
#: Longest unit that is not known, like "[Cnt]".
_LONGEST_UNIT = 7


class ValueBlock(NamedTuple):
    """Rows of values: the first one, their number, the usual number of cells, the share of cells that are values."""

    first: int
    length: int
    width: int
    share: float

    @property
    def weight(self) -> float:
        """Number of rows that are surely values."""
        return self.length * self.share


class Header(NamedTuple):
    """Names of the columns, units among them in brackets; the row of the names, and the first row of values."""

    names: tuple[str, ...]
    row: int | None  #: None where there is no header
    first: int
    timezone: str | None = None  #: that the header names, or None


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names, those that stand a second time with a number before their unit: `Temp`, `Temp 2`; `I 2 [A]`."""
    unique: list[str] = []
    for name in names:
        stem, unit = next(split_unit(name))
        number = 2
        free = name
        while free and free in unique:
            free = f"{stem} {number} [{unit.symbol}]" if unit else f"{name} {number}"
            number += 1
        unique.append(free)
    return tuple(unique)


def find_block(rows: Sequence[Row]) -> ValueBlock | None:
    """The longest run of rows of values; blank rows do not end one."""
    best: ValueBlock | None = None
    run: dict[int, _Cells] = {}
    for at, row in enumerate([*rows, ("end", "of", "rows")]):
        cells = _cells(row)
        if cells.filled and at < len(rows) and cells.are_data:
            run[at] = cells
        elif cells.filled and run:
            (width, _), *_ = Counter(counted.width for counted in run.values()).most_common(1)
            share = sum(counted.values for counted in run.values()) / sum(counted.filled for counted in run.values())
            block = ValueBlock(min(run), len(run), width, share)
            best = block if best is None or block.weight > best.weight else best
            run = {}
    return best


class _Cells(NamedTuple):
    """Numbers of cells of a row: all, those that are filled, and the values among these, which a single cell is not."""

    width: int
    filled: int
    values: int

    @property
    def are_data(self) -> bool:
        """True where there is a value, and no more texts than values."""
        return self.values > 0 and 2 * self.values >= self.filled


def _cells(row: Row) -> _Cells:
    filled = [cell for cell in row if cell.strip()]
    return _Cells(len(row), len(filled), sum(map(is_value, filled)) if len(row) > 1 else 0)


def is_data(row: Row) -> bool:
    """True for a row of at least two cells with a value, and no more texts than values."""
    return _cells(row).are_data


def find_header(rows: Sequence[Row], block: ValueBlock) -> Header:
    """The header of a block of values.

    Above it may stand rows of units and text that is no header; a row of values that a note interrupts goes on.
    """
    above = [at for at in range(block.first) if _may_be_header(rows[at], block.width)]
    of_units = [at for at in above if _is_unit_row(rows[at])]
    has_names_above = [at for at in of_units if at - 1 in above and at - 1 not in of_units]
    last = next((at for at in reversed(above) if at not in has_names_above), None)
    if last is None:
        return Header((), None, block.first)
    names = [name.strip() for name in rows[last]]
    first_same = next(at for at in above if [name.strip() for name in rows[at]] == names)
    units = rows[last + 1] if last + 1 in of_units else None
    layered = rows[first_same - 1] if first_same - 1 in above else None
    names, timezone = _with_devices(names, layered)
    if units is not None:
        names = [_with_unit(name, unit) for name, unit in zip(names, [*units, *[""] * len(names)], strict=False)]
    first = next((at for at in range(first_same + 1, len(rows)) if is_data(rows[at])), first_same + 1)
    # a header may name a remark that the rows do not have
    remark = len(names) == block.width + 1 and (not names[-1] or names[-1].lower() == "comment")
    return Header(tuple(names[: block.width] if remark else names), first_same, first, timezone)


def _may_be_header(row: Row, width: int) -> bool:
    """True for a row of texts that is as long as the rows of values, but for empty cells and a last remark."""
    filled = [cell for cell in row if cell.strip()]
    long = len(row) in (width, width + 1) or (len(row) > width and not any(cell.strip() for cell in row[width:]))
    short = width > len(row) >= max(2, width - 1)
    return (long or short) and len(filled) >= max(2, width // 2 - 1) and not is_data(row)


def _is_unit_row(row: Row) -> bool:
    filled = [_bare_unit(cell) for cell in row if cell.strip()]
    known = [cell for cell in filled if unit_of(cell)]
    return bool(known) and all(len(cell) <= _LONGEST_UNIT for cell in filled)


def _bare_unit(cell: str) -> str:
    return cell.strip().strip("[]()").strip()


def _with_unit(name: str, unit: str) -> str:
    """The name with the unit of the row below in brackets, unless it has one."""
    bare = _bare_unit(unit)
    if not bare or unit_of(bare) is None or any(found for _, found in split_unit(name)):
        return name
    return f"{name} [{bare}]"


def _with_devices(names: list[str], devices: Row | None) -> tuple[list[str], str | None]:
    """The names, those of Victron's portal with the devices above where they are needed, and its time zone."""
    if devices is None or not (zone := _ZONE.match(names[0])) or devices[0].strip() != "timestamp":
        return names, None
    whole = [
        f"{device.strip()} {name}" if names.count(name) > 1 else name
        for device, name in zip(devices, names, strict=False)
    ]
    return ["timestamp", *whole[1:]], zone["zone"]
