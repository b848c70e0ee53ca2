"""Read a log: one call from a file to a Log in SI units, with notes on everything that was decided on the way."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import bdf
from ohmward.logs.clean import drop_text, drop_untimed, gap_notes, merge_rates, missing_notes, to_si
from ohmward.logs.clock import Clock, nanosecond_column, read_clock
from ohmward.logs.columns import Column, find_columns
from ohmward.logs.csv_file import open_csv
from ohmward.logs.log import Log, Note
from ohmward.logs.order import find_restarts, merge_equal_times, sort_rows
from ohmward.logs.parquet_file import open_parquet
from ohmward.logs.selection import RECORDING, recording_numbers, select_rows
from ohmward.logs.sign import SignEvidence, sign_evidence
from ohmward.logs.table import Progress, Table, TableFile

CurrentSign = Literal["auto", "charge", "discharge"]


def read_log(
    path: str | PathLike[str],
    *,
    current_sign: CurrentSign = "auto",
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    where: Mapping[str, float | str] | None = None,
    extra: Collection[str] | None = None,
    sort_time: bool = False,
    progress: Progress | None = None,
) -> Log:
    """The log in a CSV, Parquet or BDF file.

    path: the file; its content, not its name, says whether it is Parquet.
    current_sign: what a positive current in the file does: "charge", "discharge", or "auto" to tell from the voltage.
    columns: quantity -> column name, where names alone do not tell: {"current": "I_batt"}.
    units: quantity -> unit, where the names are silent or wrong: {"current": "mA"}.
    where: column -> value, to choose one of several recordings: {"script": 1}; "recording" counts clock restarts.
    extra: further columns to keep; None keeps every numeric one.
    sort_time: sort rows that are out of order, whatever the reason.
    progress: called now and then with what is read and what there is to read.

    Raises:
        InputError: the file cannot be read as a log; the message names the file, the place and the fix.
        OhmwardError: Parquet without pyarrow.
    """
    path = Path(path)
    file = open_table(path)
    bdf.check_names(path, file.names)
    chosen = find_columns(file.source, file.names, columns, units)
    wanted = _wanted(file, chosen, extra, where or {})
    # no name for the table as it was read: a column that is replaced by one in SI units need not stay
    table, clock = _one_recording(file.load(wanted, progress), chosen, dict(where or {}), sort_time)
    table = merge_equal_times(drop_text(table), chosen["time"].name)
    table = merge_rates(table, chosen)
    log = _as_log(path, table, chosen, clock, {*(where or {})} if extra is None else set(file.names) - set(extra))
    return _with_sign(log, current_sign, is_bdf=bdf.is_bdf(path), has_bdf_columns=bdf.has_columns(file.names))


def open_table(path: str | PathLike[str]) -> TableFile:
    """The columns of a CSV or Parquet file, before anyone decides what they mean.

    Raises:
        InputError: no such file, a folder, no permission, or neither CSV nor Parquet.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder; name one log file in it")
    try:
        with path.open("rb") as stream:
            is_parquet = stream.read(4) == b"PAR1"
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from error
    return open_parquet(path) if is_parquet else open_csv(path)


def _wanted(
    file: TableFile, chosen: Mapping[str, Column], extra: Collection[str] | None, where: Mapping[str, object]
) -> set[str]:
    if extra is None:
        return set(file.names)
    if unknown := [name for name in extra if name not in file.names]:
        raise InputError(f"{file.source}: there is no column {unknown[0]!r} to keep; it has: {', '.join(file.names)}")
    wanted = {column.name for column in chosen.values()} | {*extra, *where}
    wanted.add(nanosecond_column(file.names, chosen["time"].name) or "")
    return wanted & set(file.names)


