"""Tables that are held as rows of cells: workbooks of Excel and their kin; JSON, whose objects are rows."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO, Any
from xml.parsers import expat

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.arrays import plain_array
from ohmward.logs.cells import Marks, parse_cells
from ohmward.logs.columns import has_log
from ohmward.logs.header import Header, find_block, find_header, unique_names
from ohmward.logs.labelled_lines import is_labelled, rows_of_lines
from ohmward.logs.table import FileHints, Note, Progress, Table, TableFile, row_numbers
from ohmward.optional import require

#: Beginnings of a file of JSON.
#: The first message as `ros2 topic echo` writes it: keys and items of lists, a line each, and the end.
_ECHO = re.compile(rb"(?:---\s*\n)?(?:[A-Za-z_]\w*:.*\n(?: *(?:- .*|[A-Za-z_]\w*:.*)?\n)*)---\s*\n")
_ECHOED = re.compile(r"^(?P<indent> *)(?:- |(?P<name>[A-Za-z_]\w*):)\s*(?P<value>.*?)\s*$")
_ECHO_BYTES = 4096
_JSON = re.compile(rb"^(?:\xef\xbb\xbf)?\s*(?:\{|\[\s*[\[{\]])")
#: Cells of a workbook, empty ones between those that are filled among them, and bytes of its unpacked parts.
MOST_CELLS, MOST_BYTES = 1 << 24, 1 << 30
#: Bytes of a part that are looked at together, and those of one tag that may lie across two such blocks.
_BLOCK, _LONGEST_TAG = 1 << 20, 1 << 8
#: A cell of Excel, and one with its place as nearly all write it.
_CELL = re.compile(rb"<(?:\w+:)?c[\s/>]")
_PLACE = re.compile(rb"""<(?:\w+:)?c [^<>]*?\br=["']([A-Z]{1,3})(\d{1,7})["']""")
WORKBOOK_ENDINGS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")


def is_json(head: bytes) -> bool:
    """True where a file begins like objects of JSON."""
    return _JSON.match(head) is not None


def is_echo(head: bytes) -> bool:
    """True where a file begins like messages of ROS as `ros2 topic echo` writes them, the first one ended."""
    return _ECHO.match(head) is not None


def open_workbook(path: Path, hints: FileHints) -> TableFile:
    """The columns of a workbook: of its sheet that holds a log, or else of the one with the most rows.

    Raises:
        InputError: damaged, or no sheet with rows of values.
        OhmwardError: python-calamine is not installed.
    """
    calamine = require("python_calamine", "a workbook")
    try:
        _require_size(path)
        book = calamine.CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=True) for name in book.sheet_names}
    except InputError:
        raise
    except Exception as error:  # of its parser, many kinds
        raise InputError(f"{path.name}: no readable workbook ({error}); save it again, or as CSV") from error
    found = []
    for name, sheet in sheets.items():
        rows = [[_text(cell) for cell in row] for row in sheet]
        block = find_block(rows)
        if block is not None:
            header = find_header(rows, block)
            names = tuple(hints.names) if hints.names and len(hints.names) == block.width else header.names
            found.append((has_log(names), block.weight, name, rows, header._replace(names=names)))
    if not found:
        raise InputError(f"{path.name}: no sheet has rows of numbers; its sheets are {', '.join(sheets) or 'none'}")
    _, _, sheet_name, rows, header = max(found, key=lambda one: one[:2])
    notes = (Note(f"sheet {sheet_name!r} of {len(sheets)}"),) if len(sheets) > 1 else ()
    return _table_file(path.name, rows, header, hints, notes)


def _require_size(path: Path) -> None:
    """Refuse a workbook whose sheets would not fit the memory; its parser holds all cells between those filled.

    A sheet of the older .xls has no more than 16 million.

    Raises:
        InputError: names the limit and the fix.
        BadZipFile: a part is not what the workbook says of it.
    """
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as book:
        if sum(part.file_size for part in book.infolist()) > MOST_BYTES:
            raise InputError(
                f"{path.name}: the workbook unpacks to more than {MOST_BYTES >> 30} GiB; save its log as CSV or Parquet"
            )
        cells = 0
        for part in book.infolist():
            with book.open(part) as stream:
                cells += _cells_of_part(part.filename, stream)
    if cells > MOST_CELLS:
        raise InputError(
            f"{path.name}: the filled cells of the workbook span {cells:,} cells, more than {MOST_CELLS:,}; delete the "
            "cells far from the log, or save it as CSV or Parquet"
        )


