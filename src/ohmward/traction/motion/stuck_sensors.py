"""Gyro and outside speed that are stuck: they repeat a number to the last bit while the wheels change theirs.

Gyro. A working one repeats no number for long unless the robot turns evenly. One that does while the yaw rate of the
wheels, averaged so that quantisation does not count, differs from that at the start for `STOPPED.contradicts_s` is
stuck, and missing until it changes. Repeating 0 may also be that of a gyro without noise on a robot whose wheels slip:
that takes `STOPPED.gyro_at_zero_s`. Encoders that repeat themselves too are no evidence. At the end of its range a gyro
clips.

Outside speed. It also is stuck if it stays near zero in turns: a robot that is held while its wheels turn does not turn
with them. If the gyro shows the turn of the wheels, a source by which the robot stands has lost its satellites, or its
ground. A stuck speed is missing until the source gives another number, by which the robot moves or its wheels stand.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import between, every
from ohmward.logs.drive_log import DriveLog
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Kernel, Scalar, exp, isfinite, logical_not, maximum, minimum, where
from ohmward.traction.motion.outside_speed import STUCK_SHARE, TURNS_M_S
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

#: Least yaw rate [rad/s] that counts, and the gyro's over the wheels' that is right.
COUNTED_TURN_RAD_S, RIGHT_SHARE = 0.1, (0.3, 1.5)

#: Least time [s] and number of values for which a speed is repeated, or the robot stands by it.
STUCK_AFTER_S, STUCK_VALUES = 3.0, 3

#: Time [s] for which a robot that stands by its outside speed turns as its wheels show, longer than it does not.
TURNED_S = 1.0

#: A number that no sensor shows, before its first value.
NO_VALUE = 1e9


class RepeatedValue(NamedTuple):
    """Last value of a sensor, and how long it has lasted."""

    value: Any = NO_VALUE  #: in the unit of the sensor
    count: Any = 0.0  #: number of times that it has been repeated
    time_s: Any = 0.0  #: since the last change


class GyroWatch(NamedTuple):
    """State of the gyro's watch from sample to sample."""

    rate: RepeatedValue = RepeatedValue()  #: of the gyro [rad/s]
    varied: Any = 0.0  #: number of times since its last change that the turn by the wheels has changed
    apart_s: Any = 0.0  #: time since then in which the wheels have turned the robot by another rate
    turn_rad_s: Any = NO_VALUE  #: last yaw rate by the wheels
    average_rad_s: Any = 0.0  #: average of the yaw rate by the wheels
    then_rad_s: Any = 0.0  #: yaw rate by the wheels at the gyro's last change
    wheel_age_s: Any = 0.0  #: time since their last value
    #: since the gyro's last change
    wheels_rad: Any = 0.0  #: turn by the wheels
    rims_m: Any = 0.0  #: distance covered by their rims

    @property
    def comparable(self) -> Scalar:
        """The condition that wheels may be compared with the gyro."""
        return (self.rate.count < COMPARABLE) | (self.varied < COMPARABLE) | (self.rate.time_s < COMPARABLE_S)

    @property
    def suspected(self) -> Scalar:
        """The condition that the gyro may be stuck."""
        return (self.rate.count >= STOPPED.values) & (self.apart_s > STOPPED.contradicts_s)

    @property
    def stuck(self) -> Scalar:
        """The condition that the gyro is stuck, or at the end of its range."""
        clips = logical_not(self.comparable) & (abs(self.rate.value) >= LEAST_RANGE_RAD_S)
        return clips | self.suspected & ((self.rate.value != 0.0) | (self.apart_s > STOPPED.gyro_at_zero_s))


