"""Sample and estimate of the momentum observer: plain numbers, one sample at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.flags import SampleFlag


class MomentumFlag(SampleFlag):
    """Events at a sample. None of them stops the observer."""

    BAD_TIME = 1  # dt_s is not a number, negative or longer than `gap_s`: the speed may be anything
    NO_CURRENT = 2  # of at least one motor; the last torque was held
    GROUND_CHANGED = 4  # counts of a driven wheel moved as its torque excludes: the force on it is unknown
    STANDSTILL = 8  # wheels and motors at rest: speed is zero, and the accelerometer is read for its zero


class AngleSample(NamedTuple):
    """One sample of the sensors; nan where there is nothing new."""

    dt_s: Any  #: time since the sample before [s]
    turned_rad: np.ndarray  #: (wheels,) counts since the sample before, as an angle; driven wheels first
    current_A: np.ndarray  #: (driven,) of the motors over the step that ends now
    edge_age_s: np.ndarray  #: (wheels,) time since the last edge of a count, >= 0, where a timer captures it
    acceleration_m_s2: Any = math.nan  #: from an accelerometer along x, gravity included
    pitch_rad: Any = math.nan  #: of the body, > 0 with the nose up; nan counts as level
    yaw_rate_rad_s: Any = math.nan  #: from a gyro
    speed_m_s: Any = math.nan  #: forward, external, of now


class MomentumEstimate(NamedTuple):
    """Estimate after a sample; arrays are (driven,)."""

    #: of the body
    speed_m_s: Any
    speed_std_m_s: Any
    yaw_rate_rad_s: Any  #: > 0 to the left
    #: of each driven wheel, and of its centre along it
    wheel_speed_rad_s: np.ndarray
    travel_speed_m_s: np.ndarray
    #: the ratio is nan below a floor of speed
    slip_speed_m_s: np.ndarray
    slip_speed_std_m_s: np.ndarray
    slip_ratio: np.ndarray
    force_N: np.ndarray  #: of the ground on the wheel
    acceleration_m_s2: np.ndarray  #: of the wheel's centre
    disturbance_m_s2: Any  #: unmodelled acceleration against the robot
    flags: Any  #: sum of `MomentumFlag`