class _Extent:
    """First and last row and column of the filled cells of a sheet."""

    def __init__(self) -> None:
        self.first_row = self.row = self.column = 0
        self.rows: tuple[int, int] | None = None
        self.columns: tuple[int, int] | None = None

    @property
    def cells(self) -> int:
        """The cells between them."""
        if self.rows is None or self.columns is None:
            return 0
        return (self.rows[1] - self.rows[0] + 1) * (self.columns[1] - self.columns[0] + 1)

    def include(self, first_row: int, last_row: int, first_column: int, last_column: int) -> None:
        """Widen the extent by filled cells."""
        rows, columns = self.rows or (first_row, last_row), self.columns or (first_column, last_column)
        self.rows = min(rows[0], first_row), max(rows[1], last_row)
        self.columns = min(columns[0], first_column), max(columns[1], last_column)


def _cells_of_part(name: str, stream: IO[bytes]) -> int:
    """Cells of a part of a workbook, from its first filled one to its last; the part is read to its end."""
    if name == "content.xml":
        return _cells_of_xml(stream, _of_open_document)
    if "/worksheets/" in name and name.endswith(".bin"):
        return _cells_of_records(stream)
    cells = _cells_of_places(stream)
    if cells is None and name.endswith(".xml"):
        stream.seek(0)
        cells = _cells_of_xml(stream, _of_excel)
    while stream.read(_BLOCK):
        pass
    return cells or 0


def _cells_of_places(stream: IO[bytes]) -> int | None:
    """Cells of a sheet of Excel by the places that stand in them; None where one has none."""
    sheet = _Extent()
    before = b""
    while block := stream.read(_BLOCK):
        block = before + block
        end = max(block.rfind(b"<", -_LONGEST_TAG), 0) or len(block)
        places = _PLACE.findall(block, 0, end)
        if len(places) != len(_CELL.findall(block, 0, end)):
            return None
        before = block[end:]
        rows = [int(row) for _, row in places]
        columns = [_column_number(column) for column in {column for column, _ in places}]
        if places:
            sheet.include(min(rows), max(rows), min(columns), max(columns))
    return sheet.cells


def _column_number(letters: bytes) -> int:
    """1 for A, 26 for Z, 27 for AA."""
    return sum((letter - 64) * 26**k for k, letter in enumerate(reversed(letters)))


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
    """A row or a cell of Excel, with its place, such as 12 or XFD12, or behind the one before."""
    if tag == "row":
        sheet.row, sheet.column = int(attributes.get("r", sheet.row + 1)), 0
    elif tag == "c":
        sheet.column += 1
        if place := attributes.get("r"):
            letters = place.rstrip("0123456789").upper()
            sheet.column = _column_number(letters.encode())
            sheet.row = int(place[len(letters) :])
        sheet.include(sheet.row, sheet.row, sheet.column, sheet.column)


def _of_open_document(sheet: _Extent, tag: str, attributes: dict[str, str]) -> None:
    """A row or a cell of .ods, which stands once for several."""
    if tag == "table-row":
        repeated = int(attributes.get("table:number-rows-repeated", 1))
        sheet.first_row, sheet.row, sheet.column = sheet.row + 1, sheet.row + repeated, 0
    elif tag in ("table-cell", "covered-table-cell"):
        first, sheet.column = sheet.column + 1, sheet.column + int(attributes.get("table:number-columns-repeated", 1))
        if "office:value-type" in attributes:
            sheet.include(sheet.first_row, sheet.row, first, sheet.column)


def _cells_of_records(stream: IO[bytes]) -> int:
    """Cells of a sheet of .xlsb: records of kind, size and content."""
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
    """A number of seven bits a byte, of which the last has no eighth; None at the end."""
    number = 0
    for k in range(most):
        if not (byte := stream.read(1)):
            return None
        number |= (byte[0] & 0x7F) << (7 * k)
        if byte[0] < 0x80:
            break
    return number


def _table_file(
    source: str, rows: Sequence[Sequence[str]], header: Header, hints: FileHints, notes: tuple[Note, ...]
) -> TableFile:
    """The table of rows of cells below a header."""
    unique = unique_names(header.names)
    if len([name for name in unique if name]) < 2:
        raise InputError(
            f"{source}: no header above the rows; name the columns with --names time_s,current_A,voltage_V"
        )
    data = [row for row in rows[header.first :] if any(row)]

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        columns = {}
        for k, name in enumerate(unique):
            if name and name in names:
                cells = [row[k] if k < len(row) else "" for row in data]
                values = parse_cells(cells, Marks(), None)
                columns[name] = np.array(cells, dtype=object) if values is None else values
        return Table(source, columns, row_numbers(header.first + 1, len(data)), "row", notes)

    head = {name: tuple(row[k] for row in data[:100] if k < len(row)) for k, name in enumerate(unique) if name}
    return TableFile(source, tuple(name for name in unique if name), load, head=head, hints=hints)


