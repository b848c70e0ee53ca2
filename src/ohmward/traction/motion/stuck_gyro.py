"""Gyro that is stuck: one that repeats a number to the last bit while the wheels change the turn of the robot.

A working gyro repeats no number for long unless the robot turns evenly. One that does while the yaw rate of the wheels,
averaged so that quantisation does not count, differs from that at the start for `STOPPED.contradicts_s` is stuck, and
missing until it changes. Repeating 0 may also be that of a gyro without noise on a robot whose wheels slip: that takes
`STOPPED.gyro_at_zero_s`. Encoders that repeat themselves too are no evidence. At the end of its range a gyro clips.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import every
from ohmward.logs.drive_log import DriveLog
from ohmward.trace import Kernel, exp, isfinite, logical_not, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sample import (
    LONGEST_STEP_S,
    STOPPED,
    CleanSample,
    RobotSample,
    no_sample,
    samples_of,
    sanitize,
)
from ohmward.traction.robot.robot import Robot

#: Time constant [s] of the wheels' average yaw rate, and time [s] in which it settles.
AVERAGED_S, SETTLED_S = 0.5, 2.5

#: Time [s] and number of values from which wheels that change their turn are not compared with a gyro that does not.
COMPARABLE_S, COMPARABLE = 0.25, 3

#: Least range [rad/s] of a gyro: 125 degrees per second. One that repeats a faster turn clips.
LEAST_RANGE_RAD_S = 2.18

#: Yaw rate [rad/s] that no sensor shows, before its first value.
NO_RATE = 1e9


class GyroWatch(NamedTuple):
    """State from sample to sample."""

    last_rad_s: Any = NO_RATE  #: last value of the gyro
    repeated: Any = 0.0  #: number of times that this value has been repeated
    varied: Any = 0.0  #: number of times since its last change that the turn by the wheels has changed
    apart_s: Any = 0.0  #: time since then in which the wheels have turned the robot by another rate
    turn_rad_s: Any = NO_RATE  #: last yaw rate by the wheels
    average_rad_s: Any = 0.0  #: average of the yaw rate by the wheels
    then_rad_s: Any = 0.0  #: yaw rate by the wheels at the gyro's last change
    wheel_age_s: Any = 0.0  #: time since their last value
    #: since the gyro's last change
    time_s: Any = 0.0
    wheels_rad: Any = 0.0  #: turn by the wheels
    rims_m: Any = 0.0  #: distance covered by their rims

    @property
    def comparable(self) -> Scalar:
        """The condition that wheels may be compared with the gyro."""
        return (self.repeated < COMPARABLE) | (self.varied < COMPARABLE) | (self.time_s < COMPARABLE_S)

    @property
    def suspected(self) -> Scalar:
        """The condition that the gyro may be stuck."""
        return (self.repeated >= STOPPED.values) & (self.apart_s > STOPPED.contradicts_s)

    @property
    def stuck(self) -> Scalar:
        """The condition that the gyro is stuck, or at the end of its range."""
        clips = logical_not(self.comparable) & (abs(self.last_rad_s) >= LEAST_RANGE_RAD_S)
        return clips | self.suspected & ((self.last_rad_s != 0.0) | (self.apart_s > STOPPED.gyro_at_zero_s))


def watch_gyro(before: GyroWatch, clean: CleanSample, robot: Robot) -> GyroWatch:
    """The watch after a sample."""
    n, since_s = robot.driven, before.wheel_age_s + clean.dt_s
    rolled = every(clean.wheel_measured[:n])
    *along_m_s, turn_rad_s = robot.motion_by_rims @ (robot.wheel.radius_m * clean.wheel_speed_rad_s[:n])
    first = before.turn_rad_s == NO_RATE
    follows = where(first, 1.0, 1.0 - exp(-since_s / AVERAGED_S))
    average = where(rolled, before.average_rad_s + follows * (turn_rad_s - before.average_rad_s), before.average_rad_s)
    measured = isfinite(clean.yaw_rate_rad_s)
    same = logical_not(measured & (clean.yaw_rate_rad_s != before.last_rad_s))
    settled = same & (before.time_s > SETTLED_S)
    then = where(settled, before.then_rad_s, average)
    apart = settled & (abs(average - where(before.last_rad_s == 0.0, 0.0, then)) > STOPPED.turns_rad_s)
    varies = rolled & (turn_rad_s != before.turn_rad_s)
    rolled_s = where(rolled, since_s, 0.0)
    return GyroWatch(
        last_rad_s=where(measured, clean.yaw_rate_rad_s, before.last_rad_s),
        repeated=where(same, before.repeated + where(measured, 1.0, 0.0), 0.0),
        varied=where(same, before.varied + where(varies, 1.0, 0.0), 0.0),
        apart_s=where(same, before.apart_s + where(varies & apart, since_s, 0.0), 0.0),
        turn_rad_s=where(rolled, turn_rad_s, before.turn_rad_s),
        average_rad_s=average,
        then_rad_s=then,
        wheel_age_s=where(rolled, 0.0, since_s),
        time_s=where(same, before.time_s + clean.dt_s, 0.0),
        wheels_rad=where(same, before.wheels_rad + turn_rad_s * rolled_s, 0.0),
        rims_m=where(same, before.rims_m + sum(abs(v) for v in along_m_s) * rolled_s, 0.0),
    )


def without_stuck_gyro(clean: CleanSample, watch: GyroWatch) -> CleanSample:
    """The sample without the yaw rate of a stuck gyro; watch: after it."""
    return clean._replace(yaw_rate_rad_s=where(watch.stuck, np.nan, clean.yaw_rate_rad_s))


def watch_log(robot: Robot, log: DriveLog) -> np.ndarray:
    """Conditions (2, T) that the gyro of a log is `suspected`, and that it is `stuck`."""

    def step(before: GyroWatch, sample: RobotSample) -> tuple[GyroWatch, np.ndarray]:
        after = watch_gyro(before, sanitize(sample, LONGEST_STEP_S), robot)
        return after, where(np.array([after.suspected, after.stuck]), 1.0, 0.0)

    _, conditions = Kernel(step, GyroWatch(), no_sample(robot)).scan(GyroWatch(), samples_of(log, robot))
    return np.asarray(conditions.T > 0.5)
