"""Text tables (CSV and the like), read by the standard library in blocks of rows, or by Arrow where they are plain."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from operator import itemgetter
from pathlib import Path
from types import ModuleType

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.cells import is_data, is_value, parse_cells, without_words
from ohmward.logs.csv_layout import (
    CsvLayout,
    bytes_read,
    find_layout,
    is_cut,
    known_table,
    lines_of,
    open_text,
    split_cells,
)
from ohmward.logs.frame import import_arrow, numbers_of
from ohmward.logs.hints import FileHints
from ohmward.logs.table import MISSING, Note, Progress, Table, TableFile, counted, row_numbers

_PARSED_ROWS = 50_000
#: The end of a file that shows whether its last number is whole: its bytes, its lines, and the fewest of them.
_LAST_BYTES, _LAST_LINES, _FEWEST_LINES = 1 << 12, 50, 6
#: Smallest share of lines of text among the rows at which these are no table.
_MOST_REMARKS = 0.5


def open_csv(path: Path, hints: FileHints | None = None) -> TableFile:
    """The columns of a text table, whatever its delimiter, encoding, notation of numbers and preamble; plain or gzip.

    Empty cells, `nan`, `NA`, `null` and `-` are NaN. A last line that was cut off is dropped and noted.

    Raises:
        InputError: not text, empty, no header, or (on loading) no rows or a row with the wrong number of cells.
    """
    hints = hints or FileHints()
    with readable(path):
        layout = find_layout(path, hints)

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        with readable(path):
            return _load(path, layout, [name for name in layout.names if name in names], progress)

    names = tuple(name for name in layout.names if name)
    timeless = layout.interval_s is not None and not any(map(str.strip, next(iter(layout.head.values()), ("0",))))
    hints = hints._replace(
        timezone=hints.timezone or layout.timezone,
        sample_time_s=hints.sample_time_s or (layout.interval_s if timeless else None),
    )
    return TableFile(path.name, names, load, head=layout.head, hints=hints, **known_table(names))


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn the errors of a damaged gzip file, of an endless cell and of an encoding into one that names the file."""
    try:
        yield
    except csv.Error as error:
        raise InputError(f"{path.name}: not a text table ({error}); export the log as CSV or Parquet") from error
    except UnicodeError as error:
        raise InputError(f"{path.name}: not in the encoding {error}; name another with --encoding") from error
    except Exception as error:
        # packages for cyclers replace zlib by a faster one, with an error of its own
        if not isinstance(error, gzip.BadGzipFile | zlib.error) and type(error).__name__ != "IsalError":
            raise
        raise InputError(f"{path.name}: the gzip file is damaged ({error}); unpack the intact part") from error


def _load(path: Path, layout: CsvLayout, names: list[str], progress: Progress | None) -> Table:
    if layout.plain and (plain := read_numbers(path, layout, names, progress)) is not None:
        table = Table(path.name, plain, row_numbers(layout.skip_lines + 1, len(plain[names[0]])), "line")
        return _without_cut_number(path, layout, table)
    columns: dict[str, list[np.ndarray]] = {name: [] for name in names}
    place = {name: k for k, name in enumerate(layout.names)}
    lines: list[np.ndarray] = []
    notes: list[Note] = []
    for rows, line in _blocks(path, layout, notes, progress):
        lines.append(line)
        for name in names:
            cells = list(map(itemgetter(place[name]), rows))
            try:
                columns[name].append(parse_cells(cells, layout.marks, layout.units.get(name)))
            except InputError as error:
                raise InputError(f"{path.name}, column {name!r}: {error}") from None
    if not lines:
        raise InputError(f"{path.name}: there is a header but no rows below it; a log needs samples")
    joined = {name: _join(blocks) for name, blocks in columns.items()}
    joined, of_words = without_words(path.name, joined, layout.marks, layout.units)
    table = Table(path.name, joined, np.concatenate(lines), "line", (*notes, *of_words))
    return _without_cut_number(path, layout, table)