def _text(cell: Any) -> str:
    """A cell of a workbook as text that the reader of text tables knows."""
    if isinstance(cell, datetime):
        return cell.isoformat(" ")
    if isinstance(cell, date | time):
        return cell.isoformat()
    if isinstance(cell, timedelta):
        return f"{cell.total_seconds():.6f}s"
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return "" if cell is None else str(cell)


def open_json(path: Path, hints: FileHints) -> TableFile:
    """The columns of echoed messages, of labelled lines or of JSON.

    That is an object a line, an array of objects, or an object of columns.

    Inner names stand after a point.

    Raises:
        InputError: no JSON, or no objects of one kind.
    """
    text = path.read_text(encoding=hints.encoding or "utf-8-sig", errors="replace")
    echoed = is_echo(text[:_ECHO_BYTES].encode())
    labelled = not echoed and is_labelled(text[:_ECHO_BYTES].encode())
    content = _echoed(text) if echoed else rows_of_lines(text) if labelled else _content(path.name, text)
    columns = _columns(path.name, content)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        chosen = {name: values for name, values in columns.items() if name in names}
        return Table(path.name, chosen, row_numbers(1, len(next(iter(columns.values())))), "object")

    head = {name: tuple(map(str, values[:100])) for name, values in columns.items() if values.dtype == object}
    return TableFile(path.name, tuple(columns), load, head=head, hints=hints)


def _content(source: str, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    objects = []
    lines = [line for line in text.splitlines() if line.strip()]
    for number, line in enumerate(lines, 1):
        try:
            objects.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            if number == len(lines) and objects:
                break  # cut off
            raise InputError(f"{source}, line {number}: no JSON ({error}); repair or delete the line") from None
    return objects


def _columns(source: str, content: Any) -> dict[str, np.ndarray]:
    """Columns of equal length."""
    if isinstance(content, Mapping):
        lists = {name: value for name, value in content.items() if isinstance(value, list)}
        nested = any(isinstance(cell, list | dict) for values in lists.values() for cell in values[:5])
        if len(lists) > 1 and len({len(value) for value in lists.values()}) == 1 and not nested:
            return {name: plain_array(value) for name, value in lists.items()}
        content = next(iter(lists.values()), [content])
    while content and all(isinstance(one, list) for one in content):
        content = [one for inner in content for one in inner]
    rows = [dict(_flattened(one)) for one in content if isinstance(one, Mapping)] if isinstance(content, list) else []
    names = dict.fromkeys(name for row in rows for name in row)
    if not rows or len(names) < 2:
        raise InputError(
            f'{source}: no objects with two values and more; write one object a line: {{"t": 0, "I": 1}}; '
            "messages of ROS without a stamp have no time here: record them with `ros2 bag record`"
        )
    return {name: plain_array(_alike([row.get(name) for row in rows])) for name in names}


def _echoed(text: str) -> list[dict[str, str]]:
    """The values of each message that `ros2 topic echo` wrote, by names like `header.stamp.sec` and `velocity[0]`."""
    messages = []
    for document in re.split(r"^---\s*$", text, flags=re.MULTILINE):
        message: dict[str, str] = {}
        above: list[tuple[int, str]] = []
        item = 0
        for line in filter(None, map(_ECHOED.match, document.splitlines())):
            indent, name, value = len(line["indent"]), line["name"], line["value"].strip("'\"")
            while above and (above[-1][0] > indent or (name and above[-1][0] == indent)):
                above.pop()
            before = ".".join(key for _, key in above)
            if name is None:
                message[f"{before}[{item}]"] = value
                item += 1
                continue
            item, path = 0, f"{before}.{name}" if before else name
            if value.startswith("["):
                message |= {f"{path}[{k}]": cell.strip() for k, cell in enumerate(value.strip("[]").split(","))}
            elif value:
                message[path] = value
            else:
                above.append((indent, name))
        messages += [message] if message else []
    return messages


def _alike(values: list[Any]) -> list[Any]:
    """Numbers and what is missing as they are; text, where there is any, of all."""
    if not any(isinstance(value, str) for value in values):
        return [float(value) if isinstance(value, bool | int | float) else None for value in values]
    numbers = [None if value is None else _number(value) for value in values]
    if not any(isinstance(value, str) for value in numbers):
        return numbers
    return ["" if value is None else str(value) for value in values]


def _number(value: Any) -> Any:
    try:
        return float(value)
    except (TypeError, ValueError):
        return str(value)


def _flattened(one: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in one.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{before}{name}.")
        elif isinstance(value, list):
            yield from (
                (f"{before}{name}[{k}]", item) for k, item in enumerate(value) if not isinstance(item, list | dict)
            )
        else:
            yield f"{before}{name}", value
