"""A file or DataFrame as columns, whatever they mean, and notes on what was done with it.

Recordings of several streams (topics, messages of a bus, tables), each with times of its own, become one table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ohmward.errors import InputError, OhmwardError
from ohmward.logs.hints import TOPIC, FileHints


class Note(NamedTuple):
    """One thing that was assumed, converted, dropped or found; `level` is "info" or "warning"."""

    text: str
    level: str = "info"
    options: tuple[str, ...] = ()  #: command-line options that correct it, if it is a fault

    def __str__(self) -> str:
        return f"{self.level}: {self.text}"


def counted(count: int, noun: str) -> str:
    """A count with its noun for a message: "1 row", "2 rows"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


#: Called now and then with the amount done and the total: rows, or bytes of a text file.
Progress = Callable[[int, int], None]

#: Cell texts that mean a missing number, in lower case.
MISSING = frozenset(
    ("", "nan", "na", "n/a", "#n/a", "#div/0!", "null", "none", "-", "--", ".nan", "unavailable", "unknown")
)


#: Endings of logs, and of recordings of ROS.
LOG_ENDINGS = (
    *(".csv", ".csv.gz", ".tsv", ".txt", ".mpt", ".lvm", ".log", ".asc", ".trc", ".blf", ".mf4", ".yaml"),
    *(".parquet", ".feather", ".ulg", ".bin", ".tlog", ".mat", ".h5", ".hdf5", ".npz", ".mpr", ".nda", ".ndax", ".db"),
    *(".jsonl", ".ndjson", ".json", ".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"),
)
RECORDING_ENDINGS = (".mcap", ".db3", ".bag")


class Table(NamedTuple):
    """Columns of one file, and the place of each row in it."""

    source: str  #: the file's name, for messages
    columns: Mapping[str, np.ndarray]  #: name -> (T,); numbers, datetime64, timedelta64, or text (dtype object)
    line: np.ndarray  #: (T,) int, the row's line in a text file or its number (from 1) elsewhere
    place: str  #: "line" or "row", for messages
    notes: tuple[Note, ...] = ()  #: of the reader, on what it dropped

    def pick(self, rows: np.ndarray) -> Table:
        """The rows that a mask or indices pick."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return self._replace(columns=columns, line=self.line[rows])

    def only(self, names: Collection[str]) -> Table:
        """The columns of these names alone."""
        return self._replace(columns={name: values for name, values in self.columns.items() if name in names})

    def with_columns(self, columns: Mapping[str, np.ndarray], *notes: Note) -> Table:
        """The table with columns (T,) added or replaced, and further notes."""
        return self._replace(columns={**self.columns, **columns}, notes=(*self.notes, *notes))

    def with_notes(self, *notes: Note) -> Table:
        """The table with further notes."""
        return self._replace(notes=(*self.notes, *notes))


class ColumnLoader(Protocol):
    """Reads the named columns of a file into a Table."""

    def __call__(self, names: Collection[str], progress: Progress | None = None) -> Table:
        """The columns; those that the file does not have are left out."""
        ...


class TableFile(NamedTuple):
    """A file or DataFrame whose column names are known and whose columns are read on demand."""

    source: str  #: its name, for messages
    names: tuple[str, ...]  #: the columns in the file's order
    load: ColumnLoader  #: reads columns
    time: str | None = None  #: the column that is the time whatever its name, or None
    #: for a ROS recording, the file with only the topics of a battery or of a drive; see `part`
    choose: Callable[[str, Mapping[str, float | str]], TableFile] | None = None
    #: "charge" or "discharge" where the format defines the effect of a positive current
    positive_current: str | None = None
    head: Mapping[str, Sequence[str]] = {}  #: column -> its first cells, for a text file
    hints: FileHints = FileHints()  #: facts given by the user or the file's preamble
    units: Mapping[str, str] = {}  #: quantity -> unit that the format defines

    def part(self, kind: str, where: Mapping[str, float | str] | None = None) -> TableFile:
        """The columns of a "battery" or of a "drive", where the file keeps them apart; otherwise the file as it is.

        where: column -> value of the rows wanted; its `topic` names topics.
        """
        return self.choose(kind, where or {}) if self.choose else self

    def given(self, columns: Mapping[str, str] | None) -> dict[str, str]:
        """The columns that the caller names, and the time column if the file defines it and the caller does not."""
        return ({"time": self.time} if self.time else {}) | dict(columns or {})

    @property
    def stem(self) -> str:
        """The name without .csv, .bdf.csv, .csv.gz, .mcap and the like."""
        stem = self.source
        for ending in (".gz", *LOG_ENDINGS, *RECORDING_ENDINGS, ".bdf"):
            stem = stem.removesuffix(ending)
        return stem

    def read_once(self) -> TableFile:
        """The same file for several readers: the first load reads all of it, the others nothing."""
        read: list[Table] = []

        def load(names: Collection[str], progress: Progress | None = None) -> Table:
            if not read:
                read.append(self.load(self.names, progress))
            return read[0].only(names)

        return self._replace(load=load)

    def with_column(
        self, name: str, sources: Collection[str], make: Callable[[Table], tuple[np.ndarray, Note]]
    ) -> TableFile:
        """The file with one more column (T,) and its note, computed from other columns on loading."""

        def load(names: Collection[str], progress: Progress | None = None) -> Table:
            if name not in names:
                return self.load(names, progress)
            table = self.load([*names, *sources], progress)
            values, note = make(table)
            return table.with_columns({name: values}, note)

        return self._replace(names=(*self.names, name), load=load)


def file_of(table: Table, hints: FileHints, **about: Any) -> TableFile:
    """The TableFile of a table in memory; about: further fields of `TableFile`."""
    return TableFile(
        table.source, tuple(table.columns), lambda names, progress=None: table.only(names), hints=hints, **about
    )


#: Opens a file with the facts that are known about it.
#:
#: Raises:
#:     InputError: damaged, or no log in it; names the file and what to do.
#:     OhmwardError: a package that the format needs is not installed.
Opener = Callable[[Path, FileHints], TableFile]


@contextmanager
def parsing(path: Path, fault: str, advice: str) -> Iterator[None]:
    """Turn any exception of a parser into an InputError with the fault, the parser's message and the advice."""
    try:
        yield
    except OhmwardError:
        raise
    except BaseException as error:
        # a panic of a parser in Rust is no Exception
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise InputError(f"{path.name}: {fault} ({error}); {advice}") from error