class SpeedWatch(NamedTuple):
    """State of the outside speed's watch from sample to sample."""

    speed: RepeatedValue = RepeatedValue()  #: of the outside speed [m/s]
    low_m_s: Any = FASTEST_M_S  #: least forward speed of the rims since its last change
    high_m_s: Any = -FASTEST_M_S  #: greatest forward speed of the rims since then
    stood: Any = 0.0  #: number of values in a row by which the robot stands while its wheels turn
    turned_s: Any = 0.0  #: time since their first for which it has turned as the wheels show, less that for which not
    rim_m_s: Any = 0.0  #: last forward speed of the rims

    @property
    def doubted(self) -> Scalar:
        """The condition that the source may be stuck."""
        return (self.speed.count > 0.0) | (self.stood > 0.0)

    @property
    def stuck(self) -> Scalar:
        """The condition that the source is stuck."""
        moves_m_s = abs(self.speed.value)
        changed = (self.high_m_s - self.low_m_s > STUCK_SHARE * moves_m_s + TURNS_M_S) & (moves_m_s > TURNS_M_S)
        repeats = (self.speed.count >= STUCK_VALUES) & (self.speed.time_s >= STUCK_AFTER_S) & changed
        return repeats | (self.stood >= STUCK_VALUES) & (self.turned_s > TURNED_S)


def repeated(before: RepeatedValue, value: Scalar, dt_s: Scalar) -> tuple[RepeatedValue, Scalar]:
    """The repeats after a step that ends with this value, nan for none, and the condition that it is no other one."""
    measured = isfinite(value)
    same = logical_not(measured & (value != before.value))
    count = where(same, before.count + where(measured, 1.0, 0.0), 0.0)
    return RepeatedValue(where(measured, value, before.value), count, where(same, before.time_s + dt_s, 0.0)), same


def rolled(clean: CleanSample, robot: Robot) -> tuple[Scalar, np.ndarray]:
    """The condition that all driven wheels are measured, and the motion (freedoms,) that they show."""
    speed_rad_s = clean.wheel_speed_rad_s[: robot.driven]
    return every(clean.wheel_measured[: robot.driven]), robot.motion_by_rims @ (robot.wheel.radius_m * speed_rad_s)


def is_share(rate: Any, of: Any, limits: tuple[float, float]) -> Any:
    """The condition that a yaw rate is that share of one that counts, and has its sign."""
    same = (rate * of > 0.0) & (abs(of) > COUNTED_TURN_RAD_S)
    return same & between(abs(rate), limits[0] * abs(of), limits[1] * abs(of))


def watch_gyro(before: GyroWatch, clean: CleanSample, robot: Robot) -> GyroWatch:
    """The watch after a sample."""
    since_s = before.wheel_age_s + clean.dt_s
    measured, (*along_m_s, turn_rad_s) = rolled(clean, robot)
    first = before.turn_rad_s == NO_VALUE
    follows = where(first, 1.0, 1.0 - exp(-since_s / AVERAGED_S))
    averaged = before.average_rad_s + follows * (turn_rad_s - before.average_rad_s)
    average = where(measured, averaged, before.average_rad_s)
    rate, same = repeated(before.rate, clean.yaw_rate_rad_s, clean.dt_s)
    settled = same & (before.rate.time_s > SETTLED_S)
    then = where(settled, before.then_rad_s, average)
    apart = settled & (abs(average - where(before.rate.value == 0.0, 0.0, then)) > STOPPED.turns_rad_s)
    varies = measured & (turn_rad_s != before.turn_rad_s)
    rolled_s = where(measured, since_s, 0.0)
    return GyroWatch(
        rate=rate,
        varied=where(same, before.varied + where(varies, 1.0, 0.0), 0.0),
        apart_s=where(same, before.apart_s + where(varies & apart, since_s, 0.0), 0.0),
        turn_rad_s=where(measured, turn_rad_s, before.turn_rad_s),
        average_rad_s=average,
        then_rad_s=then,
        wheel_age_s=where(measured, 0.0, since_s),
        wheels_rad=where(same, before.wheels_rad + turn_rad_s * rolled_s, 0.0),
        rims_m=where(same, before.rims_m + sum(abs(v) for v in along_m_s) * rolled_s, 0.0),
    )