def _without_cut_number(path: Path, layout: CsvLayout, table: Table) -> Table:
    """The table without its last row if the file ends in it, with fewer decimals than all of the lines before."""
    with path.open("rb") as stream:
        stream.seek(max(path.stat().st_size - _LAST_BYTES, 0))
        lines = re.split("[\r\n]+", stream.read().decode("latin-1"))[-_LAST_LINES:]
    rows = [split_cells(layout.split(line) if layout.split else line, layout.delimiter) for line in lines[1:]]
    if len(rows) < _FEWEST_LINES or any(len(row) != len(layout.names) for row in rows):
        return table
    *usual, last = [len(row[-1].partition("," if layout.marks.decimal_comma else ".")[2]) for row in rows]
    if last >= usual[0] or len(set(usual)) > 1:
        return table
    note = Note(f"the last line ({table.line[-1]}) is cut off: dropped", "warning")
    return table.pick(np.arange(table.line.size - 1)).with_notes(note)


def _blocks(
    path: Path, layout: CsvLayout, notes: list[Note], progress: Progress | None
) -> Iterator[tuple[list[list[str]], np.ndarray]]:
    """Rows of equal length and their line numbers; what was left out is added to `notes`."""
    width, last_name = len(layout.names), layout.names[-1].partition(" [")[0]
    size = path.stat().st_size
    stray: list[int] = []
    damaged: list[int] = []
    with open_text(path, layout.encoding) as stream:
        reader = csv.reader(lines_of(stream, layout, stray, damaged), delimiter=layout.delimiter, skipinitialspace=True)
        while rows := list(islice(reader, _PARSED_ROWS)):
            last_line = layout.skip_lines + reader.line_num
            line = row_numbers(last_line - len(rows) + 1, len(rows))
            last_cells = [row[-1] for row in rows if len(row) == width]
            if len(last_cells) < len(rows) or "\0" in last_cells[-1] or (last_name and last_name in last_cells):
                at_end = len(rows) < _PARSED_ROWS
                rows, line = _repair(path, layout, rows, line, at_end, notes)
            if rows:
                yield rows, line
            if progress:
                progress(bytes_read(stream), size)
        if is_cut(stream):
            notes.append(Note("the gzip file is cut off: its rows up to there are used", "warning"))
    for which, what in ((stray, "a quote that nothing closes"), (damaged, "zeros of a power failure")):
        if which:
            text = f"{what} in {counted(len(which), 'line')} (first in line {which[0]}): left out"
            notes.append(Note(text, "warning"))


def _repair(
    path: Path, layout: CsvLayout, rows: list[list[str]], line: np.ndarray, at_end: bool, notes: list[Note]
) -> tuple[list[list[str]], np.ndarray]:
    """The rows without empty lines, comments, surplus empty cells, further headers, text at the end and a cut line."""
    width = len(layout.names)
    header = [name.partition(" [")[0] for name in layout.names]
    filled = [i for i, row in enumerate(rows) if any(row) and not row[0].startswith("#")]
    headers = {i for i in filled if [cell.strip().partition(" [")[0] for cell in rows[i]][:width] == header}
    if headers:
        notes.append(Note(f"the header stands again in {counted(len(headers), 'line')}: left out", "warning"))
    filled = [i for i in filled if i not in headers]
    rows, line = [rows[i] for i in filled], line[filled]
    for k, row in enumerate(rows):
        while len(row) > width and not row[-1].strip():
            rows[k] = row = row[:-1]
    # a truncated row of numbers is no remark, nor are the zeros of a power failure
    remarks = [
        k
        for k, row in enumerate(rows)
        if len(row) != width and not (is_data(row) or is_value(row[0]) or "\0" in row[0])
    ]
    if remarks and len(remarks) < _MOST_REMARKS * len(rows):
        excerpt = layout.delimiter.join(rows[remarks[0]])[:40]
        text = f"{counted(len(remarks), 'line')} of text left out, the first in line {line[remarks[0]]}: {excerpt!r}"
        between = any(k + 1 < len(rows) and k + 1 not in remarks for k in remarks)
        notes.append(Note(text, "warning" if between else "info"))
        others = sorted(set(range(len(rows))) - set(remarks))
        rows, line = [rows[k] for k in others], line[others]
    if at_end and rows and (len(rows[-1]) < width or "\0" in "".join(rows[-1])):
        notes.append(Note(f"the last line ({line[-1]}) is cut off: dropped", "warning"))
        rows, line = rows[:-1], line[:-1]
    for row, at in zip(rows, line, strict=True):
        if len(row) != width:
            raise InputError(
                f"{path.name}, line {at}: {len(row)} cells where the header has {width}; "
                "repair or delete the line (a text with the delimiter in it needs quotes)"
            )
    return rows, line


