"""State of the robot: everything that is known at an instant, one record for every sink, and plain dicts for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.cells.pack_estimator import PackEstimate
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy.range_step import RangeEstimate
from ohmward.filters.consistency import BAND_95
from ohmward.filters.flags import SampleFlag
from ohmward.onboard.totals import Totals
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.speed_observer.estimate import SlipEstimate


class Level(IntEnum):
    """Severity of a condition; the numbers are those of `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Diagnostic(NamedTuple):
    """Condition of a sensor, a source, a sink or an estimate."""

    name: str  #: of the thing, "source can0", "battery_voltage_V", "charge"
    level: Level  #: how bad it is
    message: str  #: a sentence for people, with the fix where there is one
    values: Mapping[str, str | float] = {}  #: figures beside it


class Alarm(NamedTuple):
    """A condition that somebody has to hear of, see `alarms`."""

    name: str  #: "stuck", "bms", "empty", "low", "home", "cells", "slip"
    text: str  #: a sentence for people, with what to do
    since_unix_s: float  #: date at which it was raised


class RobotState(NamedTuple):
    """Everything that is known at an instant. What is not estimated, or not yet, is None."""

    time_s: float  #: of the sample, on the monotonic clock of the process
    unix_s: float  #: the same as a date, seconds since 1970
    sample: Mapping[str, float] = {}  #: measured values that made this state, by signal
    #: charge; cells: of the pack; slip: speed and slip; pose: odometry; range: how far the rest reaches
    battery: SocEstimate | None = None

    cells: PackEstimate | None = None
    slip: SlipEstimate | None = None
    pose: OdometryEstimate | None = None
    range: RangeEstimate | None = None
    diagnostics: tuple[Diagnostic, ...] = ()  #: conditions of sensors, sources, sinks and estimates, the latest of each
    #: of the samples behind the estimates of battery, drive and cells, nan before the first. While no sensor reports,
    #: states with new diagnostics go on, and these stand still; bands grow meanwhile, see `evidence`.
    battery_time_s: float = math.nan
    drive_time_s: float = math.nan
    cells_time_s: float = math.nan
    #: the first two as dates that the source gave, as ROS and dated logs do; nan where the wall clock counts: `date_s`
    battery_unix_s: float = math.nan
    drive_unix_s: float = math.nan
    silent: tuple[str, ...] = ()  #: "battery", "cells" and "drive", of those whose sensors are all silent
    alarms: tuple[Alarm, ...] = ()  #: those that are raised, the most urgent first
    totals: Totals | None = None  #: since ever; None before anything was measured
    wheels: tuple[str, ...] = ()  #: names of the driven wheels of the robot file, in the order of the arrays of `slip`

    def date_s(self, group: str) -> float:
        """Date of the sample behind the estimates of the "battery" or of the "drive", seconds since 1970."""
        time_s, given_s = getattr(self, f"{group}_time_s"), getattr(self, f"{group}_unix_s")
        return given_s if math.isfinite(given_s) else self.unix_s - (self.time_s - time_s)

    def is_silent(self, group: str) -> bool:
        """True where the sensors of the "battery" or of the "drive" have reported, and do not any more."""
        estimate = self.battery if group == "battery" else self.slip
        return group in self.silent or (estimate is None and math.isfinite(getattr(self, f"{group}_time_s")))


def soc_band(soc: float, soc_std: float) -> tuple[float, float]:
    """Band of 95 % of a state of charge, within what it can be."""
    return max(soc - BAND_95 * soc_std, 0.0), min(soc + BAND_95 * soc_std, 1.0)


def stale(state: RobotState) -> str:
    """Sentence about the sensors that are silent; "" where every estimate has some that report."""
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
    """The state as a dict for JSON, parts that are not estimated left out."""
    return {name: plain(value) for name, value in zip(state._fields, state, strict=True) if value is not None}


def plain(value: Any) -> Any:
    """A value as JSON knows it: null for a number that is not finite, flags and levels by name, records as dicts."""
    if isinstance(value, SampleFlag):
        return [flag.name for flag in value]
    if isinstance(value, Level):
        return value.name
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "_asdict"):
        return {name: plain(item) for name, item in value._asdict().items()}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
