"""Consistency of wheels and gyro, which all measure one motion of the body: sensors that are stuck, and wrong signs.

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

#: Signs are wrong, or lost, where others leave less than this share of the contradiction (in squares).
CURED = 0.1

_SPEED, _YAW_RATE = "wheel_speed_rad_s", "yaw_rate_rad_s"


def contradiction(rows: np.ndarray, values: np.ndarray) -> float:
    """Mean square [rad^2/s^2] that no motion of the body explains; rows: (n, freedoms) of G; values: (n, T)."""
    return float(np.mean((rows @ (np.linalg.pinv(rows) @ values) - values) ** 2))


def wrong_signs(rows: np.ndarray, values: np.ndarray, least: float) -> list[int]:
    """Sensors whose other sign explains the contradiction, the best one first.

    rows: (n, freedoms) of G.  values: (n, T).  least: contradiction up to which all signs are right.
    """
    as_is = contradiction(rows, values)
    if not as_is > least:
        return []
    turned = [contradiction(rows, values * signs[:, None]) for signs in 1.0 - 2.0 * np.eye(len(rows))]
    return [int(k) for k in np.argsort(turned, kind="stable") if turned[k] < CURED * as_is]


def wrong_sign(which: str, fix: str) -> str:
    """Sentence on an encoder or gyro whose sign is wrong."""
    return (
        f"the wheels contradict each other, and agree once {which} counts the other way: wrong sign, or wheels are "
        f"exchanged; {fix}"
    )


class MotionCheck:
    """Check of each wheel by the others.

    Args:
        robot: that the wheels are on.

    Attributes:
        rows: G (wheels + 1, freedoms), the gyro's last.
        scale: a yaw rate times it is of the size of wheel speeds, so that one tolerance serves all.
    """

    def __init__(self, robot: Robot):
        self.driven = robot.driven
        self._signals = {f"{_SPEED}.{place.name}": k for k, place in enumerate(robot.places)}
        self._signals |= {f"{_SPEED}.{k}": k for k in range(len(robot.places))}
        turn = [1.0 if name == PLANAR[2] else 0.0 for name in robot.chassis.freedoms]
        rolling = robot.rolling / robot.wheel.radius_m
        self.scale = float(np.abs(rolling[:, -1]).max()) or 1.0
        self.rows = np.vstack([rolling, self.scale * np.array(turn)])

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
                rows.append(len(self.rows) - 1)
                values.append(self.scale * value)
        return rows, values

    def _expected(self, k: int, rows: list[int], values: list[float]) -> float | None:
        """Speed [rad/s] of wheel k from all others; None where they do not tell it or contradict each other."""
        others = [n for n, row in enumerate(rows) if row != k]
        G, omega = self.rows[[rows[n] for n in others]], np.array([values[n] for n in others])
        if not len(others) or np.linalg.matrix_rank(np.vstack([G, self.rows[k]])) > np.linalg.matrix_rank(G):
            return None
        motion = np.linalg.lstsq(G, omega, rcond=None)[0]
        if np.abs(G @ motion - omega).max() > DIFFERENCE_RAD_S:
            return None
        return float(self.rows[k] @ motion)
