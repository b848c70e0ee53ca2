"""The campaign of 2021 on a floor never met: a file without a time column, whose rows are means over half a second.

Time follows from the encoders, which say both how far and how fast: dt = (ticks' n) / (n' n) per row, with the mean
speeds n of two rows. Part of `robotino.py`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from figure import data_file
from ohmward.logs.drive_log import DriveLog
from ohmward.traction import Robot

#: Encoder ticks per turn of the motor of a Robotino.
TICKS_PER_TURN = 2048
#: Drives with fewer rows are left out: the robot starts in the first one, and the forces settle in the next.
FEWEST_ROWS, FIRST_ROW = 6, 2
#: A step in time [s] beyond these is no row of a drive: the ticks began anew.
STEP_S = (0.3, 0.7)


class BlueDrive(NamedTuple):
    """A drive along a straight line, and the way [m] that the camera saw from `FIRST_ROW` to its end."""

    log: DriveLog
    way_m: float


def blue_drives(robot: Robot, pixel_m: tuple[float, float]) -> Iterator[BlueDrive]:
    """The straight drives of the file."""
    with data_file("robotino_slip_tpu/blue_2021.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    wanted = np.column_stack([columns[name] for name in ("set_vx_mm_s", "set_vy_mm_s", "set_wz_deg_s")])
    ticks, rpm, current = (
        np.column_stack([columns[name.format(k)] for k in (1, 2, 3)]) for name in ("enc{}_ticks", "m{}_rpm", "m{}_A")
    )
    step_s = steps(ticks, rpm)
    same = (wanted[1:] == wanted[:-1]).all(axis=1) & (step_s > STEP_S[0]) & (step_s < STEP_S[1])
    for drive in np.split(np.arange(len(rows)), np.flatnonzero(~same) + 1):
        if len(drive) < FEWEST_ROWS or wanted[drive[0], 2] != 0.0:
            continue
        time_s = np.concatenate([[0.0], np.cumsum(step_s[drive[:-1]])])
        omega = rpm[drive] * (2 * math.pi / 60) / robot.motor.gear_ratio
        log = DriveLog(f"blue {drive[0]}", time_s, omega, current[drive] * np.sign(rpm[drive]))
        ends = drive[[FIRST_ROW, -1]]
        way_m = [np.diff(columns[name][ends])[0] * m for name, m in zip(("x_pix", "y_pix"), pixel_m, strict=True)]
        yield BlueDrive(log, float(np.hypot(*way_m)))


def steps(ticks: np.ndarray, rpm: np.ndarray) -> np.ndarray:
    """Time (T - 1,) [s] between rows, from the ticks (T, 3) and the speeds (T, 3) of the motors."""
    turns, mean = np.diff(ticks, axis=0) / TICKS_PER_TURN, (rpm[1:] + rpm[:-1]) / 120
    return (turns * mean).sum(axis=1) / np.maximum((mean * mean).sum(axis=1), 1e-9)
