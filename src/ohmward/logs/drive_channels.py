"""The channels of a drive in SI units, from the columns of its table; the currents of its motors mended."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.logs.channels import BODY, MOTOR_CURRENT, WHEEL, WHEEL_SPEED, channel_of
from ohmward.logs.clean import find_gaps, finite
from ohmward.logs.columns import Column
from ohmward.logs.table import Note, Table, counted, numbers
from ohmward.logs.wheel_columns import Found, Wheels
from ohmward.logs.wheel_speed import POSITIONS, Mechanics, even_times, unit_notes, unit_of_channel, wheel_speed

#: A current that pulls backwards for this fraction of the samples must once be negative.
_BACKWARD_FRACTION = 0.05

#: Currents present in less than nine of ten rows with wheel speeds come at a rate of their own.
_OWN_RATE_FRACTION = 0.9

Mended = tuple[np.ndarray, list[Note]]


def _share(current_A: np.ndarray, columns: Sequence[str]) -> Mended:
    """Even shares of each current that is that of several motors; columns: name of that of each, "" for none."""
    shared = {name: count for name, count in Counter(columns).items() if name and count > 1}
    notes = [Note(f"{name!r} is the current of {count} wheels: shared evenly") for name, count in shared.items()]
    return current_A / np.array([shared.get(name, 1) for name in columns]), notes


def _sign(current_A: np.ndarray, speed_rad_s: np.ndarray) -> Mended:
    """Currents with the sign of their wheel where none is ever negative although wheels turn backwards."""
    backward = speed_rad_s < 0
    often = ((backward & (current_A > 0)).mean(axis=0) > _BACKWARD_FRACTION).any()
    if not often or (current_A < 0).any():
        return current_A, []
    text = (
        "motor currents are never negative although wheels turn backwards: taken as magnitudes with the sign of the "
        "wheel's speed, which is wrong while braking"
    )
    return np.where(backward, -current_A, current_A), [Note(text, "warning")]


def _bridge(time_s: np.ndarray, current_A: np.ndarray, wheels_measured: np.ndarray, places: Sequence[str]) -> Mended:
    """Straight lines between the samples of currents that come on rows of their own, but not over gaps."""
    known = np.isfinite(current_A)
    together = (known & wheels_measured[:, None]).sum(axis=0)
    apart = np.flatnonzero((known.sum(axis=0) > 1) & (together < _OWN_RATE_FRACTION * wheels_measured.sum()))
    if not apart.size:
        return current_A, []
    bridged = current_A.copy()
    for motor in apart:
        rows = known[:, motor]
        times = time_s[rows]
        line = np.interp(time_s, times, current_A[rows, motor], left=np.nan, right=np.nan)
        for gap in find_gaps(times):
            line[(time_s > times[gap]) & (time_s < times[gap + 1])] = np.nan
        bridged[:, motor] = line
    names = ", ".join(f"{places[int(motor)]} motor current".replace("_", " ") for motor in apart)
    return bridged, [Note(f"{names}: sampled on other rows than the wheels, straight lines in between")]


#: A heading counts clockwise where the gyro has turned by this standard deviation [rad] at least, and the heading by at
#: least this share of it the other way.
_TURNED_RAD, _CLOCKWISE = 0.3, 0.5


#: A row that comes after less than this share of the interval in which it was measured is one of a burst.
_BURST = 1 / 3


class DriveChannels(NamedTuple):
    """Everything that the robot measured, in SI units; NaN where there is nothing new."""

    time_s: np.ndarray  #: (T,) [s]
    wheel_speed_rad_s: np.ndarray  #: (T, wheels)
    motor_current_A: np.ndarray  #: (T, driven)
    body: dict[str, np.ndarray]  #: channel -> (T,), those that were measured
    notes: tuple[Note, ...]  #: everything that was assumed, converted or mended
    absent: tuple[Note, ...]  #: notes on driven wheels that lack a channel

    @property
    def measured(self) -> np.ndarray:
        """(T,) bool, rows with a value of any channel."""
        columns = np.column_stack([self.wheel_speed_rad_s, self.motor_current_A, *self.body.values()])
        return np.isfinite(columns).any(axis=1)


def to_numbers(table: Table, columns: Mapping[str, Column]) -> Table:
    """The columns of all channels but the time as float64.

    Raises:
        InputError: text where a number must stand; names the line.
    """
    names = {column.name for quantity, column in columns.items() if quantity != "time"}
    return table.with_columns({name: numbers(table, name) for name in names})


def drive_channels(table: Table, found: Found, wheels: Wheels, mechanics: Mechanics) -> DriveChannels:
    """The channels of a drive from the rows of one recording.

    Raises:
        InputError: a wheel's speed needs a radius or counts per turn that are not given.
    """
    time_s = table.columns[found.columns["time"].name]
    measured = [q for q in wheels.quantities[1:] if q in found.columns and found.columns[q].name in table.columns]
    columns = {quantity: found.columns[quantity] for quantity in measured}
    time_s, burst_notes = _without_bursts(table, time_s, columns, mechanics)
    channels, conversion_notes = _in_si(table, time_s, columns, mechanics)
    speed_rad_s, turn_notes = _at_once(time_s, _side_by_side(channels, wheels.of(WHEEL_SPEED), time_s))
    current_A = _side_by_side(channels, wheels.of(MOTOR_CURRENT), time_s)
    names = [columns[q].name if q in columns else "" for q in wheels.of(MOTOR_CURRENT).values()]
    current_A, shared = _share(current_A, names)
    current_A, signed = _sign(current_A, speed_rad_s[:, : wheels.driven])
    current_A, bridged = _bridge(time_s, current_A, np.isfinite(speed_rad_s).any(axis=1), wheels.driven_places)
    body = {channel.name: channels[channel.name] for channel in BODY if channel.name in channels}
    notes = [*unit_notes(columns, mechanics), *conversion_notes, *burst_notes, *turn_notes]
    notes += _use_angles(time_s, body)
    absent = _absent_notes(columns, wheels)
    return DriveChannels(time_s, speed_rad_s, current_A, body, (*notes, *shared, *signed, *bridged), absent)


def _without_bursts(
    table: Table, time_s: np.ndarray, columns: Mapping[str, Column], mechanics: Mechanics
) -> tuple[np.ndarray, tuple[Note, ...]]:
    """The times (T,) of the rows where positions of wheels arrived in bursts as they were measured, and a note.

    A position over the time between two arrivals is no speed where the second did not wait for its turn.
    """
    positions = [
        table.columns[column.name]
        for quantity, column in columns.items()
        if channel_of(quantity) is WHEEL_SPEED and unit_of_channel(quantity, column, mechanics).dimension in POSITIONS
    ]
    if not positions:
        return time_s, ()
    known = np.isfinite(np.column_stack(positions)).all(axis=1)
    arrived_s = time_s[known]
    even_s = even_times(arrived_s)
    in_bursts = int(np.count_nonzero(np.diff(arrived_s) < _BURST * np.diff(even_s)))
    if not in_bursts:
        return time_s, ()
    text = f"{counted(in_bursts, 'row')} with positions of wheels arrived in bursts: their times are made even"
    moved_s = np.interp(time_s, arrived_s, even_s - arrived_s)
    return time_s + moved_s, (Note(text),)


def _in_si(
    table: Table, time_s: np.ndarray, columns: Mapping[str, Column], mechanics: Mechanics
) -> tuple[dict[str, np.ndarray], list[Note]]:
    """Every channel (T,) in SI units, and notes on infinite values and counters that rolled over."""
    channels: dict[str, np.ndarray] = {}
    notes: list[Note] = []
    for quantity, column in columns.items():
        values, infinite = finite(column.name, table.columns[column.name])
        unit = unit_of_channel(quantity, column, mechanics)
        notes += infinite
        if channel_of(quantity) is WHEEL_SPEED:
            channels[quantity], rolled = wheel_speed(table.source, column.name, unit, values, time_s, mechanics)
            notes += rolled
        else:
            channels[quantity] = unit.in_si(values)
    return channels, list(dict.fromkeys(notes))  # several wheels may share a column


def _side_by_side(channels: Mapping[str, np.ndarray], quantities: Mapping[str, str], time_s: np.ndarray) -> np.ndarray:
    """(T, wheels) one channel of several wheels, NaN where it was not measured."""
    values = np.full((time_s.size, len(quantities)), np.nan)
    for wheel, quantity in enumerate(quantities.values()):
        values[:, wheel] = channels.get(quantity, np.nan)
    return values


def _at_once(time_s: np.ndarray, speed_rad_s: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """Speeds (T, wheels) of wheels that report in turns, at the times of the first one, and a note.

    They are linear between two samples of a wheel, but not over gaps. Wheels of which some report together stay as
    they are.
    """
    measured = np.flatnonzero(np.isfinite(speed_rad_s).any(axis=0))
    known = np.isfinite(speed_rad_s[:, measured])
    if measured.size < 2 or known.all(axis=1).any() or known.sum(axis=0).min() < 2:
        return speed_rad_s, ()
    first = known[:, 0]
    together = np.full(speed_rad_s.shape, np.nan)
    for wheel, rows in zip(measured, known.T, strict=True):
        own_s = time_s[rows]
        values = np.interp(time_s[first], own_s, speed_rad_s[rows, wheel], left=np.nan, right=np.nan)
        after = np.clip(np.searchsorted(own_s, time_s[first]), 1, own_s.size - 1)
        in_gap = np.isin(after - 1, find_gaps(own_s)) & ~rows[first]
        together[first, wheel] = np.where(in_gap, np.nan, values)
    text = "no two wheels report at the same time: their speeds are interpolated to the times of the first one"
    return together, (Note(text),)


def _use_angles(time_s: np.ndarray, body: dict[str, np.ndarray]) -> list[Note]:
    """Give the body a yaw rate where it has none, and turn a heading round that counts clockwise; with notes.

    A heading whose changes are the yaw rate is left out: it must not count twice.
    """
    if "yaw_rate" not in body and (angles := [name for name in ("yaw", "heading") if name in body]):
        body["yaw_rate"] = _rate_of_change(time_s, body.pop(angles[0]))
        return [Note(f"no gyro: the yaw rate is the change of the {angles[0]}")]
    if "heading" not in body or not _counts_clockwise(time_s, body["heading"], body["yaw_rate"]):
        return []
    body["heading"] = -body["heading"]
    return [Note("the heading counts clockwise, against the gyro: turned round")]


def _counts_clockwise(time_s: np.ndarray, heading_rad: np.ndarray, yaw_rate_rad_s: np.ndarray) -> bool:
    """True where the heading turns against the integral of the gyro."""
    at, known = np.isfinite(heading_rad), np.isfinite(yaw_rate_rad_s)
    if not at.any() or not known.any():
        return False
    angle_rad = np.cumsum(yaw_rate_rad_s[known] * np.diff(time_s[known], prepend=time_s[known][0]))
    gyro = np.interp(time_s[at], time_s[known], angle_rad)
    gyro -= gyro.mean()
    against = -float(gyro @ np.unwrap(heading_rad[at]))
    return bool(gyro.std() > _TURNED_RAD and against > _CLOCKWISE * (gyro @ gyro))


def _rate_of_change(time_s: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """(T,) [rad/s] since the angle before, the short way round; NaN in rows without an angle."""
    known = np.flatnonzero(np.isfinite(angle_rad))
    turned = np.mod(np.diff(angle_rad[known]) + math.pi, 2 * math.pi) - math.pi
    rate = np.full(time_s.size, np.nan)
    rate[known[1:]] = turned / np.diff(time_s[known])
    return rate


def _absent_notes(columns: Collection[str], wheels: Wheels) -> tuple[Note, ...]:
    """Notes on driven wheels without a speed or a motor current."""
    notes = []
    for channel in WHEEL:
        absent = [place for place in wheels.driven_places if f"{place}_{channel.name}" not in columns]
        if absent:
            notes.append(Note(f"no {channel.name.replace('_', ' ')} of {', '.join(absent)}", "warning"))
    return tuple(notes)
