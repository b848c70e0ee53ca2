"""Forward speed from the wheels that grip, where others spin and no speed observer tells.

A gyro tells what the turn adds to each rim, so that every driven wheel shows a forward speed of its own:

    v_i = r w_i - g_i w_g,   v = sum(c_i v_i) / sum(c_i),   c_i = 1 / (1 + ((v_i - v_f) / l)^4)

v_f is the speed before, followed as fast as friction can change it, l the most by which a wheel that grips slips.
Wheels that slip against each other while the robot turns count alike, one that runs away soon counts no more: the
fourth power keeps it so as long as they slip by less than 0.76 l. Where all wheels run away, v stays within l of v_f.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.trace import clip, maximum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.odometry.noise import OdometryNoise
from ohmward.traction.robot.chassis import PLANAR
from ohmward.traction.robot.robot import Robot

#: No wheel on the ground changes the speed of a robot faster [m/s2]: the friction of rubber is 1.
GRIP_M_S2 = 9.81

#: A driven wheel that grips slips by less: [m/s] of a robot that turns on the spot, share of the speed, and so many
#: standard deviations of what counting and the track, as far as it is unknown, show.
LOOSE_M_S, LOOSE_SHARE, LOOSE_SIGMAS = 0.2, 0.1, 4.0


class GripSpeed(NamedTuple):
    """Forward speed as the wheels show it."""

    forward_m_s: Scalar  #: of those that grip
    followed_m_s: Scalar  #: the same, changed no faster than friction can
    beyond_m_s: Scalar  #: speed of the rims beyond the one that was followed
    loose_m_s: Scalar  #: largest slip of a wheel that counts as one that grips


def speed_by_grip(
    rims_m_s: np.ndarray,
    mean_m_s: Scalar,
    turn_rad_s: Scalar,
    by_gyro: Scalar,
    followed_m_s: Scalar,
    since_s: Scalar,
    count_m_s: Scalar,
    robot: Robot,
    noise: OdometryNoise,
) -> GripSpeed:
    """Forward speed of the driven rims (driven,).

    mean_m_s: forward speed of them all; alone used without a gyro, and for wheels that roll sideways too.
    turn_rad_s: yaw rate of the gyro.
    followed_m_s: forward speed that was followed before.
    since_s: time since the wheels were last measured.
    count_m_s: standard deviation of a rim's speed by counting.
    """
    track_m_s = noise.turn_scale_std * lever_m(robot) * abs(turn_rad_s)
    loose_m_s = LOOSE_M_S + LOOSE_SHARE * abs(followed_m_s) + LOOSE_SIGMAS * (count_m_s + track_m_s)
    forward_m_s = mean_m_s
    if PLANAR[1] not in robot.chassis.freedoms:
        by_wheel_m_s = np.asarray(rims_m_s - robot.rolling[: robot.driven, -1] * turn_rad_s)
        counted = np.asarray(1.0 / (1.0 + ((by_wheel_m_s - followed_m_s) / loose_m_s) ** 4))
        forward_m_s = where(by_gyro, counted @ by_wheel_m_s / (counted @ np.ones(robot.driven)), mean_m_s)
    most_m_s = GRIP_M_S2 * since_s
    after_m_s = followed_m_s + clip(forward_m_s - followed_m_s, -most_m_s, most_m_s)
    return GripSpeed(
        clip(forward_m_s, after_m_s - loose_m_s, after_m_s + loose_m_s),
        after_m_s,
        maximum(abs(forward_m_s - after_m_s) - LOOSE_SIGMAS * count_m_s, 0.0),
        loose_m_s,
    )


def lever_m(robot: Robot) -> float:
    """Speed of the driven rims by a turn over its yaw rate, root of the mean square."""
    return float(np.sqrt(np.mean(robot.rolling[: robot.driven, -1] ** 2)))
