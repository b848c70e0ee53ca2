"""Workbooks of Excel and the like, refused if their sheets would not fit in memory."""

from __future__ import annotations

import math
import struct
import zipfile
from collections.abc import Callable, Sequence
from datetime import date, datetime, time, timedelta
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple
from xml.parsers import expat

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.battery_columns import has_log
from ohmward.logs.cells import (
    Header,
    Marks,
    find_block,
    find_header,
    parse_cells,
    with_decimal_commas,
    with_units_of_cells,
    without_words,
)
from ohmward.logs.columns import listed, unique_names
from ohmward.logs.hints import FileHints
from ohmward.logs.table import Note, Table, TableFile, file_of, parsing, row_numbers
from ohmward.optional import require, silenced

#: Most cells of a workbook, including empty ones between filled ones, and most bytes of its unpacked parts.
MOST_CELLS, MOST_BYTES = 1 << 24, 1 << 30
#: So many cells may lie in any workbook; in one with more, each has at least a byte of the unpacked parts.
_FEW_CELLS = 1 << 19
#: Bytes of a part read at a time.
_BLOCK = 1 << 20


class _Sheet(NamedTuple):
    """A sheet with rows of values."""

    is_log: bool
    weight: float
    name: str
    rows: Sequence[Sequence[str]]
    header: Header


def open_workbook(path: Path, hints: FileHints) -> TableFile:
    """The columns of a workbook: of its sheet that holds a log, or else of the one with the most rows.

    Sheets of logs with the same columns are one log, whose column `sheet` tells them apart.
    """
    calamine = require("python_calamine", "a workbook")
    with parsing(path, "no readable workbook", "save it again, or as CSV"), silenced():
        _require_size(path)
        book = calamine.CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=True) for name in book.sheet_names}
    found = []
    for name, sheet in sheets.items():
        rows = [[_text(cell) for cell in row] for row in sheet]
        block = find_block(rows)
        if block is not None:
            header = find_header(rows, block)
            names = tuple(hints.names) if hints.names and len(hints.names) == block.width else header.names
            found.append(_Sheet(has_log(names), block.weight, name, rows, header._replace(names=names)))
    if not found:
        raise InputError(f"{path.name}: no sheet has rows of numbers; its sheets are {', '.join(sheets) or 'none'}")
    best = max(found, key=lambda one: one[:2])
    logs = [one for one in found if one.is_log]
    chosen = [one for one in logs if one.header.names == best.header.names] or [best]
    notes = [Note(f"sheet {listed([one.name for one in chosen])} of {len(sheets)}")] if len(sheets) > 1 else []
    if others := [one.name for one in logs if one not in chosen]:
        notes.append(Note(f"sheet {listed(others)} holds another log, which is not read: save it as a file", "warning"))
    return _table_file(path.name, chosen, hints, tuple(notes))