def require_unique(source: str, names: Sequence[str]) -> None:
    """Raise InputError if a name occurs twice."""
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{source}: more than one column is named {twice[0]!r}; rename them so that each is unique")


def with_sample_time(file: TableFile) -> TableFile:
    """The file with a time column, if the hints give the interval between rows."""
    interval_s = file.hints.sample_time_s
    if interval_s is None:
        return file
    time = "time of the row [s]"
    note = Note(f"a row every {interval_s:g} s, without a time of its own")
    rows = file.with_column(time, (), lambda table: (interval_s * np.arange(table.line.size), note))
    return rows._replace(time=time)


def in_order(path: Path) -> list[tuple[int, int | str]]:
    """Sort key for files by name, in which part 9 comes before part 10."""
    return [(1, int(part)) if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", path.name)]


def row_numbers(first: int, count: int) -> np.ndarray:
    """The numbers first, first + 1, ... (count,); as int32 where they fit."""
    last = first + count - 1
    return np.arange(first, last + 1, dtype=np.int32 if last <= np.iinfo(np.int32).max else np.int64)


def number(cell: str) -> float:
    """The number in a cell, NaN for a cell that means a missing one; ValueError for any other text."""
    return math.nan if cell.strip().lower() in MISSING else float(cell)


def can_read(read: Callable[[str], object], cell: str) -> bool:
    """True if a reader accepts the cell without a ValueError."""
    try:
        read(cell)
    except ValueError:
        return False
    return True


def held(values: np.ndarray) -> np.ndarray:
    """Values (T,), each of which holds until the next one; NaN before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


_HEXADECIMAL = re.compile(r"0x[0-9a-f]+|(?=.*\d)[0-9a-f]{4,}", re.IGNORECASE)


def numbers(table: Table, name: str) -> np.ndarray:
    """The column (T,) as float64, durations in seconds; InputError for a text, with its line."""
    values = table.columns[name]
    if values.dtype.kind in "fiu":
        return values.astype(float, copy=False)
    if values.dtype.kind == "m":
        return values / np.timedelta64(1, "s")
    found = np.empty(values.size)
    for row, cell in enumerate(values):
        try:
            found[row] = number(str(cell))
        except ValueError:
            fix = "correct the cell, leave it empty, or delete the line"
            if _HEXADECIMAL.fullmatch(str(cell)):
                fix = "it looks hexadecimal: convert the column to decimal numbers with their sign"
            where = f"{table.source}, {table.place} {table.line[row]}, column {name!r}"
            raise InputError(f"{where}: {str(cell)!r} is not a number; {fix}") from None
    return found


BATTERY, DRIVE, BOTH = "battery", "drive", "both"


class KnownType(NamedTuple):
    """A message type that is found without being named."""

    part: str  #: the subject of its messages: `battery`, `drive` or `both`
    columns: Mapping[str, str]  #: path of a field -> name of its column
    by_name_only: bool = False  #: read only if a topic of this type is named


def choose_topics(
    source: str,
    kind: str,
    where: Mapping[str, float | str],
    topics: Mapping[str, str],
    known: Mapping[str, KnownType],
    otherwise: Sequence[str] = (),
) -> list[str]:
    """Names of the topics of a battery or of a drive: those that `where` names, and others by their types.

    source: name of the recording, for messages.
    kind: `battery` or `drive`.
    where: its `topic` names topics, separated by commas.
    topics: name -> type of those in the recording.  known: types that are found.
    otherwise: those to choose where there are none.

    Raises:
        InputError: no such topic, none of this kind, or several of one type and none named.
    """
    listed = ", ".join(f"{name} ({type_})" for name, type_ in topics.items()) or "none"
    named = [name.strip() for name in str(where.get(TOPIC, "")).split(",") if name.strip()]
    if unknown := [name for name in named if name not in topics]:
        raise InputError(f"{source}: there is no topic {unknown[0]!r} that can be read; it has: {listed}")
    chosen = [name for name in named if topics[name] not in known or known[topics[name]].part in (kind, BOTH)]
    types = {topics[name] for name in chosen}
    for type_, about in known.items():
        if type_ in types or about.by_name_only or about.part not in (kind, BOTH):
            continue
        found = [name for name in topics if topics[name] == type_]
        if len(found) > 1:
            raise InputError(
                f"{source}: both {found[0]} and {found[1]} are of type {type_}; choose with --topic {found[0]} "
                f"(where={{'topic': {found[0]!r}}})"
            )
        chosen += found
    chosen = chosen or list(otherwise)
    if not chosen:
        first = next(type_ for type_, about in known.items() if about.part == kind)
        raise InputError(
            f"{source}: no topic of type {first}; name those for the {kind} with --topic /a,/b, and their "
            f"columns with --column where names are ambiguous; it has: {listed}"
        )
    return chosen


#: Name of the column of the time.
TIME = "time [s]"


class Stream(NamedTuple):
    """Messages of one kind."""

    type: str  #: tells streams of a battery from those of a drive
    time_s: np.ndarray  #: (n,) since 1970, or since the start; or dates
    columns: Mapping[str, np.ndarray]  #: name -> (n,)


class Streams(NamedTuple):
    """The streams of a recording."""

    source: str  #: name of the file, for messages
    streams: Mapping[str, Stream]  #: by name
    what: str  #: what they are, for the notes: "topics of PX4"
    known: Mapping[str, KnownType] = {}  #: types that are found without being named; {}: names of columns decide
    positive_current: str | None = None  #: as in `TableFile`
    notes: tuple[Note, ...] = ()
    hints: FileHints = FileHints()

    def open(self, chosen: Sequence[str] | None = None) -> TableFile:
        """The columns of the chosen streams, by default of all."""
        of_chosen = {name: self.streams[name] for name in (self.streams if chosen is None else chosen)}
        columns = dict.fromkeys([TIME, *(name for stream in of_chosen.values() for name in stream.columns)])

        def load(names: Collection[str], progress: Progress | None = None) -> Table:
            note = Note(f"{self.what}: {', '.join(_with_any(of_chosen, names))}")
            return rows_of(self.source, TIME, of_chosen, names, (note, *self.notes))

        return TableFile(self.source, tuple(columns), load, TIME, self._part, self.positive_current, hints=self.hints)

    def _part(self, kind: str, where: Mapping[str, float | str]) -> TableFile:
        """The columns of a battery or of a drive, or of the streams that `where` names."""
        types = {name: stream.type for name, stream in self.streams.items()}
        if self.known or TOPIC in where:
            return self.open(choose_topics(self.source, kind, where, types, self.known))
        return self.open()


def _with_any(streams: Mapping[str, Stream], wanted: Collection[str]) -> Mapping[str, Stream]:
    """The streams with a wanted column; all of them if none has one."""
    return {name: stream for name, stream in streams.items() if stream.columns.keys() & set(wanted)} or streams


def rows_of(
    source: str, time: str, streams: Mapping[str, Stream], wanted: Collection[str], notes: tuple[Note, ...]
) -> Table:
    """The columns of some streams, a row for each message, in order of time; InputError where there are no messages.

    time: name of the time column.
    """
    chosen = _with_any(streams, wanted)
    times = [stream.time_s for stream in chosen.values() if stream.time_s.size]
    if not times:
        raise InputError(f"{source}: no message of {', '.join(streams)}; a log needs samples")
    whole = np.concatenate(times)
    table: dict[str, np.ndarray] = {time: whole}
    begin = 0
    for stream in chosen.values():
        end = begin + stream.time_s.size
        for name, values in stream.columns.items():
            if name not in wanted:
                continue
            empty = np.full(whole.size, "", object) if values.dtype == object else np.full(whole.size, np.nan)
            with np.errstate(invalid="ignore"):  # a float32 may have the bits of a signalling NaN
                table.setdefault(name, empty)[begin:end] = values
        begin = end
    rows = Table(source, table, row_numbers(1, whole.size), "message", notes)
    return rows if len(chosen) == 1 else rows.pick(np.argsort(whole, kind="stable"))
