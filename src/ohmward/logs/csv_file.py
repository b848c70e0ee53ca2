"""Text tables (CSV and its kin), read with the standard library in blocks of rows, or by Arrow where they are plain."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from operator import itemgetter
from pathlib import Path

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import csv_arrow
from ohmward.logs.csv_layout import CsvLayout, bytes_read, find_layout, open_text
from ohmward.logs.note import Note
from ohmward.logs.table import Progress, Table, TableFile, number, row_numbers

_BLOCK_ROWS = 50_000


def open_csv(path: Path) -> TableFile:
    """The columns of a text table: comma, semicolon or tab, decimal point or comma, plain or gzip.

    Empty cells, `nan`, `NA`, `null` and `-` are NaN. A last line that was cut off is dropped and noted.

    Raises:
        InputError: not text, empty, no header, or (on loading) no rows or a row with the wrong number of cells.
    """
    with _unpacking(path):
        layout = find_layout(path)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        with _unpacking(path):
            return _load(path, layout, [name for name in layout.names if name in names], progress)

    return TableFile(path.name, tuple(name for name in layout.names if name), load)


@contextmanager
def _unpacking(path: Path) -> Iterator[None]:
    """Turn the errors of a damaged gzip file into one that names the file."""
    try:
        yield
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise InputError(f"{path.name}: the gzip file is damaged ({error}); unpack what is left of it") from error


def _load(path: Path, layout: CsvLayout, names: list[str], progress: Progress | None) -> Table:
    if (plain := csv_arrow.read_numbers(path, layout, names, progress)) is not None:
        return Table(path.name, plain, row_numbers(layout.skip_lines + 1, len(plain[names[0]])), "line")
    columns: dict[str, list[np.ndarray]] = {name: [] for name in names}
    lines: list[np.ndarray] = []
    notes: list[Note] = []
    for rows, line in _blocks(path, layout, notes, progress):
        lines.append(line)
        for name in names:
            cells = list(map(itemgetter(layout.names.index(name)), rows))
            columns[name].append(_parse(cells, layout.decimal_comma))
    if not lines:
        raise InputError(f"{path.name}: there is a header but no rows below it; a log needs samples")
    joined = {name: _join(blocks) for name, blocks in columns.items()}
    return Table(path.name, joined, np.concatenate(lines), "line", tuple(notes))


def _blocks(
    path: Path, layout: CsvLayout, notes: list[Note], progress: Progress | None
) -> Iterator[tuple[list[list[str]], np.ndarray]]:
    """Rows of equal length and their line numbers; says in `notes` when the last line is cut off."""
    width = len(layout.names)
    size = path.stat().st_size
    with open_text(path) as stream:
        for _ in range(layout.skip_lines):
            stream.readline()
        reader = csv.reader(stream, delimiter=layout.delimiter, skipinitialspace=True)
        while rows := list(islice(reader, _BLOCK_ROWS)):
            last_line = layout.skip_lines + reader.line_num
            line = row_numbers(last_line - len(rows) + 1, len(rows))
            if set(map(len, rows)) != {width} or "\0" in rows[-1][-1]:
                at_end = len(rows) < _BLOCK_ROWS
                rows, line = _repair(path, rows, line, width, at_end, notes)
            if rows:
                yield rows, line
            if progress:
                progress(bytes_read(stream), size)


def _repair(
    path: Path, rows: list[list[str]], line: np.ndarray, width: int, at_end: bool, notes: list[Note]
) -> tuple[list[list[str]], np.ndarray]:
    """The rows without empty lines, comments, surplus empty cells and a last line that was cut off."""
    filled = [i for i, row in enumerate(rows) if any(row) and not row[0].startswith("#")]
    rows = [_trimmed(rows[i], width) for i in filled]
    line = line[filled]
    if at_end and rows and (len(rows[-1]) < width or "\0" in "".join(rows[-1])):
        notes.append(Note(f"the last line ({line[-1]}) is cut off: dropped", "warning"))
        rows = rows[:-1]
        line = line[:-1]
    for row, at in zip(rows, line, strict=True):
        if len(row) != width:
            raise InputError(
                f"{path.name}, line {at}: {len(row)} cells where the header has {width}; "
                "repair or delete the line (a text with the delimiter in it needs quotes)"
            )
    return rows, line


def _trimmed(row: list[str], width: int) -> list[str]:
    while len(row) > width and not row[-1].strip():
        row = row[:-1]
    return row


def _parse(cells: Sequence[str], decimal_comma: bool) -> np.ndarray:
    """(T,) float64 where every cell is a number or missing, else the text as dtype object."""
    numbers = [cell.replace(",", ".") for cell in cells] if decimal_comma else cells
    try:
        return np.fromiter(map(float, numbers), float, len(numbers))
    except ValueError:
        pass
    try:
        return np.fromiter(map(number, numbers), float, len(numbers))
    except ValueError:
        return np.array(numbers, dtype=object)


def _join(blocks: list[np.ndarray]) -> np.ndarray:
    if any(block.dtype == object for block in blocks):
        blocks = [block.astype(str).astype(object) if block.dtype != object else block for block in blocks]
    return np.concatenate(blocks)