def _join(blocks: list[np.ndarray]) -> np.ndarray:
    if any(block.dtype == object for block in blocks):
        blocks = [block.astype(str).astype(object) if block.dtype != object else block for block in blocks]
    return np.concatenate(blocks)


#: File size from which importing Arrow pays off.
WORTH_BYTES = 4 << 20
#: Bytes parsed at a time.
_BLOCK_BYTES = 1 << 23


def read_numbers(
    path: Path, layout: CsvLayout, names: Sequence[str], progress: Progress | None = None
) -> dict[str, np.ndarray] | None:
    """The named columns (T,) of a long table, read by Arrow, one row per line; None if any line is not plain.

    The numbers are exactly those that the standard library reads, which handles everything that is not plain (text,
    quotes, a truncated line).
    """
    size = path.stat().st_size
    if size < WORTH_BYTES or not names or (arrow := import_arrow()) is None or not (rows := _plain_rows(path, layout)):
        return None
    from pyarrow import csv

    keys = {name: str(layout.names.index(name)) for name in names}
    columns = {name: np.empty(rows) for name in names}
    first = 0
    try:
        with path.open("rb") as stream:
            for batch in csv.open_csv(stream, *_options(csv, arrow, layout, list(keys.values()))):
                last = first + batch.num_rows
                for name, key in keys.items():
                    columns[name][first:last] = numbers_of(batch[key])
                first = last
                if progress:
                    progress(stream.tell(), size)
    except MemoryError:  # Arrow's own is also an ArrowException
        raise
    except (arrow.ArrowException, OSError, ValueError):
        return None
    return columns if first == rows else None


def _options(csv: ModuleType, arrow: ModuleType, layout: CsvLayout, keys: list[str]) -> tuple:
    """Options for Arrow; columns are called by their number, because a file may leave some unnamed."""
    names = [str(k) for k in range(len(layout.names))]
    missing = sorted({"NaN", *(spelling for word in MISSING for spelling in (word, word.upper(), word.title()))})
    return (
        csv.ReadOptions(skip_rows=layout.skip_lines, column_names=names, block_size=_BLOCK_BYTES),
        csv.ParseOptions(delimiter=layout.delimiter, quote_char=False),
        csv.ConvertOptions(
            check_utf8=False,
            column_types=dict.fromkeys(keys, arrow.float64()),
            include_columns=keys,
            null_values=missing,
            decimal_point="," if layout.marks.decimal_comma else ".",
        ),
    )


def _plain_rows(path: Path, layout: CsvLayout) -> int:
    """Number of lines below the header; 0 if a quote may hide some, or a power failure left zeros."""
    lines = 0
    end = b"\n"
    with path.open("rb") as stream:
        for _ in range(layout.skip_lines):
            stream.readline()
        while block := stream.read(_BLOCK_BYTES):
            if b'"' in block or b"\0" in block:
                return 0
            lines += block.count(b"\n")
            end = block[-1:]
    return lines + (end != b"\n")
