"""One recording of a drive: wheels, motors and what else the robot measured, in SI units and in the robot's order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ohmward.errors import InputError
from ohmward.logs import recording
from ohmward.logs.log import Note

#: Channels of the body: optional, (T,) each.
BODY = ("yaw_rate_rad_s", "acceleration_m_s2", "pitch_rad", "speed_m_s", "speed_std_m_s", "speed_age_s")


@dataclass(frozen=True, eq=False)
class DriveLog:
    """A recording of a drive. Arrays are read-only float64; NaN where nothing new was measured.

    name: what to call it, usually the file's stem.
    time_s: (T,) [s], finite and strictly increasing.
    wheel_speed_rad_s: (T, wheels) of every wheel, driven ones first, > 0 forward; all NaN for a wheel without encoder.
    motor_current_A: (T, driven), > 0 drives forward.
    yaw_rate_rad_s: of a gyro, > 0 to the left.
    acceleration_m_s2: of an accelerometer along x, gravity included: at rest g sin(pitch).
    pitch_rad: of an attitude filter, > 0 with the nose up.
    speed_m_s, speed_std_m_s, speed_age_s: forward, from GNSS, visual or lidar odometry or optical flow; its standard
        deviation; how long before `time_s` it was true.
    extra: further numeric columns by their name in the file, (T,) each: truths, for example.
    notes: everything that was assumed, converted or dropped on the way.

    Raises:
        InputError: no samples, shapes that differ, time that is not finite or does not increase.
    """

    name: str
    time_s: np.ndarray
    wheel_speed_rad_s: np.ndarray
    motor_current_A: np.ndarray
    yaw_rate_rad_s: np.ndarray | None = None
    acceleration_m_s2: np.ndarray | None = None
    pitch_rad: np.ndarray | None = None
    speed_m_s: np.ndarray | None = None
    speed_std_m_s: np.ndarray | None = None
    speed_age_s: np.ndarray | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        recording.freeze(self, ("time_s", "wheel_speed_rad_s", "motor_current_A", *BODY))
        recording.require_time(self)
        recording.require_lengths(self, BODY)
        for name in ("wheel_speed_rad_s", "motor_current_A"):
            self._require_row_for_each_time(name)

    def __len__(self) -> int:
        return self.time_s.size

    @property
    def duration_s(self) -> float:
        """Last minus first time [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the body that were measured at all."""
        values = {name: getattr(self, name) for name in BODY}
        return tuple(name for name, v in values.items() if v is not None and np.isfinite(v).any())

    def select(self, rows: slice | np.ndarray) -> DriveLog:
        """The samples that a slice, a mask (T,) or indices pick; at least one, in order of time."""
        return recording.select(self, rows)

    def between(self, start_s: float, stop_s: float) -> DriveLog:
        """The samples with start_s <= time_s < stop_s; the clock keeps its zero."""
        return recording.between(self, start_s, stop_s)

    def with_notes(self, *notes: Note) -> DriveLog:
        """The same log with more notes."""
        return replace(self, notes=self.notes + notes)

    def _require_row_for_each_time(self, name: str) -> None:
        shape = getattr(self, name).shape
        if len(shape) != 2 or shape[0] != len(self):
            raise InputError(
                f"DriveLog {self.name!r}: {name} must be ({len(self)}, wheels), one row for each time, not {shape}"
            )
