"""Consistency of wheels and gyro, which all measure one motion of the body: sensors that are stuck, and wrong signs.

omega_k = g_k xi,   xi = argmin |G xi - omega|   over the rows of G that are known,

G being the rolling matrix of the chassis over the radius, with a row for the gyro.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ohmward.quantities import QUANTITIES
from ohmward.signals.checks import Finding, Place, Scale, rescale, scales_of
from ohmward.traction.motion.sample import STOPPED
from ohmward.traction.motion.stuck_sensors import COUNTED_TURN_RAD_S
from ohmward.traction.odometry.measured_motion import may_scrub
from ohmward.traction.odometry.turn_watch import LEAST_TURN_SHARE, OTHER_UNIT_RATIO
from ohmward.traction.robot.chassis import PLANAR, Steered
from ohmward.traction.robot.robot import Robot

#: Fewest values for a check.
FEWEST_VALUES = 20

#: Signs are wrong, or lost, where others leave less than this share of the contradiction (in squares).
CURED = 0.1

#: A wheel that turns slower than this says nothing about its sign [rad/s].
TURNING_RAD_S = 0.5

#: Contradictions [rad/s] below this are the noise of encoders and gyro, and a little slip.
LEAST_RAD_S = 0.1

#: Largest factor between wheels and gyro by radius and track, and largest one by which scrubbing wheels turn faster
#: than the robot.
MOST_FASTER, SCRUBS = 1.5, 3.0

#: A wrong unit is a factor, which leaves the yaw rates of wheels and gyro correlated by at least this much.
CORRELATED = 0.8

#: A gyro measures another axis if it hides more than this share of the turns.
HIDDEN_SHARE = 0.9

_OF_WHEELS, _OF_GYRO = QUANTITIES["wheel_speed_rad_s"], QUANTITIES["yaw_rate_rad_s"]
_WHEEL, _YAW_RATE = ("wheel_speed_rad_s", "wheel_counts"), "yaw_rate_rad_s"


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


class SensedMotion(NamedTuple):
    """Values of wheels and gyro while the robot moves and all of them are known."""

    seen: list[int]  #: rows of G of the sensors that report
    rows: np.ndarray  #: (n, freedoms) of G
    values: np.ndarray  #: (n, T)


def check_signs(robot: Robot, motion: SensedMotion, place: Place) -> Iterator[tuple[int, Finding]]:
    """Finding on a sign by which wheels and gyro contradict each other, and its row of G."""
    seen, rows, values = motion
    if values.shape[1] < FEWEST_VALUES:
        return
    gyro = len(robot.places)
    wrong = [seen[k] for k in wrong_signs(rows, values, LEAST_RAD_S**2)]
    if encoders := sorted(k for k in wrong if k < gyro):
        which = " or ".join(robot.places[k].name.replace("_", " ") for k in encoders)
        text = (
            f"the wheels contradict each other, and agree once the encoder of {which} counts the other way: wrong "
            "sign, or wheels are exchanged"
        )
        fix = "scale = -1" if place == "setup" else "change the sign in the file, or say with --column which is which"
        yield next(k for k in wrong if k < gyro), Finding("error", text, fix)
    elif wrong or faster_than_gyro(robot, motion) < -1.0 / MOST_FASTER:
        yield gyro, against_gyro(robot, place)


def check_units(robot: Robot, motion: SensedMotion, place: Place) -> Iterator[Finding]:
    """A finding on wheels that turn the robot much faster or slower than the gyro says."""
    if place == "log" and hides_turns(robot, motion):
        text = "the gyro shows none of the turns that the wheels make: it measures another axis, or is dead"
        yield Finding("error", text, "look how it is mounted, and which axis or column is read")
    faster = faster_than_gyro(robot, motion)
    if not math.isfinite(faster) or _fits(robot, faster):
        return
    of_wheels, of_gyro = fitting_units(robot, faster)
    fixes = [f"the wheels in {rescale(_OF_WHEELS, scale, place)}" for scale in of_wheels]
    fixes += [f"the gyro in {rescale(_OF_GYRO, scale, place)}" for scale in of_gyro]
    fix = fixes[0] if fixes else "check their units, the radius and the track, or do the wheels slip?"
    yield Finding("error", f"the wheels turn the robot {faster:.3g} times as fast as the gyro", fix)


def fitting_units(robot: Robot, faster: float) -> tuple[list[Scale], list[Scale]]:
    """Other units of the wheels, and of the gyro, in which both turn the robot alike; see `faster_than_gyro`."""
    wheels = scales_of(_OF_WHEELS, robot.wheel.radius_m)
    return (
        [scale for scale in wheels if _fits(robot, scale.factor * faster)],
        [scale for scale in scales_of(_OF_GYRO) if _fits(robot, faster / scale.factor)],
    )


def _fits(robot: Robot, faster: float) -> bool:
    return 1.0 / MOST_FASTER < faster < (SCRUBS if robot.chassis.scrubs else 1.0) * MOST_FASTER


def against_gyro(robot: Robot, place: Place) -> Finding:
    """Wheels and gyro whose turns have opposite signs."""
    steered = isinstance(robot.chassis, Steered)
    other = "a steering angle that counts to the right" if steered else "left and right wheels are exchanged"
    text = f"wheels and gyro turn against each other: wrong sign of the gyro, whose axis points down, or {other}"
    if steered:
        return Finding("error", text, "scale = -1" if place == "setup" else "change the sign in the file")
    fixes = {
        "setup": "scale = -1, or exchange the names of the wheels",
        "log": "exchange the columns with --column, or change the sign of the yaw rate in the file",
    }
    return Finding("error", text, fixes[place])


def motion_of(robot: Robot, wheel_speed_rad_s: np.ndarray, yaw_rate_rad_s: np.ndarray | None) -> SensedMotion:
    """Values of the sensors that report at all, while the robot moves.

    wheel_speed_rad_s: (wheels, T), nan throughout for those that do not report.
    yaw_rate_rad_s: (T,) of a gyro, or None.
    """
    check = MotionCheck(robot)
    measured = [*wheel_speed_rad_s, *([] if yaw_rate_rad_s is None else [check.scale * yaw_rate_rad_s])]
    seen = [k for k, values in enumerate(measured) if np.isfinite(values).any()]
    values = np.array([measured[k] for k in seen]).reshape(len(seen), wheel_speed_rad_s.shape[1])
    moves = np.isfinite(values).all(axis=0) & (np.abs(values).max(axis=0, initial=0.0) > TURNING_RAD_S)
    return SensedMotion(seen, check.rows[seen], values[:, moves])


def faster_than_gyro(robot: Robot, motion: SensedMotion) -> float:
    """Yaw rate by the wheels over that of the gyro; nan where no factor makes them alike, or it hardly turned."""
    by_wheels, rate = turns(robot, motion)
    power, product = float(rate @ rate), float(by_wheels @ rate)
    enough = power > max(rate.size, FEWEST_VALUES) * LEAST_RAD_S**2
    alike = abs(product) > CORRELATED * math.sqrt(power * float(by_wheels @ by_wheels))
    return product / power if enough and alike else math.nan


def hides_turns(robot: Robot, motion: SensedMotion) -> bool:
    """True where the gyro shows nearly none of the turns by the wheels, on the mean of all where these may scrub."""
    by_wheels, rate = turns(robot, motion) / MotionCheck(robot).scale
    turning = np.abs(by_wheels) > OTHER_UNIT_RATIO * COUNTED_TURN_RAD_S
    if np.count_nonzero(turning) < FEWEST_VALUES:
        return False
    if may_scrub(robot):
        return bool(abs(np.mean(rate[turning] / by_wheels[turning])) < LEAST_TURN_SHARE)
    return bool(np.mean(np.abs(rate[turning]) < COUNTED_TURN_RAD_S) > HIDDEN_SHARE)


def turns(robot: Robot, motion: SensedMotion) -> np.ndarray:
    """Yaw rates (2, T) by wheels and gyro, times `MotionCheck.scale`; (2, 0) where one of them shows none."""
    (seen, rows, values), gyro = motion, len(robot.places)
    wheels = [n for n, k in enumerate(seen) if k < gyro]
    if gyro not in seen or np.linalg.matrix_rank(rows) > np.linalg.matrix_rank(rows[wheels]):
        return np.empty((2, 0))
    by_wheels = rows[seen.index(gyro)] @ np.linalg.lstsq(rows[wheels], values[wheels], rcond=None)[0]
    return np.array([by_wheels, values[seen.index(gyro)]])


class MotionCheck:
    """Check of each wheel by the others.

    Args:
        robot: robot with the wheels.

    Attributes:
        rows: G (wheels + 1, freedoms), the gyro's last.
        scale: factor that brings a yaw rate to the size of wheel speeds, so that one tolerance serves all.
    """

    def __init__(self, robot: Robot):
        self.driven = robot.driven
        self._signals = {f"{wheel}.{place.name}": k for wheel in _WHEEL for k, place in enumerate(robot.places)}
        self._signals |= {f"{wheel}.{k}": k for wheel in _WHEEL for k in range(len(robot.places))}
        self._gyro = self._signals[_YAW_RATE] = len(robot.places)
        turn = [1.0 if name == PLANAR[2] else 0.0 for name in robot.chassis.freedoms]
        rolling = robot.rolling / robot.wheel.radius_m
        self.scale = float(np.abs(rolling[:, -1]).max()) or 1.0
        self.rows = np.vstack([rolling, self.scale * np.array(turn)])

    def stuck(self, sensors: Mapping[str, tuple[float, bool]]) -> Iterator[str]:
        """Signals of wheels that are stuck; for a gyro see `motion/stuck_sensors.py`.

        sensors: signal -> speed or yaw rate [rad/s], and True where it has been the same to the last bit for long.
        """
        rows, values = self._known(sensors)
        for signal, (value, same) in sensors.items():
            k = self._signals.get(signal)
            if same and k is not None and k != self._gyro and (value != 0.0 or k < self.driven):
                expected = self._expected(k, rows, values)
                if expected is not None and abs(expected - self._scaled(k, value)) > STOPPED.differs_rad_s:
                    yield signal

    def _known(self, sensors: Mapping[str, tuple[float, bool]]) -> tuple[list[int], list[float]]:
        """Rows of G of the sensors that move, and their values; of the others only those that stand still."""
        rows, values = [], []
        for signal, (value, same) in sensors.items():
            k = self._signals.get(signal)
            if k is not None and math.isfinite(value) and (not same or (value == 0.0 and k != self._gyro)):
                rows.append(k)
                values.append(self._scaled(k, value))
        return rows, values

    def _scaled(self, k: int, value: float) -> float:
        """Value of the sensor of row k, scaled to the size of wheel speeds."""
        return self.scale * value if k == self._gyro else value

    def _expected(self, k: int, rows: list[int], values: list[float]) -> float | None:
        """Speed [rad/s] of wheel k from all others; None if they do not determine it or contradict each other."""
        others = [n for n, row in enumerate(rows) if row != k]
        G, omega = self.rows[[rows[n] for n in others]], np.array([values[n] for n in others])
        if not len(others) or np.linalg.matrix_rank(np.vstack([G, self.rows[k]])) > np.linalg.matrix_rank(G):
            return None
        motion = np.linalg.lstsq(G, omega, rcond=None)[0]
        if np.abs(G @ motion - omega).max() > STOPPED.differs_rad_s:
            return None
        return float(self.rows[k] @ motion)
