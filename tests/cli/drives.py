"""A drive of the robot RLMA as a file: onto ice and off again, exact but for the noise of its encoders."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from ohmward.logs import write_table
from ohmward.traction import RLMA, hard_terrain, scene, slip_ratio
from traction.examples import plant

DT_S = 0.01
WHEELS = ("front_left", "front_right")
#: Ground, seconds on it, and the current of both motors [A].
LEGS = (("dry asphalt", 0.6, 0.0), ("dry asphalt", 1.4, 2.5), ("ice", 0.5, 4.0), ("dry asphalt", 1.5, 0.5))


@cache
def drive() -> dict[str, np.ndarray]:
    """The columns of the file, (T,) each, with the truth."""
    x, states, currents = np.zeros(4), [], []
    for ground, duration_s, current_A in LEGS:
        current = np.full((round(duration_s / DT_S), 2), current_A)
        x, leg = plant(scene(RLMA, hard_terrain(ground)), DT_S).scan(x, current)
        states.append(leg)
        currents.append(current)
    speed, yaw_rate, *omega = np.concatenate(states).T
    rng = np.random.default_rng(5)
    columns = {"time_s": DT_S * np.arange(1, speed.size + 1)}
    for wheel, turning, current in zip(WHEELS, omega, np.concatenate(currents).T, strict=True):
        columns[f"{wheel}_wheel_speed_rad_s"] = turning + 0.05 * rng.standard_normal(speed.size) * (turning != 0)
        columns[f"{wheel}_motor_current_A"] = current
        columns[f"{wheel}_slip_true"] = np.array([slip_ratio(RLMA.wheel.radius_m * turning, speed)]).ravel()
    truth = {"speed_true_m_s": speed, "yaw_rate_true_rad_s": yaw_rate}
    return columns | {"yaw_rate_rad_s": yaw_rate + 0.002 * rng.standard_normal(speed.size)} | truth


def write_drive(path: Path, **changes: np.ndarray | None) -> Path:
    """The drive as a file; a column that is None is left out."""
    columns = drive() | changes
    write_table({name: values for name, values in columns.items() if values is not None}, path)
    return path
