"""The log of a drive: wheels, motors and the body's sensors in SI units, and its reader."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.clean import gap_notes
from ohmward.logs.drive_channels import DriveChannels, drive_channels, to_numbers
from ohmward.logs.frame import to_frame
from ohmward.logs.hints import FileHints
from ohmward.logs.plausible import require_plausible_drive
from ohmward.logs.read import RecordedTable, Wanted, open_table, read_recording
from ohmward.logs.table import Note, TableFile, counted, with_sample_time
from ohmward.logs.time_series import TimeSeries
from ohmward.logs.wheel_columns import Wheels, find_drive_columns
from ohmward.logs.wheel_speed import Mechanics
from ohmward.quantities import BODY, QUANTITIES

#: A `DriveLog`, or a path or DataFrame of one.
DriveSource: TypeAlias = "DriveLog | str | PathLike[str] | Any"


@dataclass(frozen=True, eq=False)
class DriveLog(TimeSeries):
    """A recording of a drive. Arrays are read-only float64; NaN where nothing new was measured.

    Any array-like of numbers will do; None and NaN are missing. Dates and durations as time become seconds.

    Raises:
        InputError: no samples, shapes that differ, time that is not finite or does not increase, no numbers.
    """

    name: str  #: usually the file's stem
    time_s: np.ndarray  #: (T,) [s], finite and strictly increasing
    #: (T, wheels) of every wheel, driven ones first, > 0 forward; all NaN for a wheel without encoder
    wheel_speed_rad_s: np.ndarray
    motor_current_A: np.ndarray  #: (T, driven), > 0 drives forward
    yaw_rate_rad_s: np.ndarray | None = None  #: of a gyro, > 0 to the left
    acceleration_m_s2: np.ndarray | None = None  #: of an accelerometer along x, gravity included: at rest g sin(pitch)
    pitch_rad: np.ndarray | None = None  #: of an attitude filter, > 0 with the nose up
    #: forward, from GNSS, visual or lidar odometry or optical flow; its standard deviation; the time before `time_s` at
    #: which it was true
    speed_m_s: np.ndarray | None = None
    speed_std_m_s: np.ndarray | None = None
    speed_age_s: np.ndarray | None = None
    #: of a compass or two GNSS antennas, > 0 to the left, from any zero; its standard deviation
    heading_rad: np.ndarray | None = None
    heading_std_rad: np.ndarray | None = None
    #: further quantities of the body by their name, and numeric columns by theirs in the file, (T,) each: truths, too
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()  #: everything that was assumed, converted or dropped on the way
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
        """The channels of the body that were measured at all."""
        values = {name: getattr(self, name) for name in BODY}
        return tuple(name for name, v in values.items() if v is not None and np.isfinite(v).any())

    @classmethod
    def from_pandas(cls, frame: Any, robot: Any, driven: int | None = None, **options: Any) -> DriveLog:
        """The drive in a DataFrame; the same as `read_drive(frame, robot, driven, **options)`."""
        return read_drive(frame, robot, driven, **options)

    def to_pandas(self, places: Sequence[str] | None = None) -> Any:
        """A DataFrame of `columns` over `time_s` [s]."""
        return to_frame(self.columns(places), self.name)

    def columns(self, places: Sequence[str] | None = None) -> dict[str, np.ndarray]:
        """A column (T,) for each channel, units in their names, and the extra columns.

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
    """The drive in a CSV or Parquet file, a recording of ROS, a ULog of PX4, or in a DataFrame.

    source: the path of the file, of any of these formats whatever its name; or the DataFrame.
    robot: a Robot, or the names of its wheels, driven ones first.
    driven: number of driven wheels; only with names.
    radius_m: of the wheels; needed for speeds in m/s at the rim; that of the robot unless given.
    gear_ratio: of the motors; used where the speeds are the motors' own; that of the robot, or 1, unless given.
    at_motor_shaft: wheel speeds and counts are of the motor, before the gear.
    counts_per_turn: of the encoders; needed for counts.
    columns: channel -> column name, where names alone do not tell: {"front_left_wheel_speed": "velL"}.
    units: channel or kind -> unit: {"wheel_speed": "rpm"}.
    where: column -> value, to choose one of several recordings; "recording" counts clock restarts.
        Of a recording of ROS, {"topic": "/joint_states,/imu"} names the topics.
    extra: further columns to keep; None keeps every numeric one.
    leave: columns not to take for a sensor by their names: truths.
    sort_time: sort rows that are out of order, whatever the reason.
    hints: names, encoding, notation of dates, time zone and the like, where the file does not tell.

    Raises:
        InputError: the file cannot be read as a drive; the message names the file, the place and the fix.
        OhmwardError: Parquet without pyarrow, a recording of ROS without rosbags.
    """
    wheels = _wheels(robot, driven)
    if hasattr(robot, "places"):
        radius_m = robot.wheel.radius_m if radius_m is None else radius_m
        gear_ratio = robot.motor.gear_ratio if gear_ratio is None else gear_ratio
    mechanics = Mechanics(radius_m, 1.0 if gear_ratio is None else gear_ratio, at_motor_shaft, counts_per_turn)
    file = with_sample_time(open_table(source, hints).part("drive", where))
    found = find_drive_columns(file.source, file.names, wheels, file.given(columns), units, leave)
    wanted = Wanted(where or {}, extra, sort_time)
    rows = read_recording(file, found.columns, wanted, lambda table: to_numbers(table, found.columns))
    channels = drive_channels(rows.table, found, wheels, mechanics)
    require_plausible_drive(file.source, found.columns["time"], channels.time_s, rows.guessed_unit)
    order: tuple[Note, ...] = ()
    if found.by_number and not all(any(c.isdigit() for c in place) for place in wheels.places):
        text = f"wheels told by their numbers, in the robot's order: {', '.join(wheels.places)}; check it"
        order = (Note(text, "warning"),)
    return _as_log(file, rows, channels, order).part(file.hints)


