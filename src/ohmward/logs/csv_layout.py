"""The layout of a text table: encoding, header, delimiter, notation of numbers; found from its first lines."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple, TextIO

from ohmward.errors import InputError
from ohmward.logs.cells import (
    Header,
    Marks,
    ValueBlock,
    find_block,
    find_header,
    find_marks,
    is_value,
    unit_in_cells,
    units_beside,
    with_unit_of_cells,
)
from ohmward.logs.channels import BATTERY, letters
from ohmward.logs.columns import unique_names
from ohmward.logs.dates import has_date
from ohmward.logs.hints import FileHints
from ohmward.logs.long_table import long_columns
from ohmward.logs.units import Unit

#: Byte-order marks at the beginning of a text, the longest first: that of UTF-32 LE begins with that of UTF-16 LE.
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
#: Encodings other than UTF-8. Western Europe first: it wins if no word decides.
CODE_PAGES = (
    *("cp1252", "cp1251", "cp932", "gb18030", "big5", "cp949", "cp1250", "cp1253", "cp1254", "mac_roman", "koi8_r"),
    *("cp866", "cp850"),
)

_WORDS = frozenset(word for channel in BATTERY for words in channel.words for word in words if len(word) > 1)
_ACCENTED = re.compile(r"(?=\w*[^\x00-\x7f])[^\W\d_]+")


def find_encoding(head: bytes) -> str:
    """The encoding of a text that begins with these bytes."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if wide := _without_mark(head):
        return wide
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return _code_page(head)
    return "utf-8-sig"


def is_wide(encoding: str) -> bool:
    """True where a plain letter takes several bytes, zeros among them."""
    return encoding.lower().replace("_", "-").startswith(("utf-16", "utf-32"))