def _one_recording(
    table: Table, chosen: Mapping[str, Column], where: dict[str, float | str], sort_time: bool
) -> tuple[Table, Clock]:
    """The rows of one recording, in SI units and in order of time, and how its clock was read."""
    time = chosen["time"].name
    recording = where.pop(RECORDING, None) if RECORDING not in table.columns else None
    table = select_rows(table, where)
    clock = read_clock(table, chosen["time"])
    table = drop_untimed(table._replace(columns={**table.columns, time: clock.time_s}), time)
    if recording is not None:
        numbers = recording_numbers(find_restarts(table.columns[time]), table.line.size)
        table = select_rows(table._replace(columns={**table.columns, RECORDING: numbers}), {RECORDING: recording})
    return sort_rows(to_si(table, chosen), time, sort_time=sort_time), clock


def _as_log(path: Path, table: Table, chosen: Mapping[str, Column], clock: Clock, left_out: Collection[str]) -> Log:
    values = table.columns
    names = {quantity: column.name for quantity, column in chosen.items()}
    time_s, start_unix_s = values[names["time"]], clock.start_unix_s
    if start_unix_s is not None:
        time_s, start_unix_s = time_s - time_s[0], start_unix_s + float(time_s[0])
    wall_clock = next((name for name in bdf.NAMES["unix_time_s"] if name in values), None)
    if start_unix_s is None and wall_clock:
        start_unix_s = float(values[wall_clock][0] - time_s[0])
    taken = {*names.values(), nanosecond_column(tuple(values), names["time"]), wall_clock, RECORDING, *left_out}
    notes = (*clock.notes, *table.notes, *missing_notes(table, chosen), *gap_notes(time_s))
    return Log(
        name=stem(path),
        time_s=time_s,
        current_A=values[names["current"]],
        voltage_V=values[names["voltage"]],
        temperature_degC=values.get(names.get("temperature", "")),
        extra={name: column for name, column in values.items() if name not in taken},
        notes=notes,
        start_unix_s=start_unix_s,
    )


def _with_sign(log: Log, wanted: CurrentSign, *, is_bdf: bool, has_bdf_columns: bool) -> Log:
    """The log with current > 0 charging, and a note on how that was decided."""
    if wanted not in ("auto", "charge", "discharge"):
        raise InputError(f"current_sign must be 'auto', 'charge' or 'discharge', not {wanted!r}")
    evidence = sign_evidence(log.time_s, log.current_A, log.voltage_V)
    if wanted == "auto" and not is_bdf:
        meaning, note = _tell(log, evidence, has_bdf_columns)
    elif wanted == "auto":
        meaning, note = _keep("charge", "by definition of BDF", evidence)
    else:
        meaning, note = _keep(wanted, "given", evidence)
    current_A = -log.current_A if meaning == "discharge" else log.current_A
    return replace(log, current_A=current_A).with_notes(note)


def _keep(told: str, by: str, evidence: SignEvidence) -> tuple[str, Note]:
    """What a positive current does as somebody told, with a warning where the data say the opposite."""
    if evidence.verdict in (told, "undecidable"):
        return told, Note(f"positive current {told}s the battery ({by})")
    text = f"positive current {told}s the battery ({by}), but the data say the opposite: {evidence}; check the sign"
    return told, Note(text, "warning")


def _tell(log: Log, evidence: SignEvidence, has_bdf_columns: bool) -> tuple[str, Note]:
    """What a positive current does as the data tell, else as BDF defines for a file with its column names."""
    if evidence.verdict != "undecidable":
        return evidence.verdict, Note(
            f"positive current {evidence.verdict}s the battery, told from the data: {evidence}"
        )
    if has_bdf_columns:
        return "charge", Note(
            "positive current charges the battery (by definition of BDF, whose column names these are)"
        )
    if not np.nan_to_num(log.current_A).any():
        return "charge", Note("the current is zero throughout: its sign does not matter", "warning")
    raise InputError(
        f"{log.name}: the data do not tell whether a positive current charges or discharges the battery ({evidence}); "
        "say it with --current-sign charge or --current-sign discharge (current_sign='charge')"
    )


def stem(path: Path) -> str:
    """The name without .csv, .bdf.csv, .csv.gz and the like."""
    stem = path.name
    for suffix in (".gz", ".csv", ".tsv", ".txt", ".parquet", ".bdf"):
        stem = stem.removesuffix(suffix)
    return stem
