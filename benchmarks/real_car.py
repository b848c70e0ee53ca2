"""A real car that does not slip (comma2k19): false alarms, and the speed against the reference of the data.

A car brakes with every wheel, so all of them count as driven. There are no motor currents. The first half of the minute
calibrates what its user would calibrate against GNSS (radius, latency of the receiver); the second half is scored. The
speed of the reference is itself unsure by 0.05 m/s or so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import Differential, Motor, Robot, RollingResistance, Wheel, hard_terrain
from ohmward.traction.score import DriveTruth, score_drive
from ohmward.traction.speed_observer.estimate import SlipAlarm, SlipEstimate
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.make_observer import make_observer
from real_data import alarm_share, columns, false_alarms, held, once

DATA = "comma2k19 car, no slip"
#: A compact car, by its data sheet; nothing of it was measured here, and without currents little of it counts.
CAR = Robot(
    "compact car",
    1450.0,
    2500.0,
    Differential(1.08, 1.62, 1.55, driven="all"),
    Wheel(0.32, 0.2, 1.0),
    Motor(1.0, 1.0),
)
#: Rolling resistance of car tyres; that of slow robots grows with speed as no car's does.
ROAD = hard_terrain("dry asphalt road", RollingResistance(0.012, 50.0, 0.0))
LATENCIES_S = np.arange(0.0, 0.41, 0.01)


class Case(NamedTuple):
    """Input of the observer."""

    method: str
    log: DriveLog


def rows() -> Iterator[Figure]:
    drive, truth = recording()
    half_s = drive.time_s[len(drive) // 2]
    for case in cases(drive, half_s):
        estimates = observed(case)
        yield from false_alarms(DATA, case.method, estimates, CAR.wheel.radius_m)
        strict = SlipAlarm(allowed_m_s=0.0, allowed_ratio=0.0)
        share = alarm_share(estimates, strict, CAR.wheel.radius_m)
        yield at_most(DATA, case.method, "the same at 0.001, no slip allowed, either sign", share, 2e-3, ".2g")
        yield from speed_figures(case, estimates, truth, drive.time_s >= half_s)


def speed_figures(case: Case, estimates: SlipEstimate, truth: DriveTruth, scored: np.ndarray) -> Iterator[Figure]:
    later = SlipEstimate(*(values[scored] for values in estimates))
    score = score_drive(CAR, later, DriveTruth(truth.speed_m_s[scored]))
    yield at_most(DATA, case.method, "speed RMSE, second half [m/s]", score.speed_rmse_m_s)
    yield at_least(DATA, case.method, "coverage of 95 % of the speed", score.speed_coverage_95, 0.9, ".3f")
    yield at_most(DATA, case.method, "its median sigma [m/s]", float(np.median(later.speed_std_m_s)))


def recording() -> tuple[DriveLog, DriveTruth]:
    """The drive at the times of its wheel speeds, and its speed by the reference of the data."""
    wheel, gyro, gnss, reference = (
        columns(f"comma2k19_example/{name}.parquet")
        for name in ("wheel_speed", "imu_gyro", "gnss_speed", "reference_speed")
    )
    time_s = wheel["t_s"]
    rim_m_s = np.column_stack([wheel[name] for name in ("v_fl", "v_fr", "v_rl", "v_rr")])
    speed, age_s = once(gnss["t_s"], gnss["gnss_speed_m_s"], time_s)
    log = DriveLog(
        "comma2k19",
        time_s,
        rim_m_s / CAR.wheel.radius_m,
        np.full(rim_m_s.shape, np.nan),
        yaw_rate_rad_s=-held(gyro["t_s"], gyro["gz"], time_s),
        speed_m_s=speed,
        speed_age_s=age_s,
    )
    true = np.interp(time_s, reference["t_s"], reference["speed_m_s"], right=np.nan)
    return log, DriveTruth(true)


def cases(drive: DriveLog, half_s: float) -> Iterator[Case]:
    """Without external speed and with, the second as it comes and with the receiver's latency."""
    share, latency_s = calibrated(drive.between(drive.time_s[0], half_s))
    scaled = replace(drive, wheel_speed_rad_s=share * drive.wheel_speed_rad_s, speed_m_s=None, speed_age_s=None)
    yield Case("wheels and gyro, radius calibrated", scaled)
    yield Case("and GNSS as it comes, radius a state", drive)
    late = replace(drive, speed_age_s=drive.speed_age_s + latency_s)
    yield Case(f"and GNSS {latency_s:.2f} s late, radius a state", late)


def calibrated(drive: DriveLog) -> tuple[float, float]:
    """Share of the radius and latency with which the wheels agree best with GNSS."""
    there = np.isfinite(drive.speed_m_s)
    seen_s, speed = (drive.time_s - drive.speed_age_s)[there], drive.speed_m_s[there]
    rim_m_s = CAR.wheel.radius_m * drive.wheel_speed_rad_s.mean(axis=1)
    fits = [np.interp(seen_s - latency, drive.time_s, rim_m_s) for latency in LATENCIES_S]
    shares = [float(speed @ fit / (fit @ fit)) for fit in fits]
    best = int(np.argmin([np.sum((speed - k * fit) ** 2) for k, fit in zip(shares, fits, strict=True)]))
    return shares[best], float(LATENCIES_S[best])


def observed(case: Case) -> SlipEstimate:
    return observe(make_observer(CAR, case.log, ROAD).observer, case.log).estimates
