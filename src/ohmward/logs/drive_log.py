"""The log of a drive: wheels, motors and body sensors in SI units; its reader also corrects motor currents."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from ohmward.checks import require_mappings
from ohmward.errors import InputError
from ohmward.logs import wheel_columns
from ohmward.logs.channels import BODY as BODY_CHANNELS
from ohmward.logs.channels import MOTOR_CURRENT, WHEEL, WHEEL_SPEED, channel_of
from ohmward.logs.clean import finite, gap_notes, on_lines, require_plausible_drive
from ohmward.logs.clock import with_joined_time
from ohmward.logs.columns import Column
from ohmward.logs.frame import to_frame
from ohmward.logs.hints import FileHints
from ohmward.logs.read import RecordedTable, Wanted, open_table, read_recording
from ohmward.logs.table import Note, Table, TableFile, counted, numbers, with_sample_time
from ohmward.logs.time_series import TimeSeries
from ohmward.logs.wheel_columns import Found, Mechanics, Wheels
from ohmward.quantities import BODY, QUANTITIES

#: Currents that are never negative are magnitudes if a wheel turns backwards under current for this share of samples.
_BACKWARD_FRACTION = 0.05

#: Currents present in less than this fraction of the rows with wheel speeds have a sampling rate of their own.
_OWN_RATE_FRACTION = 0.9

#: A heading counts clockwise if the integrated gyro rate has at least this standard deviation [rad], and the heading
#: follows it with a slope below minus this fraction.
_TURNED_RAD, _CLOCKWISE = 0.3, 0.5

Mended = tuple[np.ndarray, list[Note]]

#: A `DriveLog`, or a path or DataFrame of one.
DriveSource: TypeAlias = "DriveLog | str | PathLike[str] | Any"


@dataclass(frozen=True, eq=False, repr=False)
class DriveLog(TimeSeries):
    """A recording of a drive. Arrays are read-only float64; NaN where nothing new was measured.

    >>> log = ow.DriveLog("yard", [0, 0.1], wheel_speed_rad_s=[[1, 1], [1.1, 1]], motor_current_A=[[2, 2], [2, 2]])
    >>> log.wheel_speed_rad_s.shape
    (2, 2)

    Any array-like of numbers will do; None and NaN are missing. Times given as dates or durations become seconds.

    Raises:
        InputError: no samples, shapes that differ, time that is not finite or does not increase, non-numeric values.
    """

    name: str  #: usually the file's stem
    time_s: np.ndarray  #: (T,) [s], finite and strictly increasing
    #: (T, wheels) of every wheel, driven ones first, > 0 forward; all NaN for a wheel without encoder
    wheel_speed_rad_s: np.ndarray
    motor_current_A: np.ndarray  #: (T, driven), > 0 drives forward
    yaw_rate_rad_s: np.ndarray | None = None  #: of a gyro, > 0 to the left
    acceleration_m_s2: np.ndarray | None = None  #: of an accelerometer along x, gravity included: at rest g sin(pitch)
    pitch_rad: np.ndarray | None = None  #: of an attitude filter, > 0 with the nose up
    #: forward, from GNSS, visual or lidar odometry or optical flow; its standard deviation; its age at `time_s`
    speed_m_s: np.ndarray | None = None
    speed_std_m_s: np.ndarray | None = None
    speed_age_s: np.ndarray | None = None
    #: of a compass or two GNSS antennas, > 0 to the left, from an arbitrary zero; its standard deviation
    heading_rad: np.ndarray | None = None
    heading_std_rad: np.ndarray | None = None
    #: of the steered wheel of a robot whose rear wheels' speeds follow from it, > 0 to the left
    steering_rad: np.ndarray | None = None
    #: (T,) each: further quantities of the body by name, and numeric columns of the file by theirs, ground truth too
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()  #: everything that was assumed, converted or dropped while reading
    #: Unix time [s] of time_s = 0 and the zone of its dates, as in `Log`
    start_unix_s: float | None = None
    time_zone: str = "UTC"

    def __post_init__(self) -> None:
        self._freeze(("wheel_speed_rad_s", "motor_current_A", *BODY))
        self._require_lengths(BODY)
        for name in ("wheel_speed_rad_s", "motor_current_A"):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape[0] != len(self):
                raise InputError(
                    f"DriveLog {self.name!r}: {name} must be ({len(self)}, wheels), one row for each time, not {shape}"
                )

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the body with at least one measured value."""
        values = {name: getattr(self, name) for name in BODY}
        return tuple(name for name, v in values.items() if v is not None and np.isfinite(v).any())

    @classmethod
    def from_pandas(cls, frame: Any, robot: Any, driven: int | None = None, **options: Any) -> DriveLog:
        """The drive in a DataFrame; the same as `read_drive(frame, robot, driven, **options)`."""
        return read_drive(frame, robot, driven, **options)

    def to_pandas(self, places: Sequence[str] | None = None) -> Any:
        """A DataFrame of `columns`, indexed by `time_s` [s]."""
        return to_frame(self.columns(places), self.name)

    def columns(self, places: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """One column (T,) for each channel, with its unit in the name, and the extra columns.

        places: names of the wheels, driven ones first; wheel_1, wheel_2, ... unless given.
        """
        wheels = self.wheel_speed_rad_s.shape[1]
        names = places or [f"wheel_{number + 1}" for number in range(wheels)]
        if len(names) != wheels:
            raise InputError(f"places must name the {wheels} wheels of the log, got {len(names)}: {list(names)}")
        columns = {"time_s": self.time_s}
        columns |= {f"{p}_wheel_speed_rad_s": self.wheel_speed_rad_s[:, k] for k, p in enumerate(names)}
        columns |= {f"{p}_motor_current_A": v for p, v in zip(names, self.motor_current_A.T, strict=False)}
        body = {name: getattr(self, name) for name in BODY if getattr(self, name) is not None}
        return {**columns, **body, **self.extra}


def read_drive(
    source: str | PathLike[str] | Any,
    robot: Any,
    driven: int | None = None,
    *,
    radius_m: float | None = None,
    gear_ratio: float | None = None,
    at_motor_shaft: bool = False,
    counts_per_turn: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    where: Mapping[str, float | str] | None = None,
    extra: Collection[str] | None = None,
    leave: Collection[str] = (),
    sort_time: bool = False,
    hints: FileHints | None = None,
) -> DriveLog:
    """Read a drive from a CSV or Parquet file, a ROS recording, a PX4 ULog, or a DataFrame.

    >>> drive = ow.read_drive("drive.csv", ow.load_robot("rlma"))
    >>> drive.wheel_speed_rad_s.shape[1]
    4

    source: path of a file in any of these formats, whatever its name; a DataFrame, or a dict of columns.
    robot: a Robot, or the names of its wheels, driven ones first.
    driven: number of driven wheels; only with names.
    radius_m: of the wheels; needed for speeds in m/s at the rim; default: the robot's; nan: not known.
    gear_ratio: of the motors; used for speeds measured at the motors; default: the robot's, or 1.
    at_motor_shaft: wheel speeds and counts are measured at the motor, before the gear.
    counts_per_turn: of the encoders; needed for counts.
    columns: channel -> column name, where the names are not clear enough: {"front_left_wheel_speed": "velL"}.
    units: channel or kind -> unit: {"wheel_speed": "rpm"}.
    where: column -> value, to choose one of several recordings; "recording" counts clock restarts.
        For a ROS recording, {"topic": "/joint_states,/imu"} names the topics.
    extra: further columns to keep; None keeps every numeric one.
    leave: columns that must not be taken for a sensor because of their names, such as ground truth.
    sort_time: sort rows that are out of order, whatever the reason.
    hints: names, encoding, date format, time zone and the like, where the file does not give them.

    Raises:
        InputError: the file cannot be read as a drive; the message names the file, the place and the fix.
        OhmwardError: Parquet without pyarrow, a ROS recording without rosbags.
    """
    require_mappings(columns=columns, units=units, where=where)
    wheels = _wheels(robot, driven)
    if hasattr(robot, "places"):
        radius_m = robot.wheel.radius_m if radius_m is None else radius_m
        gear_ratio = robot.motor.gear_ratio if gear_ratio is None else gear_ratio
    known_m = None if radius_m is None or math.isnan(radius_m) else radius_m
    mechanics = Mechanics(known_m, 1.0 if gear_ratio is None else gear_ratio, at_motor_shaft, counts_per_turn)
    file = with_joined_time(with_sample_time(open_table(source, hints).part("drive", where)))
    found = wheel_columns.find_drive_columns(file.source, file.names, wheels, file.given(columns), units, leave)
    wanted = Wanted(where or {}, extra, sort_time)
    measured = dict.fromkeys(column.name for quantity, column in found.columns.items() if quantity != "time")

    def to_numbers(table: Table) -> Table:
        return table.with_columns({name: numbers(table, name) for name in measured})

    rows = read_recording(file, found.columns, wanted, to_numbers)
    log = _as_log(file, rows, found, wheels, mechanics).part(file.hints)
    return _by_steering(file.source, log, robot.chassis) if wheels.steered else log


def _by_steering(source: str, log: DriveLog, chassis: Any) -> DriveLog:
    """The log of a steered robot with the speeds of its rear wheels, from the measured one and the steering angle."""
    if np.isfinite(log.wheel_speed_rad_s[:, 1]).any():
        return log
    if "steering_rad" not in log.channels:
        raise InputError(
            f"{source}: no column for the steering angle found; name it with --column steering=NAME (columns="
            '{"steering": "NAME"}), or use a robot file of kind two-wheel for encoders at both rear wheels'
        )
    assert log.steering_rad is not None
    known = np.isfinite(log.steering_rad)
    usual_rad, most_rad = float(np.nanmedian(np.abs(log.steering_rad))), chassis.steepest_rad
    if usual_rad > most_rad:
        raise InputError(
            f"{source}: steering angles are usually {usual_rad:.3g} rad, beyond {most_rad:.2g}; in degrees? then say "
            "--unit steering=deg (units={'steering': 'deg'}), or correct the file"
        )
    steering_rad = on_lines(log.time_s, log.time_s[known], log.steering_rad[known])
    speeds = chassis.wheel_speeds(log.wheel_speed_rad_s, steering_rad)
    note = Note(f"speeds of the rear wheels from the steering angle and the speed at the {chassis.measured}")
    no_current_A = np.full(log.motor_current_A.shape, math.nan)  # they show no force of the rear wheels
    return replace(log, wheel_speed_rad_s=speeds, motor_current_A=no_current_A, notes=(*log.notes, note))


def as_drive(source: DriveSource, robot: Any) -> DriveLog:
    """The drive itself, or the one that `read_drive` reads from a path or DataFrame without further options."""
    return source if isinstance(source, DriveLog) else read_drive(source, robot)


def _as_log(file: TableFile, rows: RecordedTable, found: Found, wheels: Wheels, mechanics: Mechanics) -> DriveLog:
    """Build the log from the rows with any measurement, in SI units, with corrected motor currents."""
    table = rows.table
    time = found.columns["time"]
    measured = [q for q in wheels.quantities[1:] if q in found.columns and found.columns[q].name in table.columns]
    columns = {quantity: found.columns[quantity] for quantity in measured}
    time_s, burst_notes = wheel_columns.without_bursts(table, table.columns[time.name], columns, mechanics)
    channels, conversion_notes = _in_si(table, time_s, columns, mechanics)
    require_plausible_drive(file.source, time, time_s, rows.guessed_unit)
    speed_rad_s, turn_notes = _at_once(time_s, _side_by_side(channels, wheels.of(WHEEL_SPEED), time_s))
    current_A, current_notes = _motor_currents(time_s, channels, columns, speed_rad_s, wheels)
    body = {channel.name: channels[channel.name] for channel in BODY_CHANNELS if channel.name in channels}
    angle_notes = _use_angles(time_s, body)
    is_measured, dropped = _rows_with_values(file.source, [speed_rad_s, current_A, *body.values()])
    fields = {q.field: body[q.channel] for q in QUANTITIES.values() if q.owner == "body" and q.channel in body}
    fields_of_log = {name: fields.pop(name) for name in BODY if name in fields}
    other_columns = {name: column for name, column in table.columns.items() if name not in rows.own}
    log = DriveLog(
        name=file.stem,
        time_s=time_s,
        wheel_speed_rad_s=speed_rad_s,
        motor_current_A=current_A,
        **fields_of_log,
        extra={**fields, **other_columns},
        notes=(
            *table.notes,
            *wheel_columns.unit_notes(columns, mechanics),
            *wheel_columns.other_unit_notes(
                {q: c for q, c in columns.items() if channel_of(q) is WHEEL_SPEED}, channels
            ),
            *conversion_notes,
            *burst_notes,
            *turn_notes,
            *angle_notes,
            *current_notes,
            *dropped,
            *_wheel_notes(found, columns, wheels),
            *gap_notes(time_s),
        ),
        start_unix_s=rows.start_unix_s,
        time_zone=rows.time_zone,
    )
    return log.select(is_measured)


def _motor_currents(
    time_s: np.ndarray,
    channels: Mapping[str, np.ndarray],
    columns: Mapping[str, Column],
    speed_rad_s: np.ndarray,
    wheels: Wheels,
) -> Mended:
    """The current of each motor (T, driven), with its sign, in the rows with speeds of wheels."""
    quantities = wheels.of(MOTOR_CURRENT)
    names = [columns[q].name if q in columns else "" for q in quantities.values()]
    wheels_measured = np.isfinite(speed_rad_s).any(axis=1)
    current_A, shared = _share(_side_by_side(channels, quantities, time_s), names)
    current_A, signed = _sign(current_A, speed_rad_s[:, : wheels.driven])
    current_A, bridged = _bridge(time_s, current_A, wheels_measured, wheels.driven_places)
    return current_A, [*shared, *signed, *bridged]


def _rows_with_values(source: str, values: Sequence[np.ndarray]) -> Mended:
    """True (T,) for rows with any of these values, (T,) or (T, wheels), and a note on others; InputError for no row."""
    is_measured = np.isfinite(np.column_stack(values)).any(axis=1)
    if not is_measured.any():
        raise InputError(f"{source}: no row has the speed of a wheel or anything else that the robot measured")
    if is_measured.all():
        return is_measured, []
    return is_measured, [Note(f"{counted(int((~is_measured).sum()), 'row')} in which nothing was measured: dropped")]


def _wheel_notes(found: Found, columns: Mapping[str, Column], wheels: Wheels) -> list[Note]:
    """Notes on wheels that were identified by number, and on channels that driven ones do not have."""
    notes = []
    if found.by_number and not all(any(c.isdigit() for c in place) for place in wheels.places):
        text = f"wheels identified by their numbers, in the robot's order: {', '.join(wheels.places)}; check it"
        notes.append(Note(text, "warning"))
    for channel in WHEEL:
        absent = [place for place in wheels.driven_places if f"{place}_{channel.name}" not in columns]
        if absent and not wheels.steered:
            notes.append(Note(f"no {channel.name.replace('_', ' ')} of {', '.join(absent)}", "warning"))
    return notes


def _wheels(robot: Any, driven: int | None) -> Wheels:
    """The wheels of a robot, or from their names and the number of driven ones; InputError for anything else."""
    if hasattr(robot, "places") and driven in (None, robot.driven):
        steered = hasattr(getattr(robot, "chassis", None), "wheel_speeds")
        return Wheels(tuple(place.name for place in robot.places), robot.driven, steered)
    names = tuple(robot) if isinstance(robot, Iterable) and not isinstance(robot, str) else ()
    if not names or driven is None or not 0 <= driven <= len(names):
        raise InputError(
            "read_drive needs a Robot, as of load_robot('husky'), or the names of its wheels, driven ones first, and "
            f"the number of driven ones: read_drive(path, ('left', 'right', 'castor'), 2); got {robot!r:.60} and "
            f"driven={driven!r}"
        )
    return Wheels(names, driven)


def _share(current_A: np.ndarray, columns: Sequence[str]) -> Mended:
    """Divide a current measured for several motors evenly among them; columns: name for each motor, "" for none."""
    shared = {name: count for name, count in Counter(columns).items() if name and count > 1}
    notes = [Note(f"{name!r} is the current of {count} wheels: shared evenly") for name, count in shared.items()]
    return current_A / np.array([shared.get(name, 1) for name in columns]), notes


def _sign(current_A: np.ndarray, speed_rad_s: np.ndarray) -> Mended:
    """Give currents the sign of their wheel's speed if none is ever negative although wheels turn backwards."""
    backward = speed_rad_s < 0
    often = ((backward & (current_A > 0)).mean(axis=0) > _BACKWARD_FRACTION).any()
    if not often or (current_A < 0).any():
        return current_A, []
    text = (
        "motor currents are never negative although wheels turn backwards: read as magnitudes with the sign of the "
        "wheel's speed, which is wrong while braking"
    )
    return np.where(backward, -current_A, current_A), [Note(text, "warning")]


def _bridge(time_s: np.ndarray, current_A: np.ndarray, wheels_measured: np.ndarray, places: Sequence[str]) -> Mended:
    """Interpolate currents that are sampled on rows of their own linearly, but not over gaps."""
    known = np.isfinite(current_A)
    together = (known & wheels_measured[:, None]).sum(axis=0)
    apart = np.flatnonzero((known.sum(axis=0) > 1) & (together < _OWN_RATE_FRACTION * wheels_measured.sum()))
    if not apart.size:
        return current_A, []
    bridged = current_A.copy()
    for motor in apart:
        rows = known[:, motor]
        bridged[:, motor] = on_lines(time_s, time_s[rows], current_A[rows, motor])
    names = ", ".join(f"{places[int(motor)]} motor current".replace("_", " ") for motor in apart)
    return bridged, [Note(f"{names}: sampled on other rows than the wheels, straight lines in between")]


def _in_si(
    table: Table, time_s: np.ndarray, columns: Mapping[str, Column], mechanics: Mechanics
) -> tuple[dict[str, np.ndarray], list[Note]]:
    """Every channel (T,) in SI units, and notes on infinite values and counters that rolled over."""
    channels: dict[str, np.ndarray] = {}
    notes: list[Note] = []
    for quantity, column in columns.items():
        values, infinite = finite(column.name, table.columns[column.name])
        unit = wheel_columns.unit_of_channel(quantity, column, mechanics)
        notes += infinite
        if channel_of(quantity) is WHEEL_SPEED:
            channels[quantity], rolled = wheel_columns.wheel_speed(
                table.source, column.name, unit, values, time_s, mechanics
            )
            notes += rolled
        else:
            channels[quantity] = unit.in_si(values)
    return channels, list(dict.fromkeys(notes))  # several wheels may share a column


def _side_by_side(channels: Mapping[str, np.ndarray], quantities: Mapping[str, str], time_s: np.ndarray) -> np.ndarray:
    """One channel of several wheels (T, wheels), NaN where it was not measured."""
    values = np.full((time_s.size, len(quantities)), np.nan)
    for wheel, quantity in enumerate(quantities.values()):
        values[:, wheel] = channels.get(quantity, np.nan)
    return values


def _at_once(time_s: np.ndarray, speed_rad_s: np.ndarray) -> tuple[np.ndarray, tuple[Note, ...]]:
    """Interpolate speeds (T, wheels) of wheels that report in turn to the times of the first one, with a note.

    Speeds are linear between two samples of a wheel, but not over gaps. If all wheels report together in any row, the
    speeds are unchanged.
    """
    measured = np.flatnonzero(np.isfinite(speed_rad_s).any(axis=0))
    known = np.isfinite(speed_rad_s[:, measured])
    if measured.size < 2 or known.all(axis=1).any() or known.sum(axis=0).min() < 2:
        return speed_rad_s, ()
    first = known[:, 0]
    together = np.full(speed_rad_s.shape, np.nan)
    for wheel, rows in zip(measured, known.T, strict=True):
        together[first, wheel] = on_lines(time_s[first], time_s[rows], speed_rad_s[rows, wheel])
    text = "the wheels never report all at the same time: their speeds are interpolated to the times of the first one"
    return together, (Note(text),)


def _use_angles(time_s: np.ndarray, body: dict[str, np.ndarray]) -> list[Note]:
    """Derive a missing yaw rate from the yaw angle or heading, and reverse a clockwise heading; with notes.

    An angle from which the yaw rate is derived is removed, so that it is not used twice.
    """
    if "yaw_rate" not in body and (angles := [name for name in ("yaw", "heading") if name in body]):
        body["yaw_rate"] = wheel_columns.rate_of_change(time_s, body.pop(angles[0]), 2 * math.pi, over_gaps=True)
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