def watch_speed(before: SpeedWatch, clean: CleanSample, since_s: Scalar, robot: Robot) -> SpeedWatch:
    """The watch after a sample, which comes so long after the last speeds of all driven wheels."""
    all_measured, (forward_m_s, *_, wheels_rad_s) = rolled(clean, robot)
    rim_m_s = where(all_measured, forward_m_s, before.rim_m_s)
    measured, turns = isfinite(clean.speed_m_s), abs(rim_m_s) > TURNS_M_S
    speed, same = repeated(before.speed, clean.speed_m_s, clean.dt_s)
    shows_rest = abs(speed.value) < STUCK_SHARE * maximum(abs(rim_m_s), TURNS_M_S)
    stands = measured & turns & shows_rest
    goes = measured & logical_not(same) & logical_not(turns & shows_rest)
    stood = where(goes, 0.0, before.stood + where(stands, 1.0, 0.0))
    alike = is_share(clean.yaw_rate_rad_s, wheels_rad_s, RIGHT_SHARE)
    compared = all_measured & isfinite(clean.yaw_rate_rad_s) & (abs(wheels_rad_s) > COUNTED_TURN_RAD_S)
    turned_s = where(compared, where(alike, since_s, -since_s), 0.0)
    return SpeedWatch(
        speed=speed,
        low_m_s=where(same, minimum(before.low_m_s, rim_m_s), rim_m_s),
        high_m_s=where(same, maximum(before.high_m_s, rim_m_s), rim_m_s),
        stood=stood,
        turned_s=where(stood > 0.0, maximum(before.turned_s + turned_s, 0.0), 0.0),
        rim_m_s=rim_m_s,
    )


def without_stuck_gyro(clean: CleanSample, before: GyroWatch, robot: Robot) -> tuple[CleanSample, GyroWatch]:
    """The sample without the yaw rate of a stuck gyro, and the watch after it."""
    watch = watch_gyro(before, clean, robot)
    return clean._replace(yaw_rate_rad_s=where(watch.stuck, np.nan, clean.yaw_rate_rad_s)), watch


def without_stuck_speed(
    clean: CleanSample, before: SpeedWatch, since_s: Scalar, robot: Robot
) -> tuple[CleanSample, SpeedWatch]:
    """The sample without the speed of a stuck source, and the watch after it; since_s: see `watch_speed`."""
    watch = watch_speed(before, clean, since_s, robot)
    left_out = watch.stuck & isfinite(clean.speed_m_s)
    speed_m_s = where(left_out, np.nan, clean.speed_m_s)
    return clean._replace(speed_m_s=speed_m_s, speed_refused=clean.speed_refused | left_out), watch


class StuckLog(NamedTuple):
    """Conditions (T,) of the sensors of a log, those of `GyroWatch` and `SpeedWatch`."""

    gyro_suspected: np.ndarray
    gyro_stuck: np.ndarray
    speed_doubted: np.ndarray
    speed_stuck: np.ndarray


def watch_log(robot: Robot, log: DriveLog) -> StuckLog:
    """Where sensors of a log are stuck."""

    def step(before: tuple[GyroWatch, SpeedWatch], sample: RobotSample) -> tuple[tuple[GyroWatch, SpeedWatch], Any]:
        clean = sanitize(sample, LONGEST_STEP_S)
        since_s = before[0].wheel_age_s + clean.dt_s
        clean, gyro = without_stuck_gyro(clean, before[0], robot)
        speed = watch_speed(before[1], clean, since_s, robot)
        return (gyro, speed), where(np.array([gyro.suspected, gyro.stuck, speed.doubted, speed.stuck]), 1.0, 0.0)

    first = GyroWatch(), SpeedWatch()
    _, conditions = Kernel(step, first, no_sample(robot)).scan(first, samples_of(log, robot))
    return StuckLog(*np.asarray(conditions.T > 0.5))
