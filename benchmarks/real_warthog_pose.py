"""Way and turn of the real skid-steered robot by odometry, beside its calibrated wheels, against poses of the lidar.

The poses of the lidar are late: the turn of the gyro agrees with theirs best some 0.3 s later, that of the wheels, held
for 0.25 s, somewhat less late. Chord and turn of each method are judged at the delay that suits them best in the
windows that calibrate the robot. The lidar's own noise, its scatter about a cubic in time, is part of the band that its
pose is judged by.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from figure import Figure, at_least, at_most, rms
from ohmward.filters.consistency import BAND_95
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import Odometry, Robot
from real_data import columns
from real_warthog import DATA, STEP_S, Windows, in_two_steps, recording

METHOD, WHEELS = "odometry, wheels and gyro", "calibrated wheels alone"
#: Delays [samples] that are tried; the way is judged over as many samples as remain after the longest.
DELAYS = np.arange(0.0, 8.5, 0.5)
LAST = 31


class Lidar(NamedTuple):
    """Poses (windows, samples): position in the plane and yaw."""

    x_m: np.ndarray
    y_m: np.ndarray
    yaw_rad: np.ndarray


class Moved(NamedTuple):
    """Chord and turn of each window, (windows,), with standard deviations of the turn where they are known."""

    chord_m: np.ndarray
    turn_rad: np.ndarray
    turn_std_rad: np.ndarray


def rows() -> Iterator[Figure]:
    windows, lidar = recording(), poses()
    robot = in_two_steps(windows)
    chosen = windows.held_out
    ways = {METHOD: by_odometry(windows, robot), WHEELS: by_wheels(windows, robot)}
    seen = [later(lidar, late) for late in DELAYS]
    chord, turn = (
        {name: rms(error_at_best(way, seen, part, ~chosen)[0][chosen]) for name, way in ways.items()}
        for part in ("chord_m", "turn_rad")
    )
    count = f"{DATA}, way of {LAST * STEP_S:.2f} s ({chosen.sum()} windows)"
    yield at_most(count, WHEELS, "chord, RMSE [m]", chord[WHEELS])
    yield at_most(count, WHEELS, "turn, RMSE [rad]", turn[WHEELS])
    yield at_most(count, METHOD, "chord, RMSE [m]", chord[METHOD], chord[WHEELS])
    yield at_most(count, METHOD, "turn, RMSE [rad]", turn[METHOD], turn[WHEELS])
    error, truth = error_at_best(ways[METHOD], seen, "turn_rad", ~chosen)
    inside = np.abs(error) <= BAND_95 * np.hypot(ways[METHOD].turn_std_rad, truth.turn_std_rad)
    yield at_least(count, METHOD, "coverage of 95 % of the turn", float(np.mean(inside[chosen])), 0.9)


def poses() -> Lidar:
    data = columns("norlab_skidsteer/drive_warthog_windows.parquet")
    shape = (len(columns("norlab_skidsteer/drive_warthog_window_truth.csv")["icp_vx"]), -1)
    x_m, y_m, yaw_rad = (data[name].reshape(shape).astype(float) for name in ("icp_x", "icp_y", "icp_yaw"))
    return Lidar(x_m, y_m, np.unwrap(yaw_rad, axis=1))


def error_at_best(way: Moved, seen: list[Moved], part: str, fitted: np.ndarray) -> tuple[np.ndarray, Moved]:
    """Errors (windows,) of a part of the way at the delay that suits the fitted windows best, and the truth then."""
    errors = [getattr(way, part) - getattr(truth, part) for truth in seen]
    best = int(np.argmin([rms(error[fitted]) for error in errors]))
    return errors[best], seen[best]


def later(lidar: Lidar, late: float) -> Moved:
    """Way and turn of each window by a lidar that is so many samples late, and the noise of the turn."""
    k = np.arange(lidar.yaw_rad.shape[1])
    ends = [np.array([np.interp([late, late + LAST], k, row) for row in values]) for values in lidar]
    x_m, y_m, turn_rad = (np.diff(end, axis=1)[:, 0] for end in ends)
    cubic = np.polynomial.polynomial.polyvander(k / k[-1], 3)
    scatter = lidar.yaw_rad - lidar.yaw_rad @ (cubic @ np.linalg.pinv(cubic)).T
    noise = np.sqrt(np.sum(scatter**2, axis=1) / (len(k) - cubic.shape[1]))
    return Moved(np.hypot(x_m, y_m), turn_rad, np.sqrt(2.0) * noise)


def by_odometry(windows: Windows, robot: Robot) -> Moved:
    """Each window from its own start, with one odometry, whose compiled step is kept."""
    odometry, moved = Odometry(robot), []
    for left, right, gyro in zip(windows.left_rad_s, windows.right_rad_s, windows.gyro_rad_s, strict=True):
        wheels = np.column_stack([left, right, left, right])[: LAST + 1]
        nothing = np.full(wheels.shape, np.nan)
        log = DriveLog("window", STEP_S * np.arange(LAST + 1), wheels, nothing, yaw_rate_rad_s=gyro[: LAST + 1])
        odometry.state, odometry.time_s = None, np.nan
        e = odometry.run(log).estimates
        moved.append((np.hypot(e.x_m[-1], e.y_m[-1]), e.yaw_rad[-1], np.sqrt(e.pose_cov[-1, 2, 2])))
    return Moved(*np.array(moved).T)


def by_wheels(windows: Windows, robot: Robot) -> Moved:
    """The same by plain integration of the wheels of the calibrated robot."""
    radius_m, track_m = robot.wheel.radius_m, robot.chassis.turning_track_m
    left, right = (values[:, 1 : LAST + 1] * radius_m * STEP_S for values in (windows.left_rad_s, windows.right_rad_s))
    turned, way_m = (right - left) / track_m, (left + right) / 2.0
    yaw = np.cumsum(turned, axis=1)
    middle = yaw - turned / 2.0
    chord = np.hypot(np.sum(way_m * np.cos(middle), axis=1), np.sum(way_m * np.sin(middle), axis=1))
    return Moved(chord, yaw[:, -1], np.full(len(chord), np.nan))
