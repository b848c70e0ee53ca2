"""A real skid-steered robot (Warthog, 280 kg, up to 4 m/s) in windows of 2 s: encoders and gyro against lidar.

The column called `imu_yaw` holds the yaw rate of the gyro: it agrees with the lidar's turn over the window, the wheels
say 1.6 times as much. There are no motor currents. True speeds are those of the data, one for each window and unsure by
several percent; the poses themselves are not used, as the frame of some windows is turned. Windows of even calibration
steps calibrate the radius, those of odd steps are scored. Windows that the data call unsteady begin with a command that
changes from full speed one way to full speed the other: there wheels may well slip, so their alarms are only shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from ohmward.filters.consistency import BAND_95
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import Motor, Robot, SkidSteer, Wheel
from ohmward.traction.calibration import CalibrationDrive, calibrate
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.estimator import SlipEstimator
from real_data import columns, false_alarms

DATA = "Warthog, skid-steer"
METHOD = "wheels and gyro, radius calibrated"
WARTHOG = Robot(
    "Warthog", 280.0, 60.0, SkidSteer(0.457, 0.457, 1.1652), Wheel(0.3, 0.25, 0.5), Motor(1.0, 1.0, gear_ratio=10.0)
)
STEP_S = 0.05
#: A straight window turns by less than this [rad/s] and drives at least so fast [m/s].
STRAIGHT_RAD_S, DRIVING_M_S = 0.1, 0.5


class Windows(NamedTuple):
    """All windows: (windows, samples) of wheels and gyro, (windows,) of the rest."""

    left_rad_s: np.ndarray
    right_rad_s: np.ndarray
    gyro_rad_s: np.ndarray
    speed_m_s: np.ndarray
    turn_rad_s: np.ndarray
    steady: np.ndarray
    held_out: np.ndarray


def rows() -> Iterator[Figure]:
    windows = recording()
    straight = is_straight(windows)
    share = calibrated(windows, straight & ~windows.held_out)
    drives = [drive(windows, k, share) for k in range(len(windows.turn_rad_s))]
    estimates = observed(drives)
    going = straight & windows.held_out
    rolling, starting = joined(estimates, going & windows.steady), joined(estimates, going & ~windows.steady)
    yield from false_alarms(f"{DATA}, straight and steady", METHOD, rolling, WARTHOG.wheel.radius_m)
    alarms = float(np.mean(starting.slipping))
    yield at_most(f"{DATA}, straight, command changed", METHOD, "alarms at 0.001, slip is possible", alarms, form=".2g")
    yield from speed_figures(f"{DATA}, straight", windows, estimates, going)
    yield from speed_figures(f"{DATA}, turning", windows, estimates, ~straight & windows.held_out)
    yield from turn_figures(windows, estimates, windows.held_out)


def recording() -> Windows:
    data = columns("norlab_skidsteer/drive_warthog_windows.parquet")
    truth = columns("norlab_skidsteer/drive_warthog_window_truth.csv")
    shape = (len(truth["icp_vx"]), -1)
    yaw = np.unwrap(data["icp_yaw"].reshape(shape), axis=1)
    turn = (yaw[:, -1] - yaw[:, 0]) / (STEP_S * (yaw.shape[1] - 1))
    steady, step = data["steady"].astype(bool).reshape(shape)[:, 0], data["calib_step"].reshape(shape)[:, 0]
    left, right, gyro = (
        data[name].reshape(shape).astype(float) for name in ("left_wheel_vel", "right_wheel_vel", "imu_yaw")
    )
    return Windows(left, right, gyro, truth["icp_vx"], turn, steady, step % 2 == 1)


def is_straight(windows: Windows) -> np.ndarray:
    """(windows,) by lidar and wheels."""
    rim_m_s = WARTHOG.wheel.radius_m * 0.5 * (windows.left_rad_s + windows.right_rad_s).mean(axis=1)
    return (np.abs(windows.turn_rad_s) < STRAIGHT_RAD_S) & (np.abs(rim_m_s) > DRIVING_M_S)


def calibrated(windows: Windows, chosen: np.ndarray) -> float:
    """Share of the radius: speed by lidar over speed of the wheels."""
    rim_m_s = WARTHOG.wheel.radius_m * 0.5 * (windows.left_rad_s + windows.right_rad_s)[chosen].mean(axis=1)
    return float(np.median(windows.speed_m_s[chosen] / rim_m_s))


def drive(windows: Windows, k: int, share: float) -> DriveLog:
    left, right = share * windows.left_rad_s[k], share * windows.right_rad_s[k]
    wheels = np.column_stack([left, right, left, right])
    time_s = STEP_S * np.arange(len(left))
    return DriveLog(f"window {k}", time_s, wheels, np.full(wheels.shape, np.nan), windows.gyro_rad_s[k])


def observed(drives: list[DriveLog]) -> list[SlipEstimate]:
    """Each window from its own start."""
    estimator = SlipEstimator(WARTHOG)
    return [from_start(estimator, d) for d in drives]


def from_start(estimator: SlipEstimator, log: DriveLog) -> SlipEstimate:
    """Estimates of a drive that has nothing to do with the one before; the compiled step is kept."""
    estimator.state, estimator.time_s = None, np.nan
    return estimator.run(log).estimates


def joined(estimates: list[SlipEstimate], chosen: np.ndarray) -> SlipEstimate:
    """Those of the chosen windows, one after the other."""
    picked = [estimates[k] for k in np.flatnonzero(chosen)]
    return SlipEstimate(*(np.concatenate(values) for values in zip(*picked, strict=True)))


def speed_figures(data: str, windows: Windows, estimates: list[SlipEstimate], chosen: np.ndarray) -> Iterator[Figure]:
    """Of the mean speed of a window; its error is one that stays, so its sigma is that of a sample."""
    speed = np.array([np.mean(e.speed_m_s) for e in estimates])
    std = np.array([np.mean(e.speed_std_m_s) for e in estimates])
    error = (speed - windows.speed_m_s)[chosen]
    covered = float(np.mean(np.abs(error) <= BAND_95 * std[chosen]))
    count = f"{data} ({chosen.sum()} windows)"
    yield at_most(count, METHOD, "speed of a window, RMSE [m/s]", rms(error))
    yield at_most(count, METHOD, "its median sigma [m/s]", float(np.median(std[chosen])))
    yield at_least(count, METHOD, "coverage of 95 % of the speed", covered, 0.9, ".3f")


def turn_figures(windows: Windows, estimates: list[SlipEstimate], chosen: np.ndarray) -> Iterator[Figure]:
    turned = np.array([np.mean(e.yaw_rate_rad_s) for e in estimates])
    robot = in_two_steps(windows)
    text = (
        f"wheels alone, radius {robot.wheel.radius_m:.3f} m and track {robot.chassis.turning_track_m:.2f} m calibrated"
    )
    methods = {METHOD: turned, "wheels alone": by_wheels(windows, WARTHOG), text: by_wheels(windows, robot)}
    for method, rate in methods.items():
        error = (rate - windows.turn_rad_s)[chosen]
        yield at_most(DATA, method, "yaw rate over a window, RMSE [rad/s]", rms(error))


def in_two_steps(windows: Windows) -> Robot:
    """The robot calibrated with the steady windows that are not held out: the radius first, the track then."""
    drives = []
    for k in np.flatnonzero(windows.steady & ~windows.held_out):
        log = drive(windows, k, 1.0)
        drives.append(CalibrationDrive(log, np.tile([windows.speed_m_s[k], 0.0, windows.turn_rad_s[k]], (len(log), 1))))
    return calibrate(drives, WARTHOG, parts=("radius", "track")).robot


def by_wheels(windows: Windows, robot: Robot) -> np.ndarray:
    """Mean yaw rate of each window by its wheels."""
    sides_m_s = robot.wheel.radius_m * (windows.right_rad_s - windows.left_rad_s).mean(axis=1)
    return sides_m_s / robot.chassis.turning_track_m
