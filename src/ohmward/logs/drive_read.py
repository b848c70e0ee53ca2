"""Read a drive: one call from a file to a DriveLog in SI units, with notes on all that was decided on the way."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.logs.clean import drop_text, drop_untimed, gap_notes
from ohmward.logs.clock import nanosecond_column, read_clock
from ohmward.logs.columns import Column, listed
from ohmward.logs.drive_columns import BODY as CHANNELS
from ohmward.logs.drive_columns import (
    MOTOR_CURRENT,
    WHEEL_SPEED,
    Found,
    Wheels,
    default_unit,
    find_drive_columns,
    kind_of,
    may_be_of_the_motor,
)
from ohmward.logs.drive_counts import speed_from_counts
from ohmward.logs.drive_log import BODY, DriveLog
from ohmward.logs.drive_mend import MENDINGS
from ohmward.logs.log import Note, counted
from ohmward.logs.order import find_restarts, merge_equal_times, sort_rows
from ohmward.logs.read import open_table, stem
from ohmward.logs.selection import RECORDING, recording_numbers, select_rows
from ohmward.logs.table import Table, TableFile, numbers
from ohmward.logs.units import Unit


class Mechanics(NamedTuple):
    """What turns a column into the speed of a wheel.

    radius_m: of the wheels, for speeds in m/s.
    gear_ratio: turns of the motor for one of the wheel.
    at_motor_shaft: speeds and counts are of the motor, before the gear.
    counts_per_turn: of an encoder, for one turn of what it sits on.
    """

    radius_m: float | None = None
    gear_ratio: float = 1.0
    at_motor_shaft: bool = False
    counts_per_turn: float | None = None


def read_drive(
    path: str | PathLike[str],
    places: Sequence[str],
    driven: int,
    *,
    radius_m: float | None = None,
    gear_ratio: float = 1.0,
    at_motor_shaft: bool = False,
    counts_per_turn: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    where: Mapping[str, float | str] | None = None,
    extra: Collection[str] | None = None,
    leave: Collection[str] = (),
    sort_time: bool = False,
) -> DriveLog:
    """The drive in a CSV or Parquet file.

    path: the file; its content, not its name, says whether it is Parquet.
    places: names of the robot's wheels, driven ones first (`[p.name for p in robot.places]`).
    driven: how many of them are driven.
    radius_m: of the wheels; needed for speeds in m/s at the rim.
    gear_ratio: of the motors; used where the speeds are the motors' own.
    at_motor_shaft: wheel speeds and counts are of the motor, before the gear.
    counts_per_turn: of the encoders; needed for counts.
    columns: channel -> column name, where names alone do not tell: {"front_left_wheel_speed": "velL"}.
    units: channel or kind -> unit: {"wheel_speed": "rpm"}.
    where: column -> value, to choose one of several recordings; "recording" counts clock restarts.
    extra: further columns to keep; None keeps every numeric one.
    leave: columns not to take for a sensor by their names: truths.
    sort_time: sort rows that are out of order, whatever the reason.

    Raises:
        InputError: the file cannot be read as a drive; the message names the file, the place and the fix.
        OhmwardError: Parquet without pyarrow.
    """
    mechanics = Mechanics(radius_m, gear_ratio, at_motor_shaft, counts_per_turn)
    _check(mechanics)
    path, wheels = Path(path), Wheels(tuple(places), driven)
    file = open_table(path)
    found = find_drive_columns(file.source, file.names, wheels, columns, units, tuple(leave))
    table = _one_recording(file.load(_wanted(file, found, extra, where or {})), found, dict(where or {}), sort_time)
    channels, notes = _in_si(table, found.columns, wheels, mechanics)
    kept = _with_any(channels)
    if not kept.any():
        raise InputError(f"{file.source}: no row has the speed of a wheel or anything else that the robot measured")
    if not kept.all():
        notes.append(Note(f"{counted(int((~kept).sum()), 'row')} in which nothing was measured: dropped"))
    return _as_log(path, table, found, channels, wheels, notes).select(kept)


def _check(mechanics: Mechanics) -> None:
    for name in ("radius_m", "gear_ratio", "counts_per_turn"):
        if (value := getattr(mechanics, name)) is not None:
            require_positive(name, value)


def _wanted(file: TableFile, found: Found, extra: Collection[str] | None, where: Mapping[str, object]) -> set[str]:
    if extra is None:
        return set(file.names)
    if unknown := [name for name in extra if name not in file.names]:
        raise InputError(f"{file.source}: there is no column {unknown[0]!r} to keep; it has: {', '.join(file.names)}")
    wanted = {column.name for column in found.columns.values()} | {*extra, *where}
    wanted.add(nanosecond_column(file.names, found.columns["time"].name) or "")
    return wanted & set(file.names)


def _one_recording(table: Table, found: Found, where: dict[str, float | str], sort_time: bool) -> Table:
    """The rows of one recording in order of time, no time twice; its time is in seconds."""
    time = found.columns["time"].name
    recording = where.pop(RECORDING, None) if RECORDING not in table.columns else None
    table = select_rows(table, where)
    clock = read_clock(table, found.columns["time"])
    table = table._replace(columns={**table.columns, time: clock.time_s}, notes=(*clock.notes, *table.notes))
    table = drop_untimed(table, time)
    if recording is not None:
        parts = recording_numbers(find_restarts(table.columns[time]), table.line.size)
        table = select_rows(table._replace(columns={**table.columns, RECORDING: parts}), {RECORDING: recording})
    read = {column.name: numbers(table, column.name) for column in found.columns.values() if column.name != time}
    table = sort_rows(table._replace(columns={**table.columns, **read}), time, sort_time=sort_time)
    return merge_equal_times(drop_text(table), time)


def _in_si(
    table: Table, columns: Mapping[str, Column], wheels: Wheels, mechanics: Mechanics
) -> tuple[dict[str, np.ndarray], list[Note]]:
    """Every channel that has a value, (T,) in SI units, and what was assumed."""
    time_s = table.columns[columns["time"].name]
    channels: dict[str, np.ndarray] = {}
    notes: list[Note] = []
    measured = {q: columns[q] for q in wheels.quantities[1:] if q in columns and columns[q].name in table.columns}
    for quantity, column in measured.items():
        values = table.columns[column.name]
        values, unit = _finite(column.name, values, notes), _unit(quantity, column)
        if kind_of(quantity) == WHEEL_SPEED:
            channels[quantity], told = _wheel_speed(table.source, column.name, unit, values, time_s, mechanics)
            notes += told
        else:
            channels[quantity] = unit.scale * values
    notes = [*_unit_notes(measured, mechanics), *dict.fromkeys(notes)]
    for mend in MENDINGS:
        changed, told = mend(time_s, channels, columns)
        channels |= changed
        notes += told
    return channels, notes


def _finite(name: str, values: np.ndarray, notes: list[Note]) -> np.ndarray:
    """The values with NaN in place of infinite ones, which adds a note."""
    if infinite := int(np.isinf(values).sum()):
        notes.append(Note(f"{counted(infinite, 'infinite value')} of {name!r} taken as missing", "warning"))
    return np.where(np.isinf(values), np.nan, values)


def _unit(quantity: str, column: Column) -> Unit:
    return column.unit or default_unit(kind_of(quantity), column.name)


def _wheel_speed(
    source: str, name: str, unit: Unit, values: np.ndarray, time_s: np.ndarray, mechanics: Mechanics
) -> tuple[np.ndarray, list[Note]]:
    """The speed of a wheel [rad/s] from a rotation, a speed of the rim or counts, of the wheel or of its motor."""
    if unit.quantity == "speed":
        if mechanics.radius_m is None:
            raise InputError(f"{source}: {name!r} is in {unit.symbol}; give the radius of the wheels (radius_m)")
        return unit.scale * values / mechanics.radius_m, []
    gear_ratio = mechanics.gear_ratio if mechanics.at_motor_shaft else 1.0
    if unit.quantity == "rotation":
        return unit.scale * values / gear_ratio, []
    if mechanics.counts_per_turn is None:
        raise InputError(
            f"{source}: {name!r} counts the turns of a wheel; say how far with --counts-per-turn 4096 "
            "(counts_per_turn=4096)"
        )
    encoder = speed_from_counts(values, time_s, mechanics.counts_per_turn)
    rolled = Note(f"{name!r}: a counter of {encoder.bits} bits rolled over {encoder.rollovers} times: undone")
    return encoder.speed_rad_s / gear_ratio, [rolled] if encoder.rollovers else []


def _unit_notes(measured: Mapping[str, Column], mechanics: Mechanics) -> list[Note]:
    """One note for all columns of a kind that are read alike."""
    alike: dict[tuple[str, str, bool], list[str]] = {}
    for quantity, column in measured.items():
        key = kind_of(quantity), _unit(quantity, column).symbol, column.unit is None
        alike.setdefault(key, []).append(column.name)
    notes = []
    for (kind, symbol, guessed), names in alike.items():
        unit = f"taken as {symbol}, which the name does not say" if guessed else f"in {symbol}"
        notes.append(Note(f"{kind.replace('_', ' ')} from {listed(list(dict.fromkeys(names)))}, {unit}"))
        if kind == WHEEL_SPEED and symbol not in ("rad/s", "rpm", "deg/s", "counts"):
            notes.append(Note(f"that is the speed of a rim of radius {mechanics.radius_m:g} m"))
        elif kind == WHEEL_SPEED and mechanics.at_motor_shaft:
            notes.append(Note(f"that is the motor's, before a gear of {mechanics.gear_ratio:g} (--motor-shaft)"))
        elif kind == WHEEL_SPEED and mechanics.gear_ratio != 1.0 and any(map(may_be_of_the_motor, names)):
            text = f"taken as the wheel's, behind the gear of {mechanics.gear_ratio:g}; if not, say --motor-shaft"
            notes.append(Note(text, "warning"))
    return notes


def _with_any(channels: Mapping[str, np.ndarray]) -> np.ndarray:
    """(T,) whether a row has a value of any channel."""
    return np.any([np.isfinite(values) for values in channels.values()], axis=0)


def _as_log(
    path: Path, table: Table, found: Found, channels: Mapping[str, np.ndarray], wheels: Wheels, notes: Sequence[Note]
) -> DriveLog:
    time_s = table.columns[found.columns["time"].name]
    nothing = np.full(time_s.size, np.nan)
    speeds = [channels.get(f"{place}_{WHEEL_SPEED}", nothing) for place in wheels.places]
    currents = [channels.get(f"{place}_{MOTOR_CURRENT}", nothing) for place in wheels.places[: wheels.driven]]
    taken = {column.name for column in found.columns.values()} | {RECORDING}
    taken.add(nanosecond_column(tuple(table.columns), found.columns["time"].name) or "")
    body = {name: channels[kind] for name in BODY if (kind := _kind_of_field(name)) in channels}
    return DriveLog(
        name=stem(path),
        time_s=time_s,
        wheel_speed_rad_s=np.column_stack(speeds),
        motor_current_A=np.column_stack(currents) if currents else np.empty((time_s.size, 0)),
        **body,
        extra={name: values for name, values in table.columns.items() if name not in taken},
        notes=(*table.notes, *notes, *_order_note(found, wheels), *_absent_notes(channels, wheels), *gap_notes(time_s)),
    )


def _kind_of_field(name: str) -> str:
    """The channel of a field of the log: `yaw_rate_rad_s` is `yaw_rate`."""
    return max((kind for kind in CHANNELS if name.startswith(kind)), key=len)


def _order_note(found: Found, wheels: Wheels) -> tuple[Note, ...]:
    if not found.by_number or all(any(c.isdigit() for c in place) for place in wheels.places):
        return ()
    return (
        Note(f"wheels told by their numbers, in the robot's order: {', '.join(wheels.places)}; check it", "warning"),
    )


def _absent_notes(channels: Mapping[str, np.ndarray], wheels: Wheels) -> tuple[Note, ...]:
    """Driven wheels without a speed or a motor current."""
    driven = wheels.places[: wheels.driven]
    absent = {kind: [p for p in driven if f"{p}_{kind}" not in channels] for kind in (WHEEL_SPEED, MOTOR_CURRENT)}
    return tuple(
        Note(f"no {kind.replace('_', ' ')} of {', '.join(places)}", "warning")
        for kind, places in absent.items()
        if places
    )
