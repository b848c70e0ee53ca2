"""Outside speed that is stuck: one that repeats a number while the wheels change theirs, or stays near zero in turns.

A robot that is held while its wheels turn does not turn with them. If the gyro shows the turn of the wheels, a source
by which the robot stands has lost its satellites, or its ground. A stuck speed is missing until the source gives
another number, by which the robot moves or its wheels stand.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import every
from ohmward.logs.drive_log import DriveLog
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Kernel, isfinite, logical_not, maximum, minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.outside_speed import STUCK_SHARE, TURNS_M_S
from ohmward.traction.motion.sample import LONGEST_STEP_S, CleanSample, RobotSample, no_sample, samples_of, sanitize
from ohmward.traction.odometry.turn_watch import COUNTED_TURN_RAD_S, RIGHT_SHARE, is_share
from ohmward.traction.robot.robot import Robot

#: Least time [s] and number of values for which a speed is repeated, or the robot stands by it.
STUCK_AFTER_S, STUCK_VALUES = 3.0, 3

#: Time [s] for which a robot that stands by its outside speed turns as its wheels show, longer than it does not.
TURNED_S = 1.0


class SpeedWatch(NamedTuple):
    """State from sample to sample."""

    last_m_s: Any = 0.0  #: last outside speed
    repeated: Any = 0.0  #: number of times that it has been repeated
    time_s: Any = 0.0  #: since its last change
    low_m_s: Any = FASTEST_M_S  #: least forward speed of the rims since then
    high_m_s: Any = -FASTEST_M_S  #: greatest forward speed of the rims since then
    stood: Any = 0.0  #: number of values in a row by which the robot stands while its wheels turn
    turned_s: Any = 0.0  #: time since their first for which it has turned as the wheels show, less that for which not
    rim_m_s: Any = 0.0  #: last forward speed of the rims

    @property
    def doubted(self) -> Scalar:
        """The condition that the source may be stuck."""
        return (self.repeated > 0.0) | (self.stood > 0.0)

    @property
    def stuck(self) -> Scalar:
        """The condition that the source is stuck."""
        moves_m_s = abs(self.last_m_s)
        changed = (self.high_m_s - self.low_m_s > STUCK_SHARE * moves_m_s + TURNS_M_S) & (moves_m_s > TURNS_M_S)
        repeats = (self.repeated >= STUCK_VALUES) & (self.time_s >= STUCK_AFTER_S) & changed
        return repeats | (self.stood >= STUCK_VALUES) & (self.turned_s > TURNED_S)


def watch_speed(before: SpeedWatch, clean: CleanSample, since_s: Scalar, robot: Robot) -> SpeedWatch:
    """The watch after a sample, which comes so long after the last speeds of all wheels."""
    forward_m_s, *_, wheels_rad_s = robot.motion_by_rims @ (
        robot.wheel.radius_m * clean.wheel_speed_rad_s[: robot.driven]
    )
    rolled = every(clean.wheel_measured[: robot.driven])
    rim_m_s = where(rolled, forward_m_s, before.rim_m_s)
    measured, turns = isfinite(clean.speed_m_s), abs(rim_m_s) > TURNS_M_S
    y = where(measured, clean.speed_m_s, before.last_m_s)
    same = y == before.last_m_s
    shows_rest = abs(y) < STUCK_SHARE * maximum(abs(rim_m_s), TURNS_M_S)
    stands = measured & turns & shows_rest
    goes = measured & logical_not(same) & logical_not(turns & shows_rest)
    stood = where(goes, 0.0, before.stood + where(stands, 1.0, 0.0))
    alike = is_share(clean.yaw_rate_rad_s, wheels_rad_s, RIGHT_SHARE)
    compared = rolled & isfinite(clean.yaw_rate_rad_s) & (abs(wheels_rad_s) > COUNTED_TURN_RAD_S)
    turned_s = where(compared, where(alike, since_s, -since_s), 0.0)
    return SpeedWatch(
        last_m_s=y,
        repeated=where(same, before.repeated + where(measured, 1.0, 0.0), 0.0),
        time_s=where(same, before.time_s + clean.dt_s, 0.0),
        low_m_s=where(same, minimum(before.low_m_s, rim_m_s), rim_m_s),
        high_m_s=where(same, maximum(before.high_m_s, rim_m_s), rim_m_s),
        stood=stood,
        turned_s=where(stood > 0.0, maximum(before.turned_s + turned_s, 0.0), 0.0),
        rim_m_s=rim_m_s,
    )


def without_stuck_speed(clean: CleanSample, watch: SpeedWatch) -> CleanSample:
    """The sample without the speed of a stuck source; watch: after it."""
    left_out = watch.stuck & isfinite(clean.speed_m_s)
    return clean._replace(
        speed_m_s=where(left_out, np.nan, clean.speed_m_s), speed_refused=clean.speed_refused | left_out
    )


def watch_log(robot: Robot, log: DriveLog) -> np.ndarray:
    """Conditions (2, T) that the outside speed of a log is `doubted`, and that it is `stuck`."""

    def step(before: tuple[SpeedWatch, Any], sample: RobotSample) -> tuple[tuple[SpeedWatch, Any], np.ndarray]:
        clean = sanitize(sample, LONGEST_STEP_S)
        since_s = before[1] + clean.dt_s
        after = watch_speed(before[0], clean, since_s, robot)
        age_s = where(every(clean.wheel_measured[: robot.driven]), 0.0, since_s)
        return (after, age_s), where(np.array([after.doubted, after.stuck]), 1.0, 0.0)

    first = SpeedWatch(), 0.0
    _, conditions = Kernel(step, first, no_sample(robot)).scan(first, samples_of(log, robot))
    return np.asarray(conditions.T > 0.5)
