"""States of the robot as rows of tables: one kind for the battery, one for the drive, one for conditions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ohmward.onboard.robot_state import RobotState
from ohmward.quantities import GROUPS, names_of

#: Kinds of rows that hold numbers.
KINDS = tuple(GROUPS)


class Row(NamedTuple):
    """Measurements and estimates of one time."""

    kind: str  #: "battery" or "drive"
    unix_ns: int  #: time on the wall clock; no two rows of a kind have the same while the clock runs forward
    values: Mapping[str, float]  #: column -> number; unknown ones are left out


class ConditionRow(NamedTuple):
    """A new condition: time on the wall clock, name, level and sentence of a diagnostic."""

    unix_ns: int
    name: str
    level: str
    message: str


class RowMaker:
    """States in order, rows out: each estimate once."""

    def __init__(self) -> None:
        self._seen_s = dict.fromkeys(KINDS, -math.inf)
        self._last_ns = dict.fromkeys(KINDS, 0)
        self._conditions: dict[str, tuple[str, str]] = {}

    def rows(self, state: RobotState) -> Iterator[Row]:
        """Rows of a state; none if nothing was estimated since the previous one."""
        for kind, time_s, values in (
            ("battery", state.battery_time_s, _battery),
            ("drive", state.drive_time_s, _drive),
        ):
            if not math.isnan(time_s) and time_s != self._seen_s[kind]:
                self._seen_s[kind] = time_s
                numbers = {name: float(value) for name, value in values(state).items() if math.isfinite(value)}
                yield Row(kind, self._time_ns(kind, state.date_s(kind)), numbers)

    def conditions(self, state: RobotState) -> Iterator[ConditionRow]:
        """Conditions that are new or have changed."""
        for name, level, message, _ in state.diagnostics:
            now = level.name, message
            if self._conditions.get(name) != now:
                self._conditions[name] = now
                yield ConditionRow(round(1e9 * state.unix_s), name, *now)

    def _time_ns(self, kind: str, unix_s: float) -> int:
        unix_ns = round(1e9 * unix_s)
        last_ns = self._last_ns[kind]
        if last_ns - 1_000_000 < unix_ns <= last_ns:  # the wall clock is slewed, not set
            unix_ns = last_ns + 1
        self._last_ns[kind] = unix_ns
        return unix_ns


def columns_of(state: RobotState) -> dict[str, float]:
    """Measurements and estimates of battery and drive, by column; nan for unknown ones."""
    return _battery(state) | _drive(state)


def _battery(state: RobotState) -> dict[str, float]:
    values = _measured(state, "battery")
    if charge := state.battery:
        names = ("soc", "soc_std", "current_offset_A", "soh_capacity", "resistance_ratio")
        values |= {name: getattr(charge, name) for name in names} | {"soc_flags": charge.flags}
    if reach := state.range:
        values |= {f"range_{point}_m": getattr(reach.distance_m, point) for point in reach.distance_m._fields}
        values |= {f"time_left_{point}_s": getattr(reach.duration_s, point) for point in reach.duration_s._fields}
    return values


def _drive(state: RobotState) -> dict[str, float]:
    values = _measured(state, "drive")
    if slip := state.slip:
        values |= {
            "estimated_speed_m_s": slip.speed_m_s,
            "estimated_speed_std_m_s": slip.speed_std_m_s,
            "estimated_yaw_rate_rad_s": slip.yaw_rate_rad_s,
            "grade_rad": slip.grade_rad,
            "slip_flags": slip.flags,
        }
        for k, wheel in enumerate(state.wheels):
            values |= {f"slip_ratio.{wheel}": slip.slip_ratio[k], f"traction_N.{wheel}": slip.traction_N[k]}
    if pose := state.pose:
        names = ("x_m", "y_m", "yaw_rad", "position_std_m", "distance_m")
        values |= {name: getattr(pose, name) for name in names}
    return values


def _measured(state: RobotState, kind: str) -> dict[str, float]:
    names = names_of(kind)
    return {signal: value for signal, value in state.sample.items() if signal.partition(".")[0] in names}
