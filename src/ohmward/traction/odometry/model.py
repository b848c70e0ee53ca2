"""Dead reckoning with the errors of its sensors as states.

    v = c v_r (1 + k) + sigma_v z_v,   l = l_r (1 + k) + sigma_l z_l
    w = (w_g - b)(1 + k_g) with a gyro, else w_r (1 + k_w) + q v_r + sigma_w z_w
    x+ = x + dt (v cos m - l sin m),   y+ = y + dt (v sin m + l cos m),   m = yaw + w dt/2,   yaw+ = yaw + w dt

A compass shows yaw + h, with its heading h at the yaw 0, which lasts.

v_r, l_r, w_r is the motion of the wheels' rims, or that of a speed observer; w_g the gyro's. The scales k, k_g, k_w,
the curvature q by unequal wheels and the offset b last. Slip is correlated over seconds: z is a Gauss-Markov process of
unit variance, scaled by the standard deviation that holds now. So the error of the position grows with the root of
time, and faster than that of errors drawn anew at every sample.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.linear_algebra import std
from ohmward.trace import cos, exp, maximum, sin, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.odometry.noise import OdometryNoise

#: The state, in order.
NAMES = (
    "x_m",
    "y_m",
    "yaw_rad",
    "gyro_offset_rad_s",
    "gyro_scale",
    "radius_scale",
    "turn_scale",
    "curvature_1_m",
    "heading_zero_rad",
    "slip",
    "side_slip",
    "turn_slip",
)
X, Y, YAW, OFFSET, GYRO_SCALE, RADIUS, TURN_SCALE, CURVATURE, HEADING_ZERO = range(len(NAMES) - 3)
SLIP, SIDE_SLIP, TURN_SLIP = range(len(NAMES) - 3, len(NAMES))
#: Gauss-Markov states of unit variance.
CORRELATED = (SLIP, SIDE_SLIP, TURN_SLIP)

#: Standard deviation [rad] of a heading that may be any.
ANY_HEADING_RAD = math.pi / math.sqrt(3.0)

#: Acceleration [m/s2, m/s2, rad/s2] that is possible while nothing shows the motion.
UNOBSERVED = np.array([0.5, 0.1, 0.5])


class MotionInput(NamedTuple):
    """Motion over a step as the sensors show it."""

    dt_s: Scalar  #: step [s]
    motion: np.ndarray  #: (3,) forward, left [m/s] and turning [rad/s], of the wheels or of an observer
    motion_std: np.ndarray  #: (3,) standard deviations of its correlated errors
    scale: Scalar  #: share of the radius's standard deviation that is in its speed
    gyro_rad_s: Scalar  #: yaw rate of the gyro
    gyro_variance: Scalar  #: of its angle over time [rad2/s]
    by_gyro: Any  #: the condition that it tells the turn
    unobserved_s: np.ndarray  #: (3,) time for which nothing has shown each motion


def first_belief(noise: OdometryNoise, turn_per_slip: float) -> Belief:
    """Belief at the start of the frame `odom`; turn_per_slip: yaw rate over independent slip of the wheels [1/m]."""
    stds = {
        OFFSET: noise.gyro_offset_std_rad_s,
        GYRO_SCALE: noise.gyro_scale_std,
        RADIUS: noise.radius_std,
        TURN_SCALE: noise.turn_scale_std,
        CURVATURE: noise.wheel_difference_std * turn_per_slip,
        HEADING_ZERO: ANY_HEADING_RAD,
        SLIP: 1.0,
        SIDE_SLIP: 1.0,
        TURN_SLIP: 1.0,
    }
    return Belief(np.zeros(len(NAMES)), np.diag([stds.get(i, 0.0) ** 2 for i in range(len(NAMES))]))


def turn_of_wheels(x: np.ndarray, u: MotionInput) -> Scalar:
    """Yaw rate [rad/s] of the robot as its wheels show it."""
    return u.motion[2] * (1.0 + x[TURN_SCALE]) + u.motion[0] * x[CURVATURE] + u.motion_std[2] * x[TURN_SLIP]


def twist(x: np.ndarray, u: MotionInput) -> np.ndarray:
    """Forward and leftward speed [m/s] and yaw rate [rad/s], (3,), in state x (n,)."""
    scale = 1.0 + u.scale * x[RADIUS]
    forward = u.motion[0] * scale + u.motion_std[0] * x[SLIP]
    left = u.motion[1] * scale + u.motion_std[1] * x[SIDE_SLIP]
    gyro = (u.gyro_rad_s - x[OFFSET]) * (1.0 + x[GYRO_SCALE])
    return np.array([forward, left, where(u.by_gyro, gyro, turn_of_wheels(x, u))])


def next_state(x: np.ndarray, u: MotionInput, noise: OdometryNoise) -> np.ndarray:
    """State (n,) after the step."""
    forward, left, turn = twist(x, u) * u.dt_s
    middle = x[YAW] + turn / 2.0
    c, s = cos(middle), sin(middle)
    pose = [x[X] + forward * c - left * s, x[Y] + forward * s + left * c, x[YAW] + turn]
    decay = exp(-u.dt_s / noise.correlation_s)
    return np.array([*pose, *x[OFFSET:SLIP], *(decay * x[i] for i in CORRELATED)])


def process_noise(x: np.ndarray, u: MotionInput, noise: OdometryNoise) -> np.ndarray:
    """Q (n, n) of a step from state x (n,)."""
    decay = exp(-u.dt_s / noise.correlation_s)
    drift = unobserved_variance(u)
    c, s = cos(x[YAW]), sin(x[YAW])
    along, across = drift[0], drift[1]
    turned = drift[2] + where(u.by_gyro, u.gyro_variance * u.dt_s, 0.0)
    pose = np.array([
        [along * c * c + across * s * s, (along - across) * c * s, 0.0],
        [(along - across) * c * s, along * s * s + across * c * c, 0.0],
        [0.0, 0.0, turned],
    ])  # fmt: skip
    variances = [0.0] * (SLIP - OFFSET) + [1.0 - decay * decay] * len(CORRELATED)
    variances[0] = noise.gyro_offset_walk**2 * u.dt_s
    Q = np.zeros((len(NAMES), len(NAMES)), dtype=np.result_type(pose, np.asarray(variances)))
    Q[:3, :3] = pose
    Q[range(3, len(NAMES)), range(3, len(NAMES))] = variances
    return Q


def unobserved_variance(u: MotionInput) -> np.ndarray:
    """Variance (3,) that the step adds to the way forward and left and to the turn, by motion that nothing shows.

    An acceleration a since then is a way of a t^2 / 2, wrong by its whole length: Var+ - Var = (a/2)^2 (t+^4 - t^4).
    """
    before_s = maximum(u.unobserved_s - u.dt_s, 0.0)
    return (UNOBSERVED / 2.0) ** 2 * (u.unobserved_s**4 - before_s**4)


def position_std(cov: np.ndarray) -> Scalar:
    """Largest standard deviation [m] of the position in any direction: the long half axis of its ellipse of one sigma.

    cov: covariance of x, y and whatever follows.
    """
    mean, half = (cov[0, 0] + cov[1, 1]) / 2.0, (cov[0, 0] - cov[1, 1]) / 2.0
    return std(mean + sqrt(half * half + cov[0, 1] * cov[0, 1]))
