"""Wheels whose sensors are stuck, by the motion of the body that the other wheels and the gyro tell of.

omega_k = g_k xi,   xi = argmin |G xi - omega|   over the rows of G that are known,

G being the rolling matrix of the chassis over the radius, with a row for the gyro.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ohmward.traction.robot.chassis import PLANAR
from ohmward.traction.robot.robot import Robot

#: Other wheels agree on a motion within this, and the wheel that is stuck differs from it by more.
DIFFERENCE_RAD_S = 1.0

_SPEED, _YAW_RATE = "wheel_speed_rad_s", "yaw_rate_rad_s"


class WheelCheck:
    """Check of each wheel by the others.

    Args:
        robot: that the wheels are on.

    Attributes:
        scale: a yaw rate times it is of the size of wheel speeds, so that one tolerance serves all.
    """

    def __init__(self, robot: Robot):
        self.driven = robot.driven
        self._radius_m = robot.wheel.radius_m
        self._signals = {f"{_SPEED}.{place.name}": k for k, place in enumerate(robot.places)}
        self._signals |= {f"{_SPEED}.{k}": k for k in range(len(robot.places))}
        turn = [1.0 if name == PLANAR[2] else 0.0 for name in robot.chassis.freedoms]
        self.scale = float(np.abs(robot.rolling[:, -1]).max()) / self._radius_m or 1.0
        self._rows = np.vstack([robot.rolling / self._radius_m, self.scale * np.array(turn)])

    def row(self, wheel: int | None) -> np.ndarray:
        """Row of G of a wheel; of the gyro for None."""
        return self._rows[-1 if wheel is None else wheel]

    def stuck(self, sensors: Mapping[str, tuple[float, bool]]) -> Iterator[str]:
        """Signals of wheels that are stuck.

        sensors: signal -> value, and True where it has been the same to the last bit for long.
        """
        rows, values = self._known(sensors)
        for signal, (value, same) in sensors.items():
            k = self._signals.get(signal)
            if same and k is not None and (value != 0.0 or k < self.driven):
                expected = self._expected(k, rows, values)
                if expected is not None and abs(expected - value) > DIFFERENCE_RAD_S:
                    yield signal

    def _known(self, sensors: Mapping[str, tuple[float, bool]]) -> tuple[list[int], list[float]]:
        """Rows of G of the sensors that move, and their values; of the others only those that stand still."""
        rows, values = [], []
        for signal, (value, same) in sensors.items():
            if signal in self._signals and (not same or value == 0.0):
                rows.append(self._signals[signal])
                values.append(value)
            elif signal == _YAW_RATE and not same:
                rows.append(len(self._rows) - 1)
                values.append(self.scale * value)
        return rows, values

    def _expected(self, k: int, rows: list[int], values: list[float]) -> float | None:
        """Speed [rad/s] of wheel k from all others; None where they do not tell it or contradict each other."""
        others = [n for n, row in enumerate(rows) if row != k]
        G, omega = self._rows[[rows[n] for n in others]], np.array([values[n] for n in others])
        if not len(others) or np.linalg.matrix_rank(np.vstack([G, self._rows[k]])) > np.linalg.matrix_rank(G):
            return None
        motion = np.linalg.lstsq(G, omega, rcond=None)[0]
        if np.abs(G @ motion - omega).max() > DIFFERENCE_RAD_S:
            return None
        return float(self._rows[k] @ motion)
