"""Result of a simulated drive: the log that the robot would have written, the truth, and the figures of the drive.

The figures are the tracking of slip, the score of the observer and the energy balance.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.quantities import BODY
from ohmward.traction.control import Report
from ohmward.traction.dynamics.forces import EnergyBalance
from ohmward.traction.dynamics.slip import driving_slip_ratio
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.robot.robot import Robot, free_sideways
from ohmward.traction.score import DriveScore, DriveTruth, score_drive
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
    """The log as the columns (T,) of a file: the signals that were measured, then the truth."""
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


def body_signals(rows: RunRow) -> dict[str, Any]:
    """Measurements (T,) of the body by signal, nan where nothing was measured."""
    found = {name: getattr(rows.sample, name) for name in BODY if name in rows.sample._fields}
    found["speed_age_s"] = np.where(np.isfinite(rows.sample.speed_m_s), rows.sample.speed_age_s, np.nan)
    found["heading_rad"] = rows.heading_rad
    return found


def drive_log(run: ClosedLoopRun) -> DriveLog:
    """The log as `read_drive` would read it from a file."""
    rows, sample = run.rows, run.rows.sample
    return DriveLog(
        run.scenario.name or "simulated drive",
        np.round(rows.time_s, _TIME_DIGITS),
        sample.wheel_speed_rad_s,
        sample.current_A,
        **{name: values for name, values in body_signals(rows).items() if np.isfinite(values).any()},
        extra={"current_A": rows.current_A, "voltage_V": rows.voltage_V, **truths(run)},
        notes=(Note(f"simulated, not measured: {run.scenario.model.name}, seed {run.scenario.seed}"),),
    )


#: A slip this close to the commanded one counts as reached.
REACHED_SLIP = 0.02
#: Below this speed [m/s] controllers hold a slip speed (v_0) instead of a braking slip ratio.
SLIP_RATIO_FROM_M_S = 0.2
#: Energy per metre is not defined for a shorter distance [m].
_SHORTEST_WAY_M = 0.01


class SlipTracking(NamedTuple):
    """Tracking of one slip command by the worst of the driven wheels."""

    #: time for which it held; in braking, until the robot is slower than `SLIP_RATIO_FROM_M_S`
    from_s: float
    to_s: float
    slip_ratio: float  #: commanded
    settle_s: float  #: from its beginning until the slip stayed within `REACHED_SLIP`; nan where it never did
    rms_error: float  #: of the true slip, in the second half of that time


class Figures(NamedTuple):
    """Figures of a whole drive; nan where one is not defined."""

    #: duration, and distance travelled by the robot's centre, forward and back
    duration_s: float
    distance_m: float
    slip: tuple[SlipTracking, ...]  #: each command of slip
    #: of the first command of slip, and the root mean square over all of them
    slip_settle_s: float
    slip_rms_error: float
    energy_J: EnergyBalance  #: balance of the drive
    energy_J_per_m: float  #: out of the battery, idle power included
    score: DriveScore | None  #: of the observer, against the truth; None without one


def figures(run: ClosedLoopRun) -> Figures:
    """The figures of a drive."""
    history = run.history
    distance_m = distance(history)
    energy = EnergyBalance(*(float(term[-1]) for term in history.energy_J))
    slip = tuple(slip_tracking(run))
    return Figures(
        duration_s=float(history.truth.time_s[-1]),
        distance_m=distance_m,
        slip=slip,
        slip_settle_s=slip[0].settle_s if slip else math.nan,
        slip_rms_error=_rms(np.array([tracked.rms_error for tracked in slip])),
        energy_J=energy,
        energy_J_per_m=energy.battery / distance_m if distance_m > _SHORTEST_WAY_M else math.nan,
        score=score(run),
    )


def distance(history: Instant) -> float:
    """Distance travelled by the robot's centre [m]."""
    steps = np.diff(history.truth.position_m[:, :2], axis=0, prepend=np.zeros((1, 2)))
    return float(np.hypot(*steps.T).sum())


def slip_tracking(run: ClosedLoopRun) -> list[SlipTracking]:
    """Tracking of each command of slip."""
    truth, commands = run.history.truth, run.scenario.commands
    slip = true_slip(run.history, run.scenario.model)
    ends_s = [*(c.from_s for c in commands[1:]), math.inf]
    tracked = []
    for command, end_s in zip(commands, ends_s, strict=True):
        rows = (truth.time_s > command.from_s) & (truth.time_s <= end_s)
        if command.slip_ratio is not None and command.slip_ratio < 0:
            rows &= np.cumsum(rows & (np.abs(truth.speed_m_s) < SLIP_RATIO_FROM_M_S)) == 0
        held = run.scenario.controller.mode_of(command) == "slip"
        if held and command.slip_ratio is not None and rows.any():
            tracked.append(track_command(truth.time_s[rows], slip[rows], command.from_s, command.slip_ratio))
    return tracked


def true_slip(history: Instant, robot: Robot) -> np.ndarray:
    """Slip ratio (K, driven), > 0 driving and < 0 braking in either direction of travel; nan at rest."""
    n, truth = robot.driven, history.truth
    rim = robot.wheel.radius_m * truth.wheel_speed_rad_s[:, :n]
    return driving_slip_ratio(rim, truth.wheel_centre_speed_m_s[:, :n])


def track_command(time_s: np.ndarray, slip: np.ndarray, from_s: float, target: float) -> SlipTracking:
    """Tracking of one command; time_s (K,) and slip (K, driven) while it held."""
    error = slip - target
    to_s = float(time_s[-1])
    away = np.flatnonzero(~(np.abs(error) <= REACHED_SLIP).all(axis=1))
    first = int(away[-1]) + 1 if away.size else 0
    settle_s = float(time_s[first] - from_s) if first < time_s.size else math.nan
    late = error[time_s > 0.5 * (from_s + to_s)]
    return SlipTracking(from_s, to_s, target, settle_s, max((_rms(column) for column in late.T), default=math.nan))


def score(run: ClosedLoopRun) -> DriveScore | None:
    """The observer's estimates against the truth."""
    rows, robot = run.rows, free_sideways(run.scenario.model)
    if rows.estimate is None:
        return None
    truth = DriveTruth(
        rows.truth.speed_m_s,
        rows.truth.yaw_rate_rad_s,
        rows.truth.lateral_speed_m_s if robot.freedoms == 3 else None,
        rows.truth.slip_ratio[:, : robot.driven],
    )
    return score_drive(robot, rows.estimate, truth)


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan
