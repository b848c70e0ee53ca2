"""The pipeline from a file or DataFrame to the rows of one recording, the same for batteries and drives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ohmward.errors import InputError
from ohmward.logs.bags.bag_table import open_bag
from ohmward.logs.bags.choice import TOPIC
from ohmward.logs.bags.files import is_recording
from ohmward.logs.clean import drop_text, drop_untimed
from ohmward.logs.clock import nanosecond_column, read_clock
from ohmward.logs.columns import Column
from ohmward.logs.csv_file import open_csv
from ohmward.logs.frame import is_frame, open_frame
from ohmward.logs.order import find_restarts, merge_equal_times, sort_rows
from ohmward.logs.parquet_file import open_parquet
from ohmward.logs.selection import RECORDING, recording_numbers, select_rows
from ohmward.logs.table import Progress, Table, TableFile
from ohmward.logs.ulog_file import ULOG_MAGIC, open_ulog


class Wanted(NamedTuple):
    """The part of a file to read, as in the arguments of `read_log`."""

    where: Mapping[str, float | str]
    extra: Collection[str] | None = None
    sort_time: bool = False
    progress: Progress | None = None


class RecordedTable(NamedTuple):
    """The rows of one recording in order of time, no time twice; only numbers.

    table: its time in seconds; its notes say what was done.
    start_unix_s: Unix time of the clock's zero, None where it is not a wall clock.
    own: the columns that are channels, labels or parts of the clock; all others are extra.
    """

    table: Table
    start_unix_s: float | None
    own: frozenset[str]


def open_table(source: Any) -> TableFile:
    """The columns of a log or of a DataFrame, whatever they mean; a file that is open stays as it is.

    Raises:
        InputError: neither a path nor a DataFrame; no such file, a folder without a recording, no permission, no log.
        OhmwardError: a package that the format needs is not installed.
    """
    if isinstance(source, TableFile):
        return source
    if is_frame(source):
        return open_frame(source)
    if not isinstance(source, str | PathLike):
        raise InputError(
            f"the source of a log must be the path of a CSV, Parquet or BDF file or of a recording, or a DataFrame of "
            f"pandas, not {source!r:.60} ({type(source).__name__}); make columns a "
            "DataFrame, or arrays a Log(name, time_s, ...)"
        )
    path = Path(source)
    if path.is_dir() and not is_recording(path):
        raise InputError(f"{path} is a folder; name one log file in it")
    try:
        if path.is_dir() or is_recording(path):
            return open_bag(path)
        with path.open("rb") as stream:
            head = stream.read(len(ULOG_MAGIC))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from error
    if head == ULOG_MAGIC:
        return open_ulog(path)
    return open_parquet(path) if head.startswith(b"PAR1") else open_csv(path)


def read_recording(
    file: TableFile, columns: Mapping[str, Column], wanted: Wanted, to_numbers: Callable[[Table], Table]
) -> RecordedTable:
    """Load the columns, choose the rows, read the clock, and put the rows in order of time.

    columns: channel -> column; among them the time.
    to_numbers: turns the channels' columns into numbers, with a note on each.

    Raises:
        InputError: a column, a label or a time that is not there, text among numbers, a time that does not increase.
    """
    time = columns["time"].name
    own = {column.name for column in columns.values()} | {nanosecond_column(file.names, time) or time}
    table = file.load(_names(file, own, wanted), wanted.progress)
    labels = dict(wanted.where)
    if file.choose:
        labels.pop(TOPIC, None)
    number = labels.pop(RECORDING, None) if RECORDING not in table.columns else None
    table = select_rows(table, labels)
    clock = read_clock(table, columns["time"])
    table = table._replace(notes=clock.notes).with_columns({time: clock.time_s}, *table.notes)
    table = drop_untimed(table, time)
    if number is not None:
        numbers = recording_numbers(find_restarts(table.columns[time]), table.line.size)
        table = select_rows(table.with_columns({RECORDING: numbers}), {RECORDING: number})
    table = sort_rows(to_numbers(table), time, sort_time=wanted.sort_time)
    return RecordedTable(merge_equal_times(drop_text(table), time), clock.start_unix_s, frozenset({*own, RECORDING}))


def _names(file: TableFile, own: Collection[str], wanted: Wanted) -> set[str]:
    """The columns to load."""
    if wanted.extra is None:
        return set(file.names)
    if unknown := [name for name in wanted.extra if name not in file.names]:
        raise InputError(f"{file.source}: there is no column {unknown[0]!r} to keep; it has: {', '.join(file.names)}")
    return {*own, *wanted.extra, *wanted.where} & set(file.names)
