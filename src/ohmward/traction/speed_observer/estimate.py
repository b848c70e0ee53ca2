"""Sample and estimate of the speed observer: plain numbers, one sample at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.flags import SampleFlag


class SlipEstimate(NamedTuple):
    """Estimate after a sample. A quantity that is not a state has the value that is assumed, and std 0.

    >>> estimator = ow.SlipEstimator("turtlebot4")
    >>> estimate = estimator.update(0.0, wheel_speed_rad_s=[5.0, 5.0], yaw_rate_rad_s=0.0)
    >>> estimate.slip_speed_m_s.shape
    (2,)

    speed_m_s, speed_std_m_s: of the body, forward.
    yaw_rate_rad_s, yaw_rate_std_rad_s: > 0 to the left.
    wheel_speed_rad_s: (driven,).
    slip_speed_m_s, slip_speed_std_m_s: (driven,) r omega - v of the wheel's centre.
    slip_ratio: (driven,) nan below a floor of speed.
    traction_N: (driven,) force of the ground.
    friction_ratio, friction_std: (driven,) largest traction over the terrain's; the std is relative.
    grade_rad, grade_std_rad: > 0 uphill.
    radius_ratio, radius_std: effective radius over the robot's.
    grip: (driven,) slope of traction over slip, one sigma of slip beyond the estimate, over the slope without slip:
        1 grips, 0 spins. The wheels show the speed of the body as far as they grip.
    unobserved_s: time for which nothing has shown the speed of the body: no wheel gripped, no passive wheel turned, no
        external speed came. Then it is dead reckoning from the forces, and `speed_std_m_s` grows with it.
    slipping: (driven,) 1 where the slip is beyond the allowed one, see `SlipAlarm`, else 0.
    immobilised: 1 where the wheels turn and the robot does not, else 0.
    flags: sum of `SlipFlag` values; 0 is a sample without incident.
    """

    speed_m_s: Any
    speed_std_m_s: Any
    yaw_rate_rad_s: Any
    yaw_rate_std_rad_s: Any
    wheel_speed_rad_s: np.ndarray
    slip_speed_m_s: np.ndarray
    slip_speed_std_m_s: np.ndarray
    slip_ratio: np.ndarray
    traction_N: np.ndarray
    friction_ratio: np.ndarray
    friction_std: np.ndarray
    grade_rad: Any
    grade_std_rad: Any
    radius_ratio: Any
    radius_std: Any
    grip: np.ndarray
    unobserved_s: Any
    slipping: np.ndarray
    immobilised: Any
    flags: Any


def unknown_ground(driven: int) -> SlipEstimate:
    """Estimate of a method that knows no ground, to be filled with `_replace`: nan, a radius as given, and no alarm."""
    unknown = np.full(driven, math.nan)
    return SlipEstimate(
        speed_m_s=math.nan,
        speed_std_m_s=math.nan,
        yaw_rate_rad_s=math.nan,
        yaw_rate_std_rad_s=math.nan,
        wheel_speed_rad_s=unknown,
        slip_speed_m_s=unknown,
        slip_speed_std_m_s=unknown,
        slip_ratio=unknown,
        traction_N=unknown,
        friction_ratio=unknown,
        friction_std=unknown,
        grade_rad=math.nan,
        grade_std_rad=math.nan,
        radius_ratio=1.0,
        radius_std=0.0,
        grip=unknown,
        unobserved_s=0.0,
        slipping=np.zeros(driven),
        immobilised=0.0,
        flags=0.0,
    )


class SlipFlag(SampleFlag):
    """Events at a sample. None of them stops the observer.

    >>> ow.SlipEstimator("turtlebot4").update(0.0, wheel_speed_rad_s=[None, None]).flags
    SlipFlag.NO_CURRENT|NO_ENCODER
    """

    BAD_TIME = 1  # dt_s is not a number, negative or hours: taken as 0
    GAP = 2  # longer than the last current is believed: the speed may be anything near
    NO_CURRENT = 4  # of at least one motor, or one that no wheel takes: the last one fades, its torque is unknown
    NO_ENCODER = 8  # of at least one driven wheel: not a number, or one that no wheel has
    GROUND_CHANGED = 16  # a wheel moved as the model excludes: its ground is unknown, its speed is the encoder's
    ENCODER_DOUBTED = 32  # a wheel has contradicted the model for so long that its encoder is no longer used
    GYRO_REJECTED = 64  # outside its gate
    SPEED_REJECTED = 128  # outside its gate
    SPEED_RESET = 256  # it has contradicted the estimate for too long: the estimate was opened for it
    STANDSTILL = 512  # wheels and motors at rest: speed is zero
    SPEED_UNOBSERVED = 1024  # nothing has shown the speed for a while: dead reckoning
    NOT_POSITIVE_DEFINITE = 2048  # the covariance had to be repaired
    RESTARTED = 4096  # the state was no longer one that this robot can have: a new one was started from this sample
    ENCODER_SPIKE = 8192  # an encoder jumped as no wheel can: not used
