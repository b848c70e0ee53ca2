"""Sample and estimate of the odometry: plain numbers, one sample at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.flags import SampleFlag
from ohmward.traction.motion.sample import RobotSample


class Observed(NamedTuple):
    """Motion from a speed observer, which knows the slip of the wheels; nan where there is nothing new."""

    speed_m_s: Any = math.nan
    speed_std_m_s: Any = math.nan
    left_m_s: Any = math.nan  #: speed to the left
    yaw_rate_rad_s: Any = math.nan  #: yaw rate, used where there is no gyro
    yaw_rate_std_rad_s: Any = math.nan  #: standard deviation of that yaw rate
    #: share of the standard deviation of the radius that the observer's estimate leaves; 1 where it has none
    scale: Any = 1.0
    grip: Any = 1.0  #: lowest grip of the driven wheels, 0 to 1; spinning wheels do not measure a turn


class OdometrySample(NamedTuple):
    """One sample of the robot's sensors, of other sources of its motion, and of a speed observer."""

    robot: RobotSample
    speed_left_m_s: Any = math.nan  #: outside speed to the left, with the age of the forward one
    speed_left_std_m_s: Any = math.nan  #: standard deviation of that speed
    #: from a compass or two GNSS antennas, > 0 to the left; the zero is arbitrary and estimated, and full turns may be
    #: counted or not
    heading_rad: Any = math.nan
    heading_std_rad: Any = math.nan  #: standard deviation of the heading, if the source gives one
    #: (3,) change of the pose [m, m, rad] from visual or lidar odometry: forward and left in the frame of its start,
    #: and the turn
    increment: np.ndarray = np.full(3, math.nan)
    increment_std: np.ndarray = np.full(3, math.nan)  #: (3,) standard deviations if the source gives them
    increment_s: Any = math.nan  #: time between its start and its end
    increment_age_s: Any = 0.0  #: time since its end
    observed: Observed = Observed()

    @property
    def dt_s(self) -> Any:
        """Time since the previous sample [s]."""
        return self.robot.dt_s


class OdometryEstimate(NamedTuple):
    """Estimate after a sample."""

    #: in the frame `odom`, forward from where the robot was at first: of the middle of the driven axle of a two-wheeled
    #: robot, which wheels do not move sideways, and of the centre of gravity of any other
    x_m: Any
    y_m: Any  #: the same to the left
    yaw_rad: Any  #: > 0 to the left; full turns are counted
    pose_cov: np.ndarray  #: (3, 3) covariance of x, y and yaw in that frame [m2, m rad, rad2]
    position_std_m: Any  #: largest standard deviation of the position in any direction
    speed_m_s: Any  #: forward, in the frame of the robot
    speed_left_m_s: Any  #: to the left, in the frame of the robot
    yaw_rate_rad_s: Any  #: yaw rate, > 0 to the left
    twist_cov: np.ndarray  #: (3, 3) covariance of the twist
    distance_m: Any  #: length of the path
    gyro_offset_rad_s: Any  #: reading of the gyro at rest
    gyro_offset_std_rad_s: Any  #: standard deviation of that reading
    radius_ratio: Any  #: effective radius of the wheels over the robot's
    radius_std: Any  #: relative standard deviation of that ratio
    slip_speed_m_s: np.ndarray  #: (driven,) slip speed r omega - v of each wheel's centre [m/s]
    slip_speed_std_m_s: np.ndarray  #: (driven,) standard deviation of the slip speed [m/s]
    #: (driven,) probability that each wheel slips: while others roll (0 without a gyro, or if wheels roll sideways), or
    #: all of them, by an outside speed
    slip_probability: np.ndarray
    stuck_probability: Any  #: that the robot is held while its driven wheels turn, by an outside speed
    flags: Any  #: sum of `OdometryFlag` values; 0 is a sample without incident


class OdometryFlag(SampleFlag):
    """Incidents of a sample of the odometry."""

    BAD_TIME = 1  #: dt_s is negative, too long or not a number; taken as 0
    GAP = 2  #: a long step; the motion at its end is used for all of it
    NO_WHEELS = 4  #: no speed of the wheels any more: the last one is held, or an outside one, and the band grows
    NO_GYRO = 8  #: the gyro has stopped or clips, is mirrored or of another unit or axis: the wheels turn it
    WHEEL_JUMP = 16  #: a wheel changed its speed faster than any robot can; not used
    TURN_REJECTED = 32  #: gyro and wheels disagree beyond their sigmas: a wheel that slips, or a gyro that failed
    SPEED_REJECTED = 64  #: an external speed outside its gate; not used, the band was widened
    INCREMENT_REJECTED = 128  #: a pose increment outside its gate; not used, the band was widened
    INCREMENT_TOO_OLD = 256  #: a pose increment that began before the stored samples; not used
    NOT_POSITIVE_DEFINITE = 512  #: a variance was negative
    RESTARTED = 1024  #: the state was no longer a number; a new one was started from this sample
    HEADING_REJECTED = 2048  #: a heading outside its gate, as near iron; not used
    WHEEL_SLIPS = 4096  #: a wheel, or one side's wheels, probably slip: the others give the speed
    STUCK = 8192  #: the wheels turn but the robot stands, by an outside speed
    #: a driven wheel is not measured, or its encoder has stopped or counts the other way: with a gyro the others give
    #: its speed
    NO_ENCODER = 16384
