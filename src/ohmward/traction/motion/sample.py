"""One sample of the sensors of a robot, live or from a log, for speed observer, odometry and learnt floors."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ohmward.errors import InputError
from ohmward.logs.drive_log import DriveLog
from ohmward.traction.robot.robot import Robot

S = TypeVar("S", bound=tuple[Any, ...])


class RobotSample(NamedTuple):
    """One sample of the sensors; nan where there is nothing new.

    >>> ow.RobotSample(0.02, wheel_speed_rad_s=np.array([2.0, 2.1]), current_A=np.array([1.5, 1.4])).dt_s
    0.02
    """

    dt_s: Any  #: time since the sample before [s]; 0 for the first
    wheel_speed_rad_s: np.ndarray  #: (wheels,) from encoders, driven wheels first; nan for a wheel without one
    current_A: np.ndarray  #: (driven,) of the motors over the step that ends now, > 0 drives forward
    yaw_rate_rad_s: Any = math.nan  #: from a gyro, the mean over the step, > 0 to the left
    acceleration_m_s2: Any = math.nan  #: from an accelerometer along x, gravity included: at rest g sin(pitch)
    pitch_rad: Any = math.nan  #: from an attitude filter, > 0 with the nose up
    #: forward, from GNSS, visual or lidar odometry, optical flow; its standard deviation where the source gives one,
    #: and its age
    speed_m_s: Any = math.nan
    speed_std_m_s: Any = math.nan
    speed_age_s: Any = 0.0


def no_sample(robot: Robot) -> RobotSample:
    """A sample without any measurement, to be filled with `_replace`."""
    return RobotSample(0.0, np.full(len(robot.places), math.nan), np.full(robot.driven, math.nan))


def samples_of(log: DriveLog, robot: Robot, before_s: float = math.nan) -> RobotSample:
    """The log as samples (T, ...), its first step counted from `before_s` where that is a time before it.

    Raises:
        InputError: the log has other wheels or motors than the robot.
    """
    require_wheels(robot, log)
    start_s = log.time_s[0] if not before_s < log.time_s[0] else before_s
    nothing = np.full(len(log), math.nan)
    body = {name: nothing if (values := getattr(log, name)) is None else values for name in RobotSample._fields[3:]}
    return RobotSample(np.diff(log.time_s, prepend=start_s), log.wheel_speed_rad_s, log.motor_current_A, **body)


def require_wheels(robot: Robot, log: DriveLog) -> None:
    """Raise InputError where a log has other wheels or motors than a robot."""
    found = log.wheel_speed_rad_s.shape[1], log.motor_current_A.shape[1]
    if found != (len(robot.places), robot.driven):
        raise InputError(
            f"log {log.name!r} has {found[0]} wheels and {found[1]} motors, robot {robot.name!r} has "
            f"{len(robot.places)} and {robot.driven}; read the log for this robot"
        )


def first_of(samples: S) -> S:
    """The first of samples (T, ...), without a step before it."""
    first: Any = type(samples)(*(first_of(v) if isinstance(v, tuple) else v[0] for v in samples))
    return first._replace(dt_s=0.0) if isinstance(samples, RobotSample) else first
