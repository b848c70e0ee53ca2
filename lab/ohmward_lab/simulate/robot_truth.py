"""Truth about a simulated robot, the same for every plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ohmward.errors import InputError

#: The order of the wheels of a robot on two axles; other robots have that of `Robot.places`, driven wheels first.
WHEELS = ("front left", "front right", "rear left", "rear right")


class RobotTruth(NamedTuple):
    """One instant; wheels in the order of the robot. Stacked over time every field gets (T,) in front."""

    time_s: Any  #: since the reset [s]
    #: (3,) of the robot's centre at axle height, in the world: x uphill, y to the left, z off the ground [m]
    position_m: Any
    heading_rad: Any  #: 0 along x, > 0 to the left
    #: of the centre, forward and to the left
    speed_m_s: Any
    lateral_speed_m_s: Any
    yaw_rate_rad_s: Any  #: > 0 to the left
    #: (wheels,), > 0 forward
    wheel_angle_rad: Any
    wheel_speed_rad_s: Any
    torque_N_m: Any  #: (wheels,) of the motors on the wheels
    wheel_centre_speed_m_s: Any  #: (wheels,) forward speed of the wheel's centre, v_f
    slip_speed_m_s: Any  #: (wheels,) s = r omega - v_f
    slip_ratio: Any  #: (wheels,) s / max(|r omega|, |v_f|), NaN below the floor of `traction.slip`
    #: (wheels,) force of the ground on the wheel, forward, to the left, up
    traction_N: Any
    lateral_N: Any
    normal_N: Any
    friction: Any  #: (wheels,) adhesion under the wheel
    grade_rad: Any  #: slope of the ground, > 0 where x leads uphill
    gyro_rad_s: Any  #: (3,) angular velocity about forward, left, up
    specific_force_m_s2: Any  #: (3,) of an ideal accelerometer, forward, left, up; 9.81 up at rest on level ground


def stack(truths: Sequence[RobotTruth]) -> RobotTruth:
    """The truth over time, every field an array with time (T,) in front."""
    return RobotTruth(*(np.array(values) for values in zip(*truths, strict=True)))


def driven_torques(torque_N_m: Any, driven: tuple[int, ...]) -> np.ndarray:
    """Torques (driven,) [N m] from a number or one for each driven wheel; driven: numbers of these wheels.

    Raises:
        InputError: another number of torques, or a number that is not finite.
    """
    given = np.asarray(torque_N_m, dtype=float)
    if given.shape not in ((), (len(driven),)):
        raise InputError(f"torque_N_m must be a number or one for each driven wheel {driven}, got {given.shape}")
    if not np.isfinite(given).all():
        raise InputError(f"torque_N_m must be finite, got {given.tolist()}")
    return np.broadcast_to(given, len(driven))
