"""Speed observer against faults of sensors: glitches, slow wheels beside a fast gyro, gaps, missing currents.

Glitches are drawn into the drive of `ohmward demo`, whose observer drives the robot, and into the log of a run without.
The skid-steered robot is the measured Warthog, its windows in a row with gaps of 2 s, its wheels at 5 Hz. Its
speed changes within a window and its true one is the mean of that, so means over windows are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import real_warthog as warthog
from figure import Figure, at_least, at_most, rms
from ohmward.filters.consistency import BAND_95
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop.run import score
from ohmward_lab.simulate.robot_drive import robot_drive

#: Share of glitches: most RMSE over that of the clean drive, and least coverage.
SPIKES = {0.005: (1.5, 0.95), 0.01: (2.0, 0.93), 0.05: (4.0, 0.90)}
#: Every fourth sample of 20 Hz has the speeds of the wheels; seconds between two windows.
WHEELS_EVERY, GAP_S = 4, 2.0


def rows() -> Iterator[Figure]:
    """Every figure of this page."""
    yield from glitches()
    yield from slow_wheels()


def glitches() -> Iterator[Figure]:
    """One-sample spikes of 20 rad/s in the encoders of the drive home."""
    method = "UKF, all encoders, currents, gyro, speed at 10 Hz"
    clean, _ = driven(0.0)
    yield at_most("drive home, no glitches", method, "speed RMSE [mm/s]", 1e3 * clean)
    for share, (most, least) in SPIKES.items():
        rmse, covered = driven(share)
        data = f"drive home, glitches in {100 * share:g} % of the encoders' samples"
        yield at_most(data, method, "speed RMSE over that without glitches", rmse / clean, most, ".2f")
        yield at_least(data, method, "speed in its 95 % band", covered, least, ".1%")


def driven(share: float) -> tuple[float, float]:
    """RMSE [m/s] and coverage of the speed of the drive home with glitches in this share of the samples."""
    drive = robot_drive("lfp", 0.4)
    found = score(closed_loop.run(replace(drive, sensors=replace(drive.sensors, encoder_spike_share=share))))
    return found.speed_rmse_m_s, found.speed_coverage_95


def slow_wheels() -> Iterator[Figure]:
    """The measured skid-steered robot; odometry is the mean of its wheels, the last one held."""
    windows = warthog.recording()
    log, true = joined(windows), windows.speed_m_s
    data = f"{warthog.DATA}, wheels 5 Hz, gyro 20 Hz, gaps of {GAP_S:g} s"
    odometry = held(0.25 * log.wheel_speed_rad_s.sum(axis=1)) * warthog.WARTHOG.wheel.radius_m
    found, method = SlipEstimator(warthog.WARTHOG).run(log).estimates, "slip by wheels and gyro"
    by_wheels, by_slip, std = (
        values.reshape(true.size, -1).mean(axis=1) for values in (odometry, found.speed_m_s, found.speed_std_m_s)
    )
    covered = float(np.mean(np.abs(by_slip - true) <= BAND_95 * std))
    fastest = float(np.max(np.abs(found.speed_m_s)) / np.max(np.abs(odometry)))
    yield at_most(data, "wheel odometry", "speed of a window, RMSE [m/s]", rms(by_wheels - true), form=".3f")
    yield at_most(data, method, "speed of a window, RMSE [m/s]", rms(by_slip - true), rms(by_wheels - true), ".3f")
    yield at_least(data, method, "speed of a window in its 95 % band", covered, 0.9, ".1%")
    yield at_most(data, method, "greatest speed over that of the wheels", fastest, 1.25, ".2f")


def joined(windows: warthog.Windows) -> DriveLog:
    """All windows as one log."""
    count, samples = windows.left_rad_s.shape
    starts_s = np.arange(count) * (samples * warthog.STEP_S + GAP_S)
    time_s = (starts_s[:, None] + warthog.STEP_S * np.arange(samples)).ravel()
    reports = np.tile(np.arange(samples) % WHEELS_EVERY == 0, count)
    sides = np.column_stack([windows.left_rad_s.ravel(), windows.right_rad_s.ravel()] * 2)
    wheels = np.where(reports[:, None], sides, np.nan)
    return DriveLog("joined", time_s, wheels, np.full(wheels.shape, np.nan), windows.gyro_rad_s.ravel())


def held(values: np.ndarray) -> np.ndarray:
    """The values (T,) with the last number in place of nan."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[last]