def as_drive(source: DriveSource, robot: Any) -> DriveLog:
    """The drive itself, or that of a robot in a path or DataFrame, read by `read_drive` without further options.

    Raises:
        InputError: neither, or what `read_drive` refuses.
    """
    return source if isinstance(source, DriveLog) else read_drive(source, robot)


def _as_log(file: TableFile, rows: RecordedTable, channels: DriveChannels, order: Sequence[Note]) -> DriveLog:
    """The log of the rows in which something was measured; InputError where there is none."""
    measured = channels.measured
    if not measured.any():
        raise InputError(f"{file.source}: no row has the speed of a wheel or anything else that the robot measured")
    notes = [*rows.table.notes, *channels.notes]
    if not measured.all():
        notes.append(Note(f"{counted(int((~measured).sum()), 'row')} in which nothing was measured: dropped"))
    known = [quantity for quantity in QUANTITIES.values() if quantity.owner == "body"]
    body = {quantity.field: channels.body[quantity.channel] for quantity in known if quantity.channel in channels.body}
    log = DriveLog(
        name=file.stem,
        time_s=channels.time_s,
        wheel_speed_rad_s=channels.wheel_speed_rad_s,
        motor_current_A=channels.motor_current_A,
        **{name: values for name, values in body.items() if name in BODY},
        extra={
            **{name: values for name, values in body.items() if name not in BODY},
            **{name: values for name, values in rows.table.columns.items() if name not in rows.own},
        },
        notes=(*notes, *order, *channels.absent, *gap_notes(channels.time_s)),
        start_unix_s=rows.start_unix_s,
        time_zone=rows.time_zone,
    )
    return log.select(measured)


def _wheels(robot: Any, driven: int | None) -> Wheels:
    """The wheels of a robot, or of names and the number of driven ones; InputError for anything else."""
    if hasattr(robot, "places") and driven in (None, robot.driven):
        return Wheels(tuple(place.name for place in robot.places), robot.driven)
    names = tuple(robot) if isinstance(robot, Iterable) and not isinstance(robot, str) else ()
    if not names or driven is None or not 0 <= driven <= len(names):
        raise InputError(
            "read_drive needs a Robot, or the names of its wheels, driven ones first, and the number of driven ones: "
            f"read_drive(path, ('left', 'right', 'castor'), 2); got {robot!r:.60} and driven={driven!r}"
        )
    return Wheels(names, driven)
