"""State of the robot: everything that is known at an instant, one record for every sink, and plain dicts for JSON.

Sinks that send single numbers name them by path: "battery.soc", "slip.slip_ratio.0"; "sample.battery_current_A" is
a measured value; "age_s.battery" is the time since the sample behind the estimates of the battery, and likewise
"age_s.drive" and "age_s.cells".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

from ohmward.battery.cells.pack_estimator import PackEstimate
from ohmward.battery.soc.sample import SocEstimate
from ohmward.checks import require_one_of
from ohmward.energy.range_step import RangeEstimate
from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.json_values import plain
from ohmward.onboard.message import as_number
from ohmward.quantities import SECONDS_PER_HOUR, quantity_of
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.speed_observer.estimate import SlipEstimate

#: Longest step between two samples that is counted; samples further apart enclose a gap [s].
TOTALS_GAP_S = 60.0

_WH_PER_KWH, _M_PER_KM = 1e3, 1e3


class Totals(NamedTuple):
    """Sums over everything that was measured; nothing is counted while no sensor reports."""

    charge_in_Ah: float = 0.0  #: into the battery
    charge_out_Ah: float = 0.0  #: out of it
    energy_in_kWh: float = 0.0  #: into the battery
    energy_out_kWh: float = 0.0  #: out of it
    #: equivalent full cycles: charge in both directions over twice the capacity in the battery file
    cycles: float = 0.0
    distance_km: float = 0.0  #: driven

    def plus_charge(self, charge_Ah: float, voltage_V: float, capacity_Ah: float) -> Totals:
        """The totals after a charge of one sign at a voltage.

        charge_Ah: > 0 into the battery.  voltage_V: mean, nan if it was not measured: no energy is counted.
        """
        energy_kWh = abs(charge_Ah) * voltage_V / _WH_PER_KWH if math.isfinite(voltage_V) else 0.0
        cycles = self.cycles + abs(charge_Ah) / (2.0 * capacity_Ah)
        if charge_Ah > 0.0:
            charge_in_Ah, energy_in_kWh = self.charge_in_Ah + charge_Ah, self.energy_in_kWh + energy_kWh
            return self._replace(charge_in_Ah=charge_in_Ah, energy_in_kWh=energy_in_kWh, cycles=cycles)
        charge_out_Ah, energy_out_kWh = self.charge_out_Ah - charge_Ah, self.energy_out_kWh + energy_kWh
        return self._replace(charge_out_Ah=charge_out_Ah, energy_out_kWh=energy_out_kWh, cycles=cycles)

    def after_battery(self, dt_s: float, current_A: float, voltage_V: float, capacity_Ah: float) -> Totals:
        """The totals after a step with these means, unless it is a gap.

        dt_s: since the previous sample.  current_A: > 0 charges.  current_A, voltage_V: nan is not measured.
        """
        if not (0.0 < dt_s <= TOTALS_GAP_S and math.isfinite(current_A)):
            return self
        return self.plus_charge(current_A * dt_s / SECONDS_PER_HOUR, voltage_V, capacity_Ah)

    def after_drive(self, before_m: float, distance_m: float) -> Totals:
        """The totals after the path has grown from one length to another; a shorter one means that it restarted."""
        grown_m = distance_m - before_m if distance_m >= before_m else distance_m
        return self._replace(distance_km=self.distance_km + grown_m / _M_PER_KM) if math.isfinite(grown_m) else self


def totals_from(content: Mapping[str, Any]) -> Totals:
    """The totals in a snapshot; 0 for an invalid number."""
    known = {name: content.get(name) for name in Totals._fields}
    return Totals(**{name: float(v) for name, v in known.items() if isinstance(v, int | float) and 0.0 <= v < 1e12})


class Level(IntEnum):
    """Severity of a condition; the numbers are those of `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Diagnostic(NamedTuple):
    """Condition of a sensor, a source, a sink or an estimate."""

    name: str  #: its subject, "source can0", "battery_voltage_V", "charge"
    level: Level  #: severity
    message: str  #: a sentence for people, with the fix if there is one
    values: Mapping[str, str | float] = {}  #: figures that belong to it


class Alarm(NamedTuple):
    """A condition that needs somebody's attention, see `alarms`."""

    name: str  #: "stuck", "bms", "empty", "low", "charge", "home", "cells", "slip"
    text: str  #: a sentence for people, with what to do
    since_unix_s: float  #: date at which it was raised


class RobotState(NamedTuple):
    """Everything that is known at an instant; estimates that do not exist, or not yet, are None."""

    time_s: float  #: of the sample, on the monotonic clock of the process
    unix_s: float  #: the same as a date, seconds since 1970
    sample: Mapping[str, float] = {}  #: measured values behind this state, by signal
    #: charge; cells: of the pack; slip: speed and slip; pose: odometry; range: distance and time left
    battery: SocEstimate | None = None

    cells: PackEstimate | None = None
    slip: SlipEstimate | None = None
    pose: OdometryEstimate | None = None
    range: RangeEstimate | None = None
    diagnostics: tuple[Diagnostic, ...] = ()  #: conditions of sensors, sources, sinks and estimates, the latest of each
    #: times of the samples behind the estimates of battery, drive and cells, nan before the first. While no sensor
    #: reports, states with new diagnostics still come with these times unchanged; bands grow, see `evidence`.
    battery_time_s: float = math.nan
    drive_time_s: float = math.nan
    cells_time_s: float = math.nan
    #: the first two as dates given by the source, as by ROS or a dated log; nan if the wall clock applies: `date_s`
    battery_unix_s: float = math.nan
    drive_unix_s: float = math.nan
    silent: tuple[str, ...] = ()  #: which of "battery", "cells" and "drive" have only silent sensors
    alarms: tuple[Alarm, ...] = ()  #: raised alarms, the most urgent first
    totals: Totals | None = None  #: sums over the robot's life; None before anything was measured
    wheels: tuple[str, ...] = ()  #: names of the driven wheels of the robot file, in the order of the arrays of `slip`
    restarts: int = 0  #: number of times that a simulation or a bag has begun again, and all times with it

    def date_s(self, group: str) -> float:
        """Date of the sample behind the estimates of the "battery" or of the "drive", seconds since 1970."""
        time_s, given_s = getattr(self, f"{group}_time_s"), getattr(self, f"{group}_unix_s")
        return given_s if math.isfinite(given_s) else self.unix_s - (self.time_s - time_s)

    def is_silent(self, group: str) -> bool:
        """True if the sensors of the "battery" or of the "drive" have reported before, but no longer do."""
        estimate = self.battery if group == "battery" else self.slip
        return group in self.silent or (estimate is None and math.isfinite(getattr(self, f"{group}_time_s")))


def is_charging(current_A: float, charge: SocEstimate | None) -> bool:
    """True if the current charges the battery by more than the offset of its sensor explains."""
    if charge is None or math.isnan(charge.current_offset_A):
        return current_A > 0.0
    return current_A - charge.current_offset_A > charge.current_offset_std_A


def soc_band(soc: float, soc_std: float) -> tuple[float, float]:
    """95 % band of a state of charge, limited to 0 to 1."""
    low, high = (min(max(soc + z * soc_std, 0.0), 1.0) for z in (-BAND_95, BAND_95))
    return low, high


def stale(state: RobotState) -> str:
    """Sentence about silent sensors; "" if every estimate has sensors that report."""
    missing = [
        part if state.time_s - time_s < 60.0 else f"{part} for {(state.time_s - time_s) / 60.0:.0f} min"
        for group, part, time_s in (
            ("battery", "battery", state.battery_time_s),
            ("drive", "wheels", state.drive_time_s),
        )
        if state.is_silent(group)
    ]
    if missing:
        return f"stale: no news from the sensors of the {' and of the '.join(missing)}"
    return "no news from any sensor yet" if state.battery is None and state.slip is None else ""


def plain_state(state: RobotState) -> dict[str, Any]:
    """The state as a dict for JSON, without parts that are not estimated."""
    return {name: plain(value) for name, value in zip(state._fields, state, strict=True) if value is not None}


#: Parts of a state that hold numbers by name.
PARTS: dict[str, type] = {
    "battery": SocEstimate,
    "cells": PackEstimate,
    "slip": SlipEstimate,
    "pose": OdometryEstimate,
    "range": RangeEstimate,
    "totals": Totals,
}

#: Estimates whose evidence has an age.
AGES = ("battery", "drive", "cells")


def require_path(path: str) -> None:
    """Raise InputError unless states can have a number at this path; the message lists the valid names."""
    part, _, rest = path.partition(".")
    if part == "sample":
        quantity_of(rest)
        return
    if part == "age_s":
        require_one_of(f"{path!r}: the second word", rest, AGES)
        return
    require_one_of(f"{path!r}: the first word", part, [*PARTS, "sample", "age_s"])
    names: tuple[str, ...] = getattr(PARTS[part], "_fields", ())
    name = rest.partition(".")[0]
    if name not in names:
        raise InputError(f"{path!r}: {part} has no {name!r}; it has {', '.join(names)}")


def number_at(state: RobotState, path: str) -> float:
    """The number at a path of the state; nan if it is unknown or not a number."""
    part, _, rest = path.partition(".")
    if part == "age_s":
        return max(state.time_s - float(getattr(state, f"{rest}_time_s")), 0.0)
    value: Any = getattr(state, part)
    if part == "sample":
        return as_number(value.get(rest, math.nan))
    for word in rest.split("."):
        if word.isdecimal() and hasattr(value, "__len__"):
            value = value[int(word)] if int(word) < len(value) else None
        else:
            value = getattr(value, word, None) if word in getattr(value, "_fields", ()) else None
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan
