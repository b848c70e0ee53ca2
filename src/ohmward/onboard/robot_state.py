"""State of the robot: everything that is known at an instant, one record for every sink."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from ohmward.battery.cells.pack_estimator import PackEstimate
from ohmward.battery.soc.sample import SocEstimate
from ohmward.energy.range_step import RangeEstimate
from ohmward.traction.odometry.sample import OdometryEstimate
from ohmward.traction.speed_observer.estimate import SlipEstimate


class Level(IntEnum):
    """Severity of a condition; the numbers are those of `diagnostic_msgs/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Diagnostic(NamedTuple):
    """Condition of a sensor, a source, a sink or an estimate.

    name: of the thing, "source can0", "battery_voltage_V", "charge".
    level: how bad it is.  message: a sentence for people, with the fix where there is one.
    values: figures beside it.
    """

    name: str
    level: Level
    message: str
    values: Mapping[str, str | float] = {}


class RobotState(NamedTuple):
    """Everything that is known at an instant. What is not estimated, or not yet, is None.

    time_s: of the sample, on the monotonic clock of the process.
    unix_s: the same on the wall clock.
    sample: measured values that made this state, by signal.
    battery: charge; cells: of the pack; slip: speed and slip; pose: odometry; range: how far the rest reaches.
    diagnostics: conditions of sensors, sources, sinks and estimates, the latest of each.
    battery_time_s, drive_time_s: of the samples behind the estimates of battery and drive, nan before the first. While
        no sensor reports, states with new diagnostics go on, and these two stand still.
    """

    time_s: float
    unix_s: float
    sample: Mapping[str, float] = {}
    battery: SocEstimate | None = None
    cells: PackEstimate | None = None
    slip: SlipEstimate | None = None
    pose: OdometryEstimate | None = None
    range: RangeEstimate | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    battery_time_s: float = math.nan
    drive_time_s: float = math.nan


def wheel_names(state: RobotState) -> list[str]:
    """Names of the driven wheels, numbers where the sample does not name them."""
    assert state.slip is not None
    prefix = "wheel_speed_rad_s."
    named = [signal.removeprefix(prefix) for signal in state.sample if signal.startswith(prefix)]
    driven = len(state.slip.slip_ratio)
    return (named if len(named) >= driven else [f"wheel_{k}" for k in range(driven)])[:driven]
