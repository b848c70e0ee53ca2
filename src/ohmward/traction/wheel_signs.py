"""Signs of wheel speeds whose logger wrote sizes only, from the gyro, a signed speed from outside, and motor currents.

A hidden Markov model of the four ways in which the left and the right side may roll, forward or back, solved by the
forward-backward algorithm (Rabiner 1989). A way is likely if the turn and the speed that it gives are those measured,
and if the currents drive forward where a wheel that rolls forward becomes faster. A side that rolls the other way has
changed its speed by the sum of both sizes, which is likely where it is slow, and as likely as that it goes on where it
stands. Errors last, so that evidence counts once in `MOTION_LASTS_S`. A way that nothing shows, as straight ahead or
straight back between two stops, stays unknown.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Note
from ohmward.traction.motion.outside_speed import TURNS_M_S
from ohmward.traction.motion_check import CURED, FEWEST_VALUES, LEAST_RAD_S, SCRUBS
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.make_observer import WHEEL_TURNS_RAD_S, speed_and_wheels_m_s, yaw_rate_of_wheels

#: Signs (4, 2) of the speeds of the left and of the right side.
WAYS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])

#: Speeds have lost their sign where the wheels contradict the gyro by this share of its motion (in squares).
CONTRADICTION = 0.1

#: A speed from outside and wheels of which only one is ever negative: in at least this many samples, with a median size
#: there of at least this share of the other's, the other has lost its sign.
FEWEST_BACK, SIZE_SHARE = 3, 0.5

#: Median difference of that speed and the wheels', times which it is below them where it is not negative by its noise.
NOISE_TIMES = 6.0

#: Standard deviations of a turn and of a speed by the wheels: beside `LEAST_RAD_S` and `TURNS_M_S` this share of them.
#: Largest squared sigmas that count.
MOTION_SHARE, MOST_SQUARE = 0.2, 25.0

#: Times [s] in which turns and speeds, and currents, count as one piece of evidence.
MOTION_LASTS_S, CURRENT_LASTS_S = 2.0, 0.5

#: Usual acceleration [m/s2], and change of the speed [m/s] by quantisation.
USUAL_M_S2, QUANTUM_M_S = 1.0, 0.02

#: Current [A] from which a motor works, and probability that it drives a wheel forward that becomes faster forward.
WORKS_A, DRIVES = 1.0, 0.9

#: Probability from which a way is known.
KNOWN = 0.99


class LostSigns(NamedTuple):
    """Wheel speeds without signs."""

    evidence: str  #: what shows that wheels rolled back
    samples: int  #: number of samples that do
    turns: float = 1.0  #: turn of the robot over that by its wheels


def sides_of(robot: Robot) -> np.ndarray | None:
    """(wheels,) 1 for a wheel on the left, -1 on the right, 0 for a caster; None where driven wheels have no side."""
    names = [place.name for place in robot.places]
    sides = np.array([("left" in name) - ("right" in name) for name in names])
    return sides if sides[: robot.driven].all() and not robot.chassis.rollers else None


def yaw_rates(robot: Robot, sides: np.ndarray, wheel_speed_rad_s: np.ndarray) -> np.ndarray:
    """Yaw rates (4, T) [rad/s] by wheels (T, wheels) of these sizes in each of the `WAYS`."""
    signs = [np.choose(sides + 1, [right, 1, left]) for left, right in WAYS]
    return np.stack([yaw_rate_of_wheels(robot, wheel_speed_rad_s * way) for way in signs])


def lost_signs(robot: Robot, log: DriveLog) -> LostSigns | None:
    """Evidence that wheels which are never negative rolled back for a while; None without."""
    sides, speed = sides_of(robot), log.wheel_speed_rad_s
    if sides is None or (np.nan_to_num(speed) < -WHEEL_TURNS_RAD_S).any():
        return None
    outside, wheels = speed_and_wheels_m_s(robot, log)
    apart_m_s, back = wheels - outside, outside < -TURNS_M_S
    noise_m_s = 0.0 if back.all() else float(np.median(np.abs(apart_m_s[~back])))
    back &= apart_m_s > NOISE_TIMES * noise_m_s
    if back.sum() >= FEWEST_BACK and np.median(wheels[back]) > SIZE_SHARE * np.median(-outside[back]):
        return LostSigns("the speed from outside is negative", int(back.sum()))
    if log.yaw_rate_rad_s is None:
        return None
    yaws = yaw_rates(robot, sides, speed)
    rows = np.isfinite(yaws).all(axis=0) & np.isfinite(log.yaw_rate_rad_s) & (np.nan_to_num(speed).max(axis=1) > 0.0)
    if rows.sum() < FEWEST_VALUES:
        return None
    gyro = log.yaw_rate_rad_s[rows]
    slower = np.linspace(1.0, 1.0 / SCRUBS, 9) if robot.chassis.scrubs else np.ones(1)
    tried = [(share * yaws[:, rows] - gyro) ** 2 for share in slower]
    best = int(np.argmin([one.min(axis=0).sum() for one in tried]))
    left = tried[best]
    if left[0].sum() < CONTRADICTION * (gyro @ gyro) or left.min(axis=0).sum() > CURED * left[0].sum():
        return None
    if ((slower[best] * yaws[0, rows] + gyro) ** 2).sum() < CURED * left[0].sum():
        return None  # The gyro is mirrored, or both sides are.
    against = np.count_nonzero(left[0] > LEAST_RAD_S**2)
    if against < FEWEST_VALUES:
        return None
    return LostSigns("the gyro turns as if wheels turned back", int(against), float(slower[best]))


def with_wheel_signs(robot: Robot, log: DriveLog) -> DriveLog:
    """The log with the signs of wheel speeds that have lost them, nan where these are unknown, and a note.

    Otherwise the log unchanged.
    """
    lost, sides = lost_signs(robot, log), sides_of(robot)
    if lost is None or sides is None:
        return log
    forward = forward_probability(robot, log, sides, lost.turns)
    sign = np.where(forward > KNOWN, 1.0, np.where(forward < 1.0 - KNOWN, -1.0, np.nan))
    of_wheel = np.column_stack([sign, np.full(len(log), np.nan)])[:, np.choose(sides + 1, [1, 2, 0])]
    speed = log.wheel_speed_rad_s
    text = (
        f"the wheel speeds are never negative, but {lost.evidence} in {lost.samples} samples: they have lost their "
        "sign; where gyro, speed from outside and motor currents do not show it, they are left out; let the logger "
        "write it"
    )
    signed = replace(log, wheel_speed_rad_s=np.where(speed == 0.0, 0.0, np.abs(speed) * of_wheel))
    return signed.with_notes(Note(text, "warning"))


def forward_probability(robot: Robot, log: DriveLog, sides: np.ndarray, turns: float) -> np.ndarray:
    """Probabilities (T, 2) that the left and the right side roll forward; turns: see `LostSigns`."""
    speed = np.abs(log.wheel_speed_rad_s)
    rim_m_s = robot.wheel.radius_m * of_sides(speed[:, : robot.driven], sides)
    steps_s = np.diff(log.time_s)
    logs = log_likelihood(log, rim_m_s, turns * yaw_rates(robot, sides, speed), of_sides(log.motor_current_A, sides))
    likely = np.exp(logs - logs.max(axis=1, keepdims=True))
    # (T - 1, sides, 2): each side keeps its way, or changes it.
    change_m_s = np.stack([rim_m_s[1:] - rim_m_s[:-1], rim_m_s[1:] + rim_m_s[:-1]], axis=-1)
    usual_m_s = (USUAL_M_S2 * steps_s + QUANTUM_M_S)[:, None, None]
    changes = np.exp(-0.5 * np.minimum((change_m_s / usual_m_s) ** 2, 2.0 * MOST_SQUARE))
    left, right = (np.not_equal.outer(way, way).astype(int) for way in WAYS.T)
    chain = changes[:, 0, left] * changes[:, 1, right]
    found = _smoothed(likely, chain)
    return np.column_stack([found[:, way > 0].sum(axis=1) for way in WAYS.T])


def log_likelihood(log: DriveLog, rim_m_s: np.ndarray, yaw_rad_s: np.ndarray, current_A: np.ndarray) -> np.ndarray:
    """Log-likelihood (T, 4) of each of the `WAYS` in each sample by itself, over the time since the value before.

    rim_m_s, current_A: (T, 2) sizes of the speeds, and currents, of the sides.  yaw_rad_s: (4, T) in each way.
    """
    logs = np.zeros((len(log), len(WAYS)))
    if log.yaw_rate_rad_s is not None:
        logs += _normal(log.time_s, log.yaw_rate_rad_s, yaw_rad_s.T, LEAST_RAD_S)
    if log.speed_m_s is not None and np.nan_to_num(log.speed_m_s).min() < -TURNS_M_S:
        logs += _normal(log.time_s, log.speed_m_s, rim_m_s @ WAYS.T / 2.0, TURNS_M_S)
    if current_A.min() < -WORKS_A:
        drives = (np.abs(current_A) > WORKS_A) & (np.diff(rim_m_s, axis=0, prepend=rim_m_s[:1]) > 0.0)
        agrees = (np.sign(current_A) * drives)[:, None, :] * WAYS
        by_current = np.where(agrees > 0.0, np.log(DRIVES), np.where(agrees < 0.0, np.log(1.0 - DRIVES), 0.0))
        counts = np.minimum(np.diff(log.time_s, prepend=log.time_s[0]) / CURRENT_LASTS_S, 1.0)
        logs += counts[:, None] * by_current.sum(axis=2)
    return logs


def _normal(time_s: np.ndarray, measured: np.ndarray, expected: np.ndarray, least: float) -> np.ndarray:
    """Log-densities (T, 4) of values (T,), expected (T, 4); 0 where a value is missing."""
    rows, weight = np.flatnonzero(np.isfinite(measured)), np.zeros(len(time_s))
    weight[rows] = np.minimum(np.diff(time_s[rows], prepend=time_s[rows[:1]]) / MOTION_LASTS_S, 1.0)
    variance = least**2 + (MOTION_SHARE * expected) ** 2
    logs = -0.5 * (np.minimum((measured[:, None] - expected) ** 2 / variance, MOST_SQUARE) + np.log(variance))
    return np.nan_to_num(weight[:, None] * logs)


def of_sides(values: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Means (T, 2) of the values (T, driven) of the left and of the right driven wheels."""
    return np.column_stack([_mean(values[:, sides[: values.shape[1]] == side]) for side in (1, -1)])


def _mean(values: np.ndarray) -> np.ndarray:
    """Mean (T,) of the known values (T, N); the last one before where none is, 0 at the start."""
    known = np.isfinite(values)
    counts = known.sum(axis=1)
    means = np.where(known, values, 0.0).sum(axis=1) / np.maximum(counts, 1)
    last = np.maximum.accumulate(np.where(counts > 0, np.arange(len(values)), -1))
    return np.where(last >= 0, means[last], 0.0)


def _smoothed(likely: np.ndarray, chain: np.ndarray) -> np.ndarray:
    """Probabilities (T, states) given all samples: likelihoods (T, states), transitions (T - 1, states, states)."""
    before, after = np.ones_like(likely), np.ones_like(likely)
    before[0] = likely[0]
    for k, moves in enumerate(chain):
        ahead = (before[k] @ moves) * likely[k + 1]
        before[k + 1] = ahead / ahead.sum()
    for k in range(len(chain) - 1, -1, -1):
        back = chain[k] @ (likely[k + 1] * after[k + 1])
        after[k] = back / back.sum()
    both = before * after
    return both / both.sum(axis=1, keepdims=True)