def _without_mark(head: bytes) -> str:
    """UTF-16 or UTF-32 by the places of the zero bytes in ASCII letters and digits; "" for neither."""
    sample = head[: len(head) & ~3][:4096]
    if len(sample) < 8:
        return ""
    places = "".join("0" if sample[k::4].count(0) > 0.8 * (len(sample) // 4) else "x" for k in range(4))
    return {"x000": "utf-32-le", "000x": "utf-32-be", "x0x0": "utf-16-le", "0x0x": "utf-16-be"}.get(places, "")


def _code_page(head: bytes) -> str:
    """The encoding in which most words name a quantity."""

    def known(encoding: str) -> int:
        text = head.decode(encoding, errors="ignore")
        units = len(re.findall(r"[°℃µ]", text[:2000]))
        words = {word for accented in set(_ACCENTED.findall(text[:20_000])) for word in letters(accented)}
        return 2 * len(_WORDS & words) + (units > 0)

    return max(CODE_PAGES, key=known)


#: Fields of sensor_msgs/BatteryState up to the cells, as `ros2 topic echo --csv` writes them in a row without names.
_BATTERY_STATE = (
    "header.stamp.sec", "header.stamp.nanosec", "header.frame_id", "voltage [V]", "temperature [degC]", "current [A]",
    "charge", "capacity", "design_capacity", "percentage", "power_supply_status", "power_supply_health",
    "power_supply_technology", "present",
)  # fmt: skip
_PRESENT = _BATTERY_STATE.index("present")


#: Columns that identify a known table, and the fields of its `TableFile`.
_KNOWN: tuple[tuple[frozenset[str], dict[str, Any]], ...] = (
    # battery_status of PX4, as `ulog2csv` writes it: time since it was switched on
    (
        frozenset(("timestamp", "voltage_v", "current_a", "discharged_mah")),
        {"time": "timestamp", "units": {"time": "us"}, "positive_current": "discharge"},
    ),
    # a blackbox of Betaflight, as its explorer exports it
    (
        frozenset(("loopIteration", "vbatLatest", "amperageLatest")),
        {"units": {"time": "us", "voltage": "cV", "current": "cA"}, "positive_current": "discharge"},
    ),
    # a power supply under Linux, /sys/class/power_supply: tenths of a degree
    (frozenset(("voltage_now", "current_now", "temp")), {"units": {"temperature": "0.1 degC"}}),
)


def known_table(names: Collection[str]) -> dict[str, Any]:
    """Further fields of the `TableFile` of a table with these columns, if they identify it."""
    return next((about for columns, about in _KNOWN if columns <= set(names)), {})


def names_without_header(row: Sequence[str]) -> list[str] | None:
    """Names of the columns of a row that `ros2 topic echo --csv` writes for a BatteryState; None for any other row."""
    cells = [cell.strip() for cell in row]
    if len(cells) <= _PRESENT or cells[_PRESENT] not in ("True", "False"):
        return None
    whole = [cells[k] for k in (0, 1, 10, 11, 12)]
    if not all(re.fullmatch(r"\d+", cell) for cell in whole):
        return None
    rest = len(cells) - len(_BATTERY_STATE)
    return [*_BATTERY_STATE, *(f"field_{k}" for k in range(rest))]


_HEAD_LINES = 400
_HEAD_CHARACTERS = 1 << 20
_LAYOUT_BYTES = 1 << 16
#: Control characters, which no text has in its first lines.
_CONTROL, _BEGINNING = re.compile(rb"[\0-\x08\x0e-\x1f]"), 3
#: Above this share of lines with zeros a file is damaged or binary, not cut by a power failure.
_DAMAGED_LINES = 0.02
#: A gzip file may unpack to this many bytes, or to this many times its size: logs shrink by a factor of 3 to 20.
UNPACKED_BYTES, UNPACKED_TIMES = 16 << 20, 100
_COMMENT = ("#", "%", "//", "~")
#: A line below the names, `---- -------` or `|---|---:|`.
_RULE = re.compile(r"[\s|+:=-]*[-=]{3}[\s|+:=-]*")
# Ties go to the first: a comma may also be a decimal mark, and spaces stand in dates.
_DELIMITERS = "\t;,|"
#: Excel's first line, which names the delimiter.
_SEPARATOR_LINE = re.compile(r'^"?sep=(?P<mark>.)"?$', re.IGNORECASE)
#: Interval of a LabVIEW measurement whose rows carry no time.
_INTERVAL = re.compile(r"^Delta_X\s+(?P<seconds>[\d.,Ee+-]+)")
#: Lines processed at a time.
_BLOCK_LINES = 5_000
#: Lines read on where a block may end within a quoted cell.
_LINES_OF_CELL = 50
#: Separator after the time that the serial monitor of Arduino writes before a line.
_ARROW = " -> "
#: Delimiters take precedence over spaces, which occur in dates and names, if they divide this share of the rows.
_MOSTLY = 0.5
#: Lines with more cells, each of which begins with a name, are the columns of a table.
_MOST_QUANTITIES = 30
#: Cells of each column from which its notation is found.
_HEAD_ROWS = 200


class CsvLayout(NamedTuple):
    """Column names and the rows of a text table."""

    names: tuple[str, ...]
    delimiter: str  #: one character
    marks: Marks  #: notation of the numbers
    skip_lines: int  #: lines before the first row
    encoding: str = "utf-8-sig"  #: of the text
    split: Callable[[str], str] | None = None  #: puts delimiters between the cells of a line that has none
    units: Mapping[str, Unit] = {}  #: column -> unit found in its cells
    #: column -> its first cells
    head: Mapping[str, tuple[str, ...]] = {}

    #: that the text names, or None
    timezone: str | None = None
    interval_s: float | None = None
    leading: int = 0  #: empty cells before each row, which the rows of steps and cycles in between do not have

    @property
    def plain(self) -> bool:
        """True if the cells are numbers between delimiters, in ASCII bytes."""
        return (
            self.split is None
            and not self.leading
            and not self.units
            and not self.marks.thousands
            and not is_wide(self.encoding)
        )


class _Split(NamedTuple):
    """A way to divide lines into cells, and the block of values that it finds."""

    delimiter: str
    split: Callable[[str], str] | None
    rows: list[list[str]]
    block: ValueBlock


GZIP_MAGIC = b"\x1f\x8b"


class LimitedGzip(gzip.GzipFile):
    """A gzip file that ends where it was cut off, and refuses to be read once it has unpacked to too much for a log."""

    def __init__(self, path: Path, mode: Literal["rb"]) -> None:
        super().__init__(path, mode)
        self.packed: Any = self.fileobj
        self.is_cut = False

    def read1(self, size: int = -1) -> bytes:
        """Up to so many bytes; none where the file was cut off."""
        unpacked, taken = self.tell(), max(self.packed.tell(), 1)
        if unpacked > UNPACKED_BYTES and unpacked > UNPACKED_TIMES * taken:
            raise InputError(
                f"{Path(self.name).name}: the gzip file unpacks to more than {UNPACKED_BYTES >> 20} MiB and "
                f"{UNPACKED_TIMES} times its size, as no log does; if it is one, unpack it with gunzip first"
            )
        try:
            return super().read1(size)
        except EOFError:
            self.is_cut = True
            return b""


def open_text(path: Path, encoding: str | None = None) -> TextIO:
    """The file as text, plain or gzip, in an encoding, or in the one found; InputError where it is not text."""
    with path.open("rb") as stream:
        opener = LimitedGzip if stream.read(2) == GZIP_MAGIC else open
    if encoding is None:
        with opener(path, "rb") as stream:
            head = b""
            while len(head) < _LAYOUT_BYTES and (part := stream.read1(_LAYOUT_BYTES - len(head))):
                head += part
        encoding = find_encoding(head)
        if not is_wide(encoding):
            _require_text(path, head)
    return io.TextIOWrapper(opener(path, "rb"), encoding, errors="replace", newline="")


def _require_text(path: Path, head: bytes) -> None:
    """Refuse binary data; a power failure leaves zeros at the end of a file, and in single lines."""
    lines = head.rstrip(b"\0\r\n").split(b"\n")
    binary = [k for k, line in enumerate(lines) if b"\0" in line]
    if binary and _CONTROL.search(b"\n".join(lines[:_BEGINNING])):
        raise InputError(
            f"{path.name}: not a text table (binary data in its first bytes), and no format that ohmward knows by "
            "them; export the log as CSV, Parquet or Excel with the program that wrote it"
        )
    if len(binary) > max(1.0, _DAMAGED_LINES * len(lines)):
        raise InputError(
            f"{path.name}: damaged from line {binary[0] + 1} on, where binary data follows the text; keep the lines "
            f"before, as with `head -n {binary[0]}`"
        )


def bytes_read(stream: TextIO) -> int:
    """The position [bytes] of a stream of `open_text` in its file, packed or not."""
    return getattr(stream.buffer, "fileobj", stream.buffer).tell()


def is_cut(stream: TextIO) -> bool:
    """True for a stream of `open_text` that has ended where its gzip file was cut off."""
    return getattr(stream.buffer, "is_cut", False)


def find_layout(path: Path, hints: FileHints | None = None) -> CsvLayout:
    """Read the head of a text table.

    Comments (`#`, `%`, `//`, `~`), a preamble of any text and empty lines may stand before the header, a row of units
    below it. Without a header, the last comment is used, as `numpy.savetxt` and `rostopic echo -p` write it.

    Raises:
        InputError: empty file, no header, one column only.
    """
    hints = hints or FileHints()
    with open_text(path, hints.encoding) as stream:
        encoding = stream.encoding
        lines = _head(path, stream)
    separator = _SEPARATOR_LINE.match(lines[0].strip()) if lines else None
    first, mark = (1, separator["mark"]) if separator else (0, "")
    rows = (k for k in range(first, len(lines)) if lines[k].strip() and not lines[k].startswith(_COMMENT))
    numbered = [k for k in rows if _RULE.fullmatch(lines[k]) is None]
    if not numbered:
        raise InputError(f"{path.name}: the file is empty; a log needs a header line and rows below it")
    text = [lines[k] for k in numbered]
    found = _best_split(text, mark)
    if found is None:
        return _without_rows(path, text, numbered, encoding, mark)
    header = _header(path, lines[: numbered[found.block.first]], found, hints)
    header = header._replace(names=unique_names(header.names))
    _check_names(path, header.names, encoding)
    data = [row for row in found.rows[header.first :] if len(row) >= len(header.names)][:_HEAD_ROWS]
    skip = numbered[header.first] if header.first < len(numbered) else len(lines)
    leading = _leading(header, found.rows)
    data = [row for row in data if not any(row[:leading])]
    names = header.names
    if not names[0] and data and "time" not in names and all(has_date(row[0]) for row in data):
        names = ("time", *names[1:])  # the index of pandas, PicoLog
    layout = CsvLayout(names, found.delimiter, Marks(), skip, encoding, found.split, leading=leading)
    interval = next((match["seconds"] for line in lines[:skip] if (match := _INTERVAL.match(line))), None)
    return _with_notation(path, layout, data)._replace(
        timezone=header.timezone, interval_s=None if interval is None else float(interval.replace(",", "."))
    )


def _head(path: Path, stream: TextIO) -> list[str]:
    """The first lines; InputError if they cannot be those of a table."""
    lines: list[str] = []
    left = _HEAD_CHARACTERS
    while len(lines) < _HEAD_LINES and (line := stream.readline(left)):
        left -= len(line)
        if left <= 0:
            if not lines:
                raise InputError(
                    f"{path.name}: its first line has more than {_HEAD_CHARACTERS} characters: no text table; "
                    "ohmward reads CSV, JSON, Parquet and others: export the log to one of them"
                )
            break
        lines.append("" if "\0" in line else line.rstrip("\r\n"))
    return lines


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line; a stray quote is a character like any other."""
    if line.count('"') % 2:
        line = line.replace('"', "")
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _best_split(lines: Sequence[str], mark: str) -> _Split | None:
    """The way of dividing the lines that makes most of them rows of values."""
    if sum(_ARROW in line for line in lines) > _MOSTLY * len(lines):
        return _heaviest([_split_by(lines, one, partial(_at_arrow, delimiter=one)) for one in mark or _DELIMITERS])
    # a tab behind a comma, as Arbin writes it before dates, keeps Excel from changing the cell
    tabs_are_cells = sum(",\t" in line for line in lines) > _MOSTLY * len(lines)
    delimiters = mark or (_DELIMITERS.replace("\t", "") if tabs_are_cells else _DELIMITERS)
    marked = _heaviest([_split_by(lines, delimiter, None) for delimiter in delimiters])
    if marked is None and all(line[:1] == line[-1:] == '"' for line in lines):  # each line in quotes, as one cell
        marked = _heaviest([_split_by(lines, delimiter, _unquoted) for delimiter in delimiters])
    if mark or (marked is not None and marked.block.length >= _MOSTLY * len(lines)):
        return marked
    spaced = _heaviest([_split_by(lines, "\t", _at_spaces), _fixed_width(lines)])
    if marked is None or spaced is None:
        return marked or spaced
    return marked if marked.block.length >= _MOSTLY * spaced.block.length else spaced


def _heaviest(found: Sequence[_Split | None]) -> _Split | None:
    fits = [one for one in found if one is not None]
    return max(fits, key=lambda one: (round(one.block.weight, 6), -fits.index(one)), default=None)


def _split_by(lines: Sequence[str], delimiter: str, split: Callable[[str], str] | None) -> _Split | None:
    try:
        rows = [split_cells(split(line) if split else line, delimiter) for line in lines]
    except csv.Error:
        return None
    block = find_block(rows)
    if block is None or block.width < 2:
        return None
    if split is _at_spaces and len({len(row) for row in rows[block.first :][: block.length]}) > 1:
        return None  # in a table with empty cells spaces do not show the columns
    return _Split(delimiter, split, rows, block)


def _at_arrow(line: str, delimiter: str) -> str:
    return line.replace(_ARROW, delimiter, 1)


def _unquoted(line: str) -> str:
    return line.strip()[1:-1].replace('""', '"')


def _at_spaces(line: str) -> str:
    return "\t".join(line.split())


def _fixed_width(lines: Sequence[str]) -> _Split | None:
    """Columns between the places at which every line below the preamble has a space."""
    width = max(map(len, lines))
    alike = [line for line in lines if len(line) > 0.5 * width]
    if len(alike) < 3 or any("\t" in line for line in alike):
        return None
    used = [any(k < len(line) and line[k] != " " for line in alike) for k in range(width)]
    begins = [k for k in range(width) if used[k] and (k == 0 or not used[k - 1])]
    if len(begins) < 2:
        return None
    bounds = list(zip(begins, [*begins[1:], None], strict=True))
    return _split_by(lines, "\t", lambda line: "\t".join(line[a:b].strip() for a, b in bounds))


def _header(path: Path, before: Sequence[str], found: _Split, hints: FileHints) -> Header:
    """The header of a block of values: from the user, the rows above, a comment, or a known format without one."""
    width = found.block.width
    if hints.names is not None:
        if len(hints.names) != width:
            raise InputError(
                f"{path.name}: --names has {len(hints.names)} names for {width} columns; the first row is "
                f"{found.rows[found.block.first]}"
            )
        return Header(tuple(hints.names), None, found.block.first)
    header = find_header(found.rows, found.block)
    if header.row is not None:
        return header
    row = found.rows[found.block.first]
    names = names_without_header(row)
    # or the last comment above the rows, where it has as many cells
    if comments := [line.lstrip("#%/~ ") for line in before if line.strip()]:
        comment = found.split(comments[-1]) if found.split else comments[-1]
        cells = [cell.strip() for cell in split_cells(comment, found.delimiter)]
        names = cells if len(cells) == width else names
    if names is None:
        excerpt = found.delimiter.join(row)[:60]
        if width > _MOST_QUANTITIES and not any(is_value(row[0]) for row in found.rows):
            raise InputError(f"{path.name}: a quantity in each line ({excerpt!r}); exchange its rows and columns")
        raise InputError(
            f"{path.name}: no header line: the first row is numbers ({excerpt!r}); name its {width} columns in their "
            "order with --names time_s,current_A,voltage_V,... (FileHints(names=[...])), or put such a line above it"
        )
    return Header(tuple(names), None, found.block.first)


def _with_notation(path: Path, layout: CsvLayout, data: Sequence[Sequence[str]]) -> CsvLayout:
    """The layout with the notation of numbers and the units found in the first rows."""
    columns = [[row[k] for row in data] for k in range(len(layout.names))]
    marks = find_marks(columns, layout.delimiter)
    if marks is None:
        cell = next(cell for cells in columns for cell in cells if "," in cell)
        raise InputError(
            f"{path.name}: the comma in {cell!r} may stand before decimals or between thousands; write the numbers "
            "without marks between thousands"
        )
    units = {name: unit for name, cells in zip(layout.names, columns, strict=True) if (unit := unit_in_cells(cells))}
    beside = {} if long_columns(layout.names) else units_beside(dict(zip(layout.names, columns, strict=True)))
    named = {name: with_unit_of_cells(name, units.get(name) or beside.get(name)) for name in layout.names}
    return layout._replace(
        names=tuple(named[name] for name in layout.names),
        marks=marks,
        units={named[name]: unit for name, unit in units.items()},
        head={named[name]: tuple(cells) for name, cells in zip(layout.names, columns, strict=True) if name},
    )


def _leading(header: Header, rows: Sequence[Sequence[str]]) -> int:
    """Number of empty cells before the names of records; the names of steps above have one less (Neware's export)."""
    count = next((k for k, name in enumerate(header.names) if name), 0)
    above = rows[header.row - 1] if header.row else []
    return count if count > 1 and len(above) >= count and not any(above[: count - 1]) and above[count - 1] else 0


def _without_rows(path: Path, lines: Sequence[str], numbered: Sequence[int], encoding: str, mark: str) -> CsvLayout:
    """The layout of a file whose first lines hold no row of values: a header alone, or no table."""
    marks = [mark] if mark else [one for one in _DELIMITERS if len(split_cells(lines[0], one)) > 1]
    delimiter = max(marks, key=lambda one: len(split_cells(lines[0], one)), default=",")
    names = unique_names([name.strip() for name in split_cells(lines[0], delimiter)])
    _check_names(path, names, encoding)
    return CsvLayout(names, delimiter, Marks(), numbered[0] + 1, encoding)


def _check_names(path: Path, names: Sequence[str], encoding: str) -> None:
    if len([name for name in names if name]) < 2:
        excerpt = names[0][:60] if names else ""
        other = f", or name another encoding than {encoding} with --encoding" if encoding in CODE_PAGES else ""
        raise InputError(
            f"{path.name}: only one column found ({excerpt!r}); "
            f"columns must be separated by a comma, semicolon, tab or spaces and named in a line above the rows{other}"
        )


def lines_of(stream: TextIO, layout: CsvLayout, stray: list[int], damaged: list[int]) -> Iterator[str]:
    """The lines below the header, one row each; behind a row with line breaks in a quoted cell stand empty lines.

    An unclosed quote is left out, and its line number added to `stray`; a line with zeros that a power failure left is
    empty, and added to `damaged`. The last line keeps them.
    """
    first = layout.skip_lines + 1
    for _ in islice(stream, layout.skip_lines):
        pass
    while block := list(islice(stream, _BLOCK_LINES)):
        if "\0" in "".join(block):
            zeros = [k for k, line in enumerate(block) if "\0" in line and line.endswith("\n")]
            damaged += [first + k for k in zeros]
            block = ["\n" if k in zeros else line for k, line in enumerate(block)]
        if '"' in "".join(block):
            if "".join(block).count('"') % 2:
                block += islice(stream, _LINES_OF_CELL)
            block = block if layout.split else _with_whole_cells(block, layout)
            stray += [first + k for k, line in enumerate(block) if line.count('"') % 2]
            block = [line.replace('"', "") if line.count('"') % 2 else line for line in block]
        if layout.leading:
            empty = layout.delimiter * layout.leading
            block = [line if line.startswith(empty) else "\n" for line in block]
        yield from map(layout.split, block) if layout.split else block
        first += len(block)


def _with_whole_cells(lines: list[str], layout: CsvLayout) -> list[str]:
    """The lines, with those of a quoted cell with line breaks joined in its first and empty behind it (RFC 4180).

    A quote that nothing closes joins nothing: the lines behind it are rows themselves.
    """
    whole, width = list(lines), len(layout.names)

    def is_row(line: str) -> bool:
        return len(split_cells(line.replace('"', ""), layout.delimiter)) == width

    unclosed = [k for k, line in enumerate(lines) if line.count('"') % 2]
    for first, last in pairwise(unclosed):
        begin, *within, end = lines[first : last + 1]
        is_joined = whole[first] != begin
        if is_joined or len(within) > _LINES_OF_CELL or any(map(is_row, within)) or (is_row(begin) and is_row(end)):
            continue
        row = " ".join(line.rstrip("\r\n") for line in (begin, *within, end))
        if len(split_cells(row, layout.delimiter)) == width:
            whole[first : last + 1] = [f"{row}\n", *["\n"] * (last - first)]
    return whole
