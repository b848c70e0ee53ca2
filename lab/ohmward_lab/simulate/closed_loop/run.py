"""Result of a simulated drive: the log that the robot would have written, and the truth."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.traction.control import Report
from ohmward.traction.dynamics.energy_balance import EnergyBalance
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward_lab.simulate.closed_loop.scenario import Scenario
from ohmward_lab.simulate.robot_sensors import RobotTruth

#: Decimals of a time [s] in a log: nanoseconds.
_TIME_DIGITS = 9


class Instant(NamedTuple):
    """One instant of the truth; stacked over time every field has (K,) in front."""

    truth: RobotTruth  #: of the robot
    report: Report  #: of the controller
    #: of the battery, current > 0 charges
    current_A: Any
    voltage_V: Any
    soc: Any
    temperature_degC: Any
    energy_J: EnergyBalance  #: balance since the start


class RunRow(NamedTuple):
    """One row of the log: sample, estimate and truth at the time at which the sample was taken."""

    time_s: Any
    sample: RobotSample
    heading_rad: Any  #: of a compass; nan without one
    estimate: SlipEstimate | None  #: None without an observer
    truth: RobotTruth
    #: of the battery as measured, means since the row before
    current_A: Any
    voltage_V: Any
    soc: Any  #: true state of charge


class ClosedLoopRun(NamedTuple):
    """A whole drive."""

    scenario: Scenario
    history: Instant  #: the truth over time, (K, ...)
    rows: RunRow  #: the log, (T, ...)
    warnings: tuple[str, ...]  #: deviations from the commands, in sentences
    seconds: float  #: computing time, compilation included


def columns(run: ClosedLoopRun) -> dict[str, np.ndarray]:
    """The log as the columns (T,) of a file: what was measured at all, then truths."""
    table = drive_log(run).columns([p.name for p in run.scenario.model.places])
    true = truths(run)
    return {name: values for name, values in table.items() if name in true or np.isfinite(values).any()}


def truths(run: ClosedLoopRun) -> dict[str, np.ndarray]:
    """Columns (T,) of the truth."""
    truth, robot = run.rows.truth, run.scenario.model
    slips = {f"{p.name}_slip_true": truth.slip_ratio[:, k] for k, p in enumerate(robot.places) if p.driven}
    sideways = {"lateral_speed_true_m_s": truth.lateral_speed_m_s} if robot.freedoms == 3 else {}
    return {
        "speed_true_m_s": truth.speed_m_s,
        "yaw_rate_true_rad_s": truth.yaw_rate_rad_s,
        **sideways,
        **slips,
        "soc_true": run.rows.soc,
    }


def drive_log(run: ClosedLoopRun) -> DriveLog:
    """The log as `read_drive` would read it from a file."""
    rows, sample = run.rows, run.rows.sample
    body: dict[str, Any] = {
        "yaw_rate_rad_s": sample.yaw_rate_rad_s,
        "acceleration_m_s2": sample.acceleration_m_s2,
        "pitch_rad": sample.pitch_rad,
        "speed_m_s": sample.speed_m_s,
        "speed_std_m_s": sample.speed_std_m_s,
        "speed_age_s": np.where(np.isfinite(sample.speed_m_s), sample.speed_age_s, np.nan),
        "heading_rad": rows.heading_rad,
    }
    return DriveLog(
        run.scenario.name or "simulated drive",
        np.round(rows.time_s, _TIME_DIGITS),
        sample.wheel_speed_rad_s,
        sample.current_A,
        **{name: values for name, values in body.items() if np.isfinite(values).any()},
        extra={"current_A": rows.current_A, "voltage_V": rows.voltage_V, **truths(run)},
        notes=(Note(f"simulated, not measured: {run.scenario.model.name}, seed {run.scenario.seed}"),),
    )
