"""Score of an observer against the truth: the one place that turns its errors into figures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.consistency import BAND_95
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipAlarm, SlipEstimate

#: Below this speed [m/s] of rim and travel a slip ratio is not compared: it would be noise over noise.
SLIP_FLOOR_M_S = 0.05

#: Multiple of the allowed slip beyond which a wheel clearly slips too much.
CLEARLY = 2.0


class DriveTruth(NamedTuple):
    """True motion, each (T,) or (T, driven), nan where it is not known; None where it was not measured."""

    speed_m_s: np.ndarray  #: of the body, forward
    #: > 0 to the left; without it the observer's own gives the speed of each wheel's centre
    yaw_rate_rad_s: np.ndarray | None = None
    lateral_speed_m_s: np.ndarray | None = None  #: to the left; without it a robot that moves sideways has no true slip
    #: (T, driven) of the wheels; without it their slip follows from the motion of the body
    slip_ratio: np.ndarray | None = None


class DriveScore(NamedTuple):
    """Figures of one drive; nan where nothing could be compared."""

    #: estimate minus truth
    speed_rmse_m_s: float
    speed_max_error_m_s: float
    speed_coverage_95: float  #: share of the samples whose true speed is within the estimate's own 95 % band
    slip_rmse: float  #: of the slip ratio, all wheels together, where rim or travel are faster than `SLIP_FLOOR_M_S`
    coverage_95: float  #: share of the samples and wheels whose true slip speed is within the estimate's own 95 % band
    false_alarm_rate: float  #: share of the samples and wheels with no more than the allowed slip that raise the alarm
    detection_rate: float  #: share of those with more than `CLEARLY` times the allowed slip that raise it
    samples: int  #: number of samples with a true speed


def score_figures(score: DriveScore | None) -> dict[str, float | None]:
    """Errors of a drive by name; all None without a truth."""
    names = [name for name in DriveScore._fields if name != "samples"]
    return {name: None if score is None else getattr(score, name) for name in names}


class TrueSlip(NamedTuple):
    """True slip (T, driven) of the driven wheels: speed [m/s], ratio (nan below the floor), and speed of the rim."""

    speed_m_s: np.ndarray
    ratio: np.ndarray
    rim_m_s: np.ndarray


def score_drive(robot: Robot, estimates: SlipEstimate, truth: DriveTruth) -> DriveScore:
    """Score of estimates (T, ...) of this robot.

    Raises:
        InputError: shapes differ.
    """
    _check(estimates, truth)
    slip, alarm = true_slip(robot, estimates, truth), SlipAlarm()
    speed_error = estimates.speed_m_s - truth.speed_m_s
    slip_error = estimates.slip_speed_m_s - slip.speed_m_s
    allowed = alarm.allowed_m_s + alarm.allowed_ratio * np.abs(slip.rim_m_s)
    alarmed, size = estimates.slipping > 0.5, np.abs(slip.speed_m_s)
    return DriveScore(
        speed_rmse_m_s=_rms(speed_error),
        speed_max_error_m_s=_largest(speed_error),
        speed_coverage_95=_covered(speed_error, estimates.speed_std_m_s),
        slip_rmse=_rms(estimates.slip_ratio - slip.ratio),
        coverage_95=_covered(slip_error, estimates.slip_speed_std_m_s),
        false_alarm_rate=_share(alarmed, size <= allowed),
        detection_rate=_share(alarmed, size > CLEARLY * allowed),
        samples=int(np.isfinite(speed_error).sum()),
    )


def true_slip(robot: Robot, estimates: SlipEstimate, truth: DriveTruth) -> TrueSlip:
    """True slip from the true motion of the body and the wheels' speeds and radius, which the observer estimates well.

    Where the slip ratio lambda itself is known, the slip speed is lambda max(|r omega|, |v|).
    """
    n = robot.driven
    rim = robot.wheel.radius_m * estimates.radius_ratio[:, None] * estimates.wheel_speed_rad_s
    travel = true_motion(robot, estimates, truth) @ robot.rolling[:n].T
    if truth.slip_ratio is None:
        speed = rim - travel
        ratio: np.ndarray = slip_ratio(rim, travel, SLIP_FLOOR_M_S)
        return TrueSlip(speed, ratio, rim)
    faster = np.fmax(np.abs(rim), np.abs(travel))
    return TrueSlip(truth.slip_ratio * faster, np.where(faster < SLIP_FLOOR_M_S, np.nan, truth.slip_ratio), rim)


def true_motion(robot: Robot, estimates: SlipEstimate, truth: DriveTruth) -> np.ndarray:
    """True motion (T, freedoms) of the body."""
    yaw_rate = estimates.yaw_rate_rad_s if truth.yaw_rate_rad_s is None else truth.yaw_rate_rad_s
    left = np.full(len(yaw_rate), np.nan) if truth.lateral_speed_m_s is None else truth.lateral_speed_m_s
    columns = {"v_m_s": truth.speed_m_s, "v_left_m_s": left, "yaw_rate_rad_s": yaw_rate}
    return np.column_stack([columns[name] for name in robot.chassis.freedoms])


def _check(estimates: SlipEstimate, truth: DriveTruth) -> None:
    samples, wheels = np.shape(estimates.slip_speed_m_s)
    for name, values in truth._asdict().items():
        wanted = (samples, wheels) if name == "slip_ratio" else (samples,)
        if values is not None and np.shape(values) != wanted:
            raise InputError(f"truth.{name} must have the shape {wanted} of the estimates, got {np.shape(values)}")


def _known(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _rms(errors: np.ndarray) -> float:
    known = _known(errors)
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _largest(errors: np.ndarray) -> float:
    known = _known(errors)
    return float(np.abs(known).max()) if known.size else float("nan")


def _covered(errors: np.ndarray, std: np.ndarray) -> float:
    known = np.isfinite(errors)
    return _share(np.abs(errors) <= BAND_95 * std, known)


def _share(hits: np.ndarray, among: np.ndarray) -> float:
    return float(np.mean(hits[among])) if among.any() else float("nan")
