"""The pipeline from a file, folder or DataFrame to the rows of one recording, the same for batteries and drives."""

from __future__ import annotations

import atexit
import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import arrays_file, can_file, selection, vehicle_file
from ohmward.logs.arrays_file import HDF5_MAGIC, is_ndax, open_hdf5, open_neware, open_numpy
from ohmward.logs.bags.bag_table import MAGICS, is_recording, open_bag
from ohmward.logs.battery_columns import has_log
from ohmward.logs.can_file import can_reader, open_can
from ohmward.logs.clean import drop_text, drop_untimed
from ohmward.logs.clock import date_column, read_clock
from ohmward.logs.columns import Column, fraction_column, listed, other_times
from ohmward.logs.csv_file import open_csv, readable
from ohmward.logs.csv_layout import GZIP_MAGIC, UNPACKED_BYTES, UNPACKED_TIMES, LimitedGzip
from ohmward.logs.frame import is_frame, open_frame, open_parquet
from ohmward.logs.hints import HEAD_BYTES, TOPIC, FileHints
from ohmward.logs.long_table import as_wide
from ohmward.logs.objects_file import names_values, open_objects
from ohmward.logs.selection import RECORDING, SeveralRecordingsError
from ohmward.logs.sqlite_file import MAGIC as SQLITE_MAGIC
from ohmward.logs.sqlite_file import open_sqlite_table
from ohmward.logs.table import (
    LOG_ENDINGS,
    Note,
    Opener,
    Progress,
    Table,
    TableFile,
    counted,
    in_order,
    parsing,
    row_numbers,
)
from ohmward.logs.vehicle_file import is_telemetry, open_telemetry
from ohmward.logs.workbook_file import open_workbook

_TO_SAVVYCAN = "; open it in SavvyCAN, save it as CSV of SavvyCAN (GVRET), and give that with --dbc"

#: First bytes of formats that are not read, what they are, and what to do instead.
_KNOWN = tuple(
    (re.compile(beginning, re.DOTALL), about)
    for beginning, about in (
        (
            rb"\x00\x01\x00\x00Standard (?:Jet|ACE) DB",
            "an Access database, as .res of Arbin; make one of SQLite: apt install mdbtools; pip install galvani; "
            "res2sqlite TEST.res TEST.db, and give TEST.db",
        ),
        (
            rb"H Product:Blackbox",
            "a blackbox of Betaflight or INAV; decode it with blackbox_decode (github.com/betaflight/blackbox-tools) "
            "and give the CSV file",
        ),
        (
            rb"TDS[mh]",
            "a TDMS file of LabVIEW; give TdmsFile.read('LOG.tdms').as_dataframe() of the package npTDMS as the log, "
            "or save it as CSV in Excel or DIAdem",
        ),
        (rb'VERSION "[^"\n]*"\s', "a database of a CAN bus; give the recording, and this file with --dbc"),
        (
            rb"(?i:date [^\n]*\n\s*base +\w+ +timestamps +relative)",
            "frames of a CAN bus with times that count from the event before; export it again with absolute ones",
        ),
        (rb"\*\*\*BUSMASTER", f"frames of a CAN bus of BUSMASTER{_TO_SAVVYCAN}"),
        (rb"\d{9,}\.\d+ (?:CXX|C[EV]\w|\d?[RT](?:11|29)) ", f"frames of a CAN bus of OVMS (CRTD){_TO_SAVVYCAN}"),
        (
            rb"\s*(?:\(\d+\.\d+\))?\s*\w*can\d+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]",
            "frames of a CAN bus as candump shows them; record them with `candump -l can0`, and give that with --dbc",
        ),
        (
            rb"(?i:(?!TimestampEpoch;)(?=[^\n]*\b(?:can[ _]?)?id\b)(?=[^\n]*\b(?:dlc|len|length)\b)"
            rb"[^\n]*\b(?:data|payload|d0|byte ?0))",
            f"frames of a CAN bus in a table of its own{_TO_SAVVYCAN}",
        ),
        (rb"\x80[\x02-\x05]", "a pickle of Python; load it where it was written, and give the DataFrame or a CSV file"),
        (
            rb"(?:\s|<\?xml[^>]*>|<!--(?:(?!-->).)*-->)*<robot\b",
            "a URDF; make a robot file of it with `ohmward robot FILE -o robot.toml`",
        ),
        (
            rb"\s*<(?i:!doctype html|html|head|meta|table)\b",
            "a page of HTML, as some programs export as .xls; save it as .xlsx or CSV in a spreadsheet program, or "
            "give pandas.read_html(FILE)[0]",
        ),
        (rb"\s*<\?xml", "XML; export the log as CSV with the program that wrote it, or give pandas.read_xml(FILE)"),
        (rb".{257}ustar", "an archive of tar; unpack it and name the log in it"),
        (rb"version https://git-lfs", "a pointer of Git LFS to the log; fetch that with `git lfs pull`"),
        (rb"%PDF-", "a PDF document; export the numbers as CSV"),
        (rb"7z\xbc\xaf|Rar!|\xfd7zXZ|BZh\d|\x28\xb5\x2f\xfd", "a packed file; unpack it first"),
    )
)


#: Names of standard input.
STANDARD_INPUT = ("-", "/dev/stdin")
#: Name of a log from standard input or a pipe.
_STREAM = "standard input"
#: Bytes copied at a time.
_AT_ONCE = 1 << 20


def _stored(read: Callable[[int], bytes], name: str) -> Path:
    """Copy a stream, which can be read only once, to a temporary file that is deleted when the process ends."""
    folder = Path(tempfile.mkdtemp(prefix="ohmward-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copy = folder / name
    with copy.open("wb") as target:
        target.writelines(iter(partial(read, _AT_ONCE), b""))
    return copy


def with_streams_stored(path: Path) -> Path:
    """The path, or for standard input or a pipe that of a copy; InputError for an empty one, and for a device."""
    is_input = str(path) in STANDARD_INPUT
    if not is_input and (path.is_char_device() or path.is_block_device()):
        raise InputError(
            f"{path} is a device, which has no end: store what it sends in a file, and give that; what a robot sends "
            f"on a serial line is read by `ohmward setup {path}`"
        )
    if not (is_input or path.is_fifo() or path.is_socket()):
        return path
    if is_input:
        copy = _stored(sys.stdin.buffer.read, _STREAM)
    else:
        with path.open("rb") as source:
            copy = _stored(source.read, _STREAM)
    if not copy.stat().st_size:
        raise InputError(f"{_STREAM} is empty; a log needs a header line and rows below it")
    return copy


def _open_folder(folder: Path, hints: FileHints) -> TableFile:
    """The files of a folder as one log, sorted by name with numbers in numeric order; all have the same columns."""
    paths = sorted((path for path in folder.iterdir() if path.name.lower().endswith(LOG_ENDINGS)), key=in_order)
    if not paths:
        raise InputError(f"{folder} is a folder; name one log file in it: none is called {', '.join(LOG_ENDINGS)}")
    files = []
    try:
        for path in paths:
            files.append(file := _open_file(path, hints))
            if other := sorted(set(file.names) ^ set(files[0].names)):
                raise InputError(f"{file.source} has other columns than {files[0].source} ({listed(other)})")
    except InputError as error:
        fix = f"Name one log file, or all of them ({folder / '*'}), or give the folder to `ohmward fleet`"
        if files and not any(has_log(file.names) for file in files):
            fix += ". If they hold the quantities of one log, join them by their times in one table, a column for each"
        raise InputError(f"{folder}: the files of this folder are not one log: {error}. {fix}") from None
    name = folder.resolve().name
    first = files[0]

    def load(names: Collection[str], progress: Progress | None = None) -> Table:
        tables = [file.load(names, progress) for file in files]
        columns = {name: np.concatenate([table.columns[name] for table in tables]) for name in tables[0].columns}
        rows = sum(table.line.size for table in tables)
        note = Note(f"{counted(len(files), 'file')} as one log, {first.source} to {files[-1].source}")
        notes = tuple(dict.fromkeys(note for table in tables for note in table.notes))
        return Table(name, columns, row_numbers(1, rows), "row", (note, *notes))

    return first._replace(source=name, load=load)


class Wanted(NamedTuple):
    """The part of a file to read, as in the arguments of `read_log`."""

    where: Mapping[str, float | str]
    extra: Collection[str] | None = None
    sort_time: bool = False
    progress: Progress | None = None
    time_given: bool = False  #: the caller or the file names the column of the time


class RecordedTable(NamedTuple):
    """The rows of one recording, numbers only, in order of time and without repeated times."""

    table: Table  #: its time in seconds; its notes say what was done
    columns: Mapping[str, Column]  #: channel -> column
    start_unix_s: float | None  #: Unix time of the clock's zero, None where it is not a wall clock
    own: frozenset[str]  #: the columns that are channels, labels or parts of the clock; all others are extra
    guessed_unit: bool = False  #: the unit of the time is a guess
    time_zone: str = "UTC"  #: of the dates, see `Clock`


def open_table(source: Any, hints: FileHints | None = None) -> TableFile:
    """Open the columns of a log or of a DataFrame, whatever they mean; an open file is returned as it is.

    source: a path, `-` for standard input, or a DataFrame.  hints: facts that the file does not contain.

    Raises:
        InputError: neither a path nor a DataFrame; no such file, a folder without a log, no permission, no log.
        OhmwardError: a package that the format needs is not installed.
    """
    if isinstance(source, TableFile):
        return source if hints is None else source._replace(hints=hints)
    hints = (hints or FileHints()).checked()
    if is_frame(source):
        return as_wide(open_frame(source)._replace(hints=hints))
    if not isinstance(source, str | PathLike):
        raise InputError(
            "the source of a log must be the path of a CSV, Parquet or BDF file or of a recording, a DataFrame, or a "
            f"dict of columns, not {source!r:.60} ({type(source).__name__}); make it columns, "
            '{"time": ..., "current": ..., "voltage": ...}, or a Log(name, time_s, ...)'
        )
    path = Path(source)
    try:
        path = with_streams_stored(path)
        if path.is_dir() and not is_recording(path):
            return _open_folder(path, hints)
        return open_bag(path) if is_recording(path) else _open_file(path, hints)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from error


def _open_file(path: Path, hints: FileHints, is_unpacked: bool = False) -> TableFile:
    """Open one file, whose format is recognised by its first bytes, and unpack it if need be.

    is_unpacked: the file was in a gzip file, as of a logger that packs what a server packs again.
    """
    if path.suffix.lower() == ".toml":
        raise InputError(f"{path}: is a TOML file, not a log; give it with its option (--battery, --robot, --floors)")
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    is_packed = head.startswith(GZIP_MAGIC)
    if is_packed:
        with readable(path), LimitedGzip(path, "rb") as unpacked:
            head = unpacked.read1(HEAD_BYTES)
        if head.startswith(GZIP_MAGIC):
            if is_unpacked:
                raise InputError(f"{path.name}: packed with gzip more than twice; unpack it with gunzip first")
            return _open_file(_unpacked(path), hints, is_unpacked=True)
    if about := next((about for beginning, about in _KNOWN if beginning.match(head)), None):
        raise InputError(f"{path.name}: {about}")
    opener = opener_of(head)
    if is_packed and (opener is not open_csv or head.startswith(MAGICS)):  # text tables are unpacked as they are read
        return open_table(_unpacked(path), hints)
    return as_wide(opener(path, hints))


def _unpacked(path: Path) -> Path:
    """A temporary copy of what a gzip file holds."""
    with readable(path), LimitedGzip(path, "rb") as unpacked:
        return _stored(unpacked.read1, path.name.removesuffix(".gz"))


def opener_of(head: bytes) -> Opener:
    """The opener of files that begin with these bytes."""
    if opener := next((opener for magic, opener in OPENERS.items() if head.startswith(magic)), None):
        return opener
    if HDF5_MAGIC in head:
        return open_hdf5
    if is_telemetry(head):
        return open_telemetry
    if (reader := can_reader(head)) is not None:
        return partial(open_can, reader=reader)
    return open_objects if names_values(head) else open_csv


def _open_zip(path: Path, hints: FileHints) -> TableFile:
    """Open a zip archive: a workbook, NumPy arrays (.npz), a Neware file, or the only log in it."""
    if is_ndax(path):
        return open_neware(path, hints)
    if path.suffix.lower() == ".npz":
        return open_numpy(path, hints)
    with parsing(path, "no readable archive", "pack it again"), zipfile.ZipFile(path) as archive:
        parts = [part for part in archive.infolist() if part.filename.lower().endswith(LOG_ENDINGS)]
        logs = [part for part in parts if not part.filename.lower().endswith(_REMARKS)] or parts
        if not parts or any(map(_OF_WORKBOOK.match, archive.namelist())):
            return open_workbook(path, hints)
        if len(logs) > 1:
            names = listed([part.filename for part in logs])
            raise InputError(f"{path.name}: an archive of {len(logs)} logs ({names}); unpack it and name one of them")
        if logs[0].file_size > max(UNPACKED_BYTES, UNPACKED_TIMES * logs[0].compress_size):
            raise InputError(f"{path.name}: {logs[0].filename} unpacks to far more than a log would; unpack it first")
        with archive.open(logs[0]) as source:
            return _open_file(_stored(source.read, Path(logs[0].filename).name), hints)


#: Texts in an archive beside its log; parts of a workbook.
_REMARKS = (".txt", ".json", ".yaml")
_OF_WORKBOOK = re.compile(r"xl/|content\.xml$|\[Content_Types\]")


#: Opener of each format that is recognised by its first bytes.
OPENERS: dict[bytes, Opener] = {
    **vehicle_file.OPENERS,
    **can_file.OPENERS,
    **arrays_file.OPENERS,
    SQLITE_MAGIC: open_sqlite_table,
    b"PAR1": open_parquet,
    b"PK\x03\x04": _open_zip,
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": open_workbook,  # .xls
}


def read_recording(
    file: TableFile, columns: Mapping[str, Column], wanted: Wanted, to_numbers: Callable[[Table], Table]
) -> RecordedTable:
    """Load the columns, choose the rows, read the clock, and put the rows in order of time.

    If the time restarts with each step of a test, another time column that does not is used; failing that, the steps
    are joined.

    columns: channel -> column; among them the time.
    to_numbers: turns the channels' columns into numbers, with a note on each.

    Raises:
        InputError: a missing column, label or time, text among numbers, a time that does not increase.
    """
    try:
        return _read_rows(file, columns, wanted, to_numbers)
    except SeveralRecordingsError as error:
        if not error.are_steps:
            raise
    own = {column.name for column in columns.values()}
    times = [] if wanted.time_given else other_times(file.names, own)
    for time in times:
        with suppress(InputError):
            rows = _read_rows(file, {**columns, "time": time}, wanted, to_numbers)
            note = Note(f"time from {time.name!r}: that in {columns['time'].name!r} starts again with each step")
            return rows._replace(table=rows.table.with_notes(note))
    return _read_rows(file, columns, wanted, to_numbers, joined=True)


def _read_rows(
    file: TableFile,
    columns: Mapping[str, Column],
    wanted: Wanted,
    to_numbers: Callable[[Table], Table],
    joined: bool = False,
) -> RecordedTable:
    """The rows of one recording; joined: put the steps of a test one after the other. See `read_recording`."""
    time = columns["time"].name
    date = date_column(file, time)
    fraction = fraction_column(file.names, time)
    own = {column.name for column in columns.values()} | {fraction[0] if fraction else time, date or time}
    extra = file.names if wanted.extra is None else wanted.extra
    in_file = set(file.names)
    if unknown := [name for name in extra if name not in in_file]:
        raise InputError(f"{file.source}: there is no column {unknown[0]!r} to keep; it has: {', '.join(file.names)}")
    names = {*own, *extra, *wanted.where} & in_file
    table = file.load({*names, *filter(selection.names_instances, file.names)}, wanted.progress)
    labels = dict(wanted.where)
    if file.choose:
        labels.pop(TOPIC, None)
    number = labels.pop(RECORDING, None) if RECORDING not in table.columns else None
    table = selection.select_rows(table, labels)
    clock = read_clock(table, columns["time"], file.hints, date)
    table = table._replace(notes=clock.notes).with_columns({time: clock.time_s}, *table.notes)
    table = drop_untimed(table, time)
    if number is not None:
        begins = np.zeros(table.line.size)
        begins[selection.find_restarts(table.columns[time])] = 1.0
        table = selection.select_rows(table.with_columns({RECORDING: 1.0 + begins.cumsum()}), {RECORDING: number})
    channels = {column.name for channel, column in columns.items() if channel != "time"} & table.columns.keys()
    try:
        table = to_numbers(table)
        table = selection.join_steps(table, time) if joined else table
        table = selection.sort_rows(table, time, sort_time=wanted.sort_time)
        clock_parts = own - channels - {time}
        selection.require_one_instance(table.only(table.columns.keys() - clock_parts), time, channels)
        if wanted.extra is not None and selection.find_repeats(table, time, channels)[1]:
            raise SeveralRecordingsError(f"{table.source}: rows with the same time differ")
    except SeveralRecordingsError:
        if wanted.extra is None:
            raise
        # a column that is not wanted may tell the recordings apart: read all, so that the error names it
        rows = _read_rows(file, columns, wanted._replace(extra=None), to_numbers, joined)
        return rows._replace(table=rows.table.only(names))
    table = drop_text(table.only({*names, RECORDING} - clock_parts))
    settled = selection.settle_equal_times(table, time, channels & table.columns.keys())
    return RecordedTable(
        settled, columns, clock.start_unix_s, frozenset({*own, RECORDING}), clock.guessed_unit, clock.time_zone
    )