def _require_size(path: Path) -> None:
    """Refuse a workbook whose sheets would not fit in memory; its parser holds all cells between filled ones."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as book:
            unpacked = sum(part.file_size for part in book.infolist())
            if unpacked > MOST_BYTES:
                raise InputError(
                    f"{path.name}: the workbook unpacks to more than {MOST_BYTES >> 30} GiB; save its log as CSV or "
                    "Parquet"
                )
            cells = 0
            for part in book.infolist():
                with book.open(part) as stream:
                    cells += _cells_of_part(part.filename, stream)
    else:
        with require("olefile", "an .xls workbook").OleFileIO(path) as ole:
            sheets = ole.openstream("Workbook" if ole.exists("Workbook") else "Book").read()
        unpacked = len(sheets)
        cells = _cells_of_biff(sheets)
    most = min(MOST_CELLS, max(_FEW_CELLS, unpacked))
    if cells > most:
        raise InputError(
            f"{path.name}: the filled cells of the workbook span {cells:,} cells, more than {most:,}; delete the "
            "cells far from the log, or save it as CSV or Parquet"
        )


class _Extent:
    """First and last row and column of the filled cells of a sheet."""

    def __init__(self) -> None:
        self.first_row = self.row = self.column = 0
        self.rows: tuple[float, float] = (math.inf, -1)
        self.columns: tuple[float, float] = (math.inf, -1)

    @property
    def cells(self) -> int:
        """The cells between them."""
        rows, columns = (max(last - first + 1, 0) for first, last in (self.rows, self.columns))
        return int(rows * columns)

    def include(self, first_row: int, last_row: int, first_column: int, last_column: int) -> None:
        """Widen the extent by filled cells."""
        self.rows = min(self.rows[0], first_row), max(self.rows[1], last_row)
        self.columns = min(self.columns[0], first_column), max(self.columns[1], last_column)


def _cells_of_part(name: str, stream: IO[bytes]) -> int:
    """Number of cells in a part of a workbook, from its first filled one to its last; the part is read to its end."""
    if name == "content.xml":
        return _cells_of_xml(stream, _of_open_document)
    if "/worksheets/" in name and name.endswith(".bin"):
        return _cells_of_records(stream)
    if "/worksheets/" in name and name.endswith(".xml"):
        return _cells_of_xml(stream, _of_excel)
    while stream.read(_BLOCK):
        pass
    return 0


@lru_cache(1 << 14)
def _column_number(letters: str) -> int:
    """1 for A, 26 for Z, 27 for AA."""
    return sum((ord(letter) - 64) * 26**k for k, letter in enumerate(reversed(letters.upper())))


def _cells_of_xml(stream: IO[bytes], include: Callable[[_Extent, str, dict[str, str]], None]) -> int:
    sheets = [_Extent()]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        if name == "table":
            sheets.append(_Extent())
        include(sheets[-1], name, attributes)

    parser = expat.ParserCreate()
    parser.StartElementHandler = begin
    parser.ParseFile(stream)
    return sum(sheet.cells for sheet in sheets)


def _of_excel(sheet: _Extent, tag: str, attributes: dict[str, str]) -> None:
    """Include a row or a cell of Excel at its place, such as 12 or XFD12, or else after the previous one."""
    if tag == "row":
        sheet.row, sheet.column = int(attributes.get("r", sheet.row + 1)), 0
    elif tag == "c":
        sheet.column += 1
        if place := attributes.get("r"):
            letters = place.rstrip("0123456789")
            sheet.column = _column_number(letters)
            sheet.row = int(place[len(letters) :])
        sheet.include(sheet.row, sheet.row, sheet.column, sheet.column)


def _of_open_document(sheet: _Extent, tag: str, attributes: dict[str, str]) -> None:
    """Include a row or a cell of .ods, which may stand for several repeated ones."""
    if tag == "table-row":
        repeated = int(attributes.get("table:number-rows-repeated", 1))
        sheet.first_row, sheet.row, sheet.column = sheet.row + 1, sheet.row + repeated, 0
    elif tag in ("table-cell", "covered-table-cell"):
        first, sheet.column = sheet.column + 1, sheet.column + int(attributes.get("table:number-columns-repeated", 1))
        if "office:value-type" in attributes:
            sheet.include(sheet.first_row, sheet.row, first, sheet.column)


def _cells_of_records(stream: IO[bytes]) -> int:
    """Number of cells in a sheet of .xlsb: records of kind, size and content."""
    sheet = _Extent()
    while (kind := _packed_number(stream, 2)) is not None and (size := _packed_number(stream, 4)) is not None:
        record = stream.read(size)
        number = int.from_bytes(record[:4], "little")
        if kind == 0:
            sheet.row = number
        elif kind <= 11:  # a cell
            sheet.include(sheet.row, sheet.row, number, number)
    return sheet.cells


def _packed_number(stream: IO[bytes], most: int) -> int | None:
    """A number stored in seven bits a byte, with the eighth bit clear in the last byte; None at the end."""
    number = 0
    for k in range(most):
        if not (byte := stream.read(1)):
            return None
        number |= (byte[0] & 0x7F) << (7 * k)
        if byte[0] < 0x80:
            break
    return number


#: Records of BIFF that hold a cell, that hold several (the last column at their end), and that begin a sheet.
_BIFF_CELL = frozenset({0x06, 0xD6, 0xFD, 0x203, 0x204, 0x205, 0x27E})
_BIFF_CELLS, _BIFF_SHEET = 0xBD, 0x809


def _cells_of_biff(stream: bytes) -> int:
    """Number of cells in the sheets of an .xls: records of kind, size and content ([MS-XLS])."""
    sheets = [_Extent()]
    at = 0
    while at + 4 <= len(stream):
        kind, size = struct.unpack_from("<HH", stream, at)
        at += 4
        if kind == _BIFF_SHEET:
            sheets.append(_Extent())
        elif kind in _BIFF_CELL or kind == _BIFF_CELLS:
            row, column = struct.unpack_from("<HH", stream, at)
            last = struct.unpack_from("<H", stream, at + size - 2)[0] if kind == _BIFF_CELLS else column
            sheets[-1].include(row, row, column, max(column, last))
        at += size
    return sum(sheet.cells for sheet in sheets)


def _table_file(source: str, sheets: Sequence[_Sheet], hints: FileHints, notes: tuple[Note, ...]) -> TableFile:
    """The table of the rows of cells below the header of each sheet."""
    first = sheets[0].header.first
    unique = unique_names(sheets[0].header.names)
    if len([name for name in unique if name]) < 2:
        raise InputError(
            f"{source}: no header above the rows; name the columns with --names time_s,current_A,voltage_V"
        )
    data = [(sheet.name, row) for sheet in sheets for row in sheet.rows[sheet.header.first :] if any(row)]
    cells = {name: [row[k] if k < len(row) else "" for _, row in data] for k, name in enumerate(unique) if name}
    columns = with_decimal_commas({name: parse_cells(of_name, Marks()) for name, of_name in cells.items()})
    columns, of_words = without_words(source, with_units_of_cells(columns), Marks(), {})
    if len(sheets) > 1:
        columns |= {"sheet": np.array([name for name, _ in data], object)}
    head = {name: tuple(of_name[:100]) for name, of_name in cells.items()}
    return file_of(
        Table(source, columns, row_numbers(first + 1, len(data)), "row", (*notes, *of_words)), hints, head=head
    )


def _text(cell: Any) -> str:
    """A cell of a workbook as text in a notation that the reader of text tables knows."""
    if isinstance(cell, datetime):
        return cell.isoformat(" ")
    if isinstance(cell, date | time):
        return cell.isoformat()
    if isinstance(cell, timedelta):
        minutes, seconds = divmod(cell.total_seconds(), 60.0)
        return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:09.6f}"
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return "" if cell is None else str(cell)
