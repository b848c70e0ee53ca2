"""The layout of a text table: encoding, header, delimiter, decimal mark; found from its first lines."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TextIO

from ohmward.errors import InputError

_HEAD_LINES = 100
_COMMENT = ("#", "%", "//")
# Ties go to the first: a comma may also be a decimal mark.
_DELIMITERS = "\t;,|"
_TIMESTAMP = re.compile(r"^\d{4}-\d\d-\d\d")
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$")


class CsvLayout(NamedTuple):
    """Column names, delimiter and decimal mark of the rows, and the number of lines before the first one."""

    names: tuple[str, ...]
    delimiter: str
    decimal_comma: bool
    skip_lines: int


def open_text(path: Path) -> TextIO:
    """The file as text; UTF-8, UTF-16 or Windows-1252, plain or gzip.

    Raises:
        InputError: the file is not text.
    """
    with path.open("rb") as stream:
        opener = gzip.open if stream.read(2) == b"\x1f\x8b" else open
    with opener(path, "rb") as stream:
        head = stream.read(1 << 16)
    encoding = _encoding(head)
    # a power failure leaves zeros at the end of a file; elsewhere they mean that it is not text
    if encoding != "utf-16" and b"\0" in head.rstrip(b"\0\r\n"):
        raise InputError(
            f"{path.name}: not a text table (binary data in its first bytes); "
            "ohmward reads CSV and Parquet: export the log to one of them"
        )
    return io.TextIOWrapper(opener(path, "rb"), encoding, errors="replace", newline="")


def bytes_read(stream: TextIO) -> int:
    """The position [bytes] of a stream of `open_text` in its file, packed or not."""
    return getattr(stream.buffer, "fileobj", stream.buffer).tell()


def find_layout(path: Path) -> CsvLayout:
    """Read the head of a text table.

    Comment lines (`#`, `%`, `//`) and empty lines may stand before the header. Where the first row is numbers, the last
    comment is the header, as `numpy.savetxt` and `rostopic echo -p` write it.

    Raises:
        InputError: empty file, no header, one column only, a column name twice.
    """
    with open_text(path) as stream:
        lines = [line.rstrip("\r\n") for line in islice(stream, _HEAD_LINES)]
    at = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith(_COMMENT)), len(lines))
    if at == len(lines):
        raise InputError(f"{path.name}: the file is empty; a log needs a header line and rows below it")
    comments = [line for line in lines[:at] if line.strip()]
    rows = [line for line in lines[at:] if line.strip()]
    delimiter = _delimiter(rows)
    header = rows[0]
    cells = _cells(header, delimiter)
    without_header = any(cells) and all(map(_is_value, cells))
    if without_header:
        header = _header_in_comments(path, comments, rows[0], delimiter)
    names = tuple(name.strip() for name in _cells(header, delimiter))
    _check_names(path, names)
    data = rows if without_header else rows[1:]
    return CsvLayout(names, delimiter, _has_decimal_comma(data, delimiter), at + (not without_header))


def _encoding(head: bytes) -> str:
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _cells(line: str, delimiter: str) -> list[str]:
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))


def _delimiter(rows: list[str]) -> str:
    """The mark that splits the header into most cells, and the row below it into as many."""

    def score(mark: str) -> tuple[bool, int]:
        counts = [len(_cells(row, mark)) for row in rows[:2]]
        return counts[0] == counts[-1], counts[0]

    fitting = [mark for mark in _DELIMITERS if len(_cells(rows[0], mark)) > 1]
    return max(fitting, key=score, default=",")


def _is_value(cell: str) -> bool:
    if not cell.strip() or _TIMESTAMP.match(cell) or _DECIMAL_COMMA.match(cell):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _header_in_comments(path: Path, comments: list[str], row: str, delimiter: str) -> str:
    header = comments[-1].lstrip("#%/ ") if comments else ""
    if len(_cells(header, delimiter) if header else []) != len(_cells(row, delimiter)):
        raise InputError(
            f"{path.name}: no header line: the first row is numbers ({row[:60]!r}); "
            "put the column names above it, for example time_s,current_A,voltage_V"
        )
    return header


def _check_names(path: Path, names: tuple[str, ...]) -> None:
    if len([name for name in names if name]) < 2:
        raise InputError(
            f"{path.name}: only one column found ({names[0][:60]!r}); "
            "columns must be separated by a comma, semicolon or tab and named in the first line"
        )
    if twice := sorted({name for name in names if name and names.count(name) > 1}):
        raise InputError(f"{path.name}: more than one column is named {twice[0]!r}; rename them so that each is unique")


def _has_decimal_comma(rows: list[str], delimiter: str) -> bool:
    if delimiter == ",":
        return False
    return any(_DECIMAL_COMMA.match(cell) for row in rows for cell in _cells(row, delimiter))
