"""Estimates as the fields of ROS messages: `nav_msgs/Odometry` and `geometry_msgs/TwistWithCovarianceStamped`.

Frames are those of REP 103 and REP 105: x forward, y to the left, z up; the pose in `odom`, the twist in `base_link`.
A covariance is the 6x6 matrix of x, y, z and the rotations about them, row by row, 36 numbers.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ohmward.traction.odometry.sample import OdometryEstimate

#: Indices of x, y and yaw among x, y, z and the rotations about them.
PLANE = (0, 1, 5)

#: Variance of what planar odometry does not estimate: large, as filters that fuse the message expect.
UNKNOWN_VARIANCE = 1e6
_UNKNOWN: list[float] = np.diag(np.full(6, UNKNOWN_VARIANCE)).ravel().tolist()


def odometry_message(
    estimate: OdometryEstimate, stamp_s: float, frame_id: str = "odom", child_frame_id: str = "base_link"
) -> dict[str, Any]:
    """The fields of a `nav_msgs/Odometry`, nested as in the message.

    stamp_s: time of the sample [s].
    """
    half = float(estimate.yaw_rad) / 2.0
    return {
        "header": header(stamp_s, frame_id),
        "child_frame_id": child_frame_id,
        "pose": {
            "pose": {
                "position": vector(estimate.x_m, estimate.y_m),
                "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
            },
            "covariance": six_by_six(estimate.pose_cov),
        },
        "twist": twist_of(estimate),
    }


def twist_message(estimate: OdometryEstimate, stamp_s: float, frame_id: str = "base_link") -> dict[str, Any]:
    """The fields of a `geometry_msgs/TwistWithCovarianceStamped`, nested as in the message."""
    return {"header": header(stamp_s, frame_id), "twist": twist_of(estimate)}


def twist_of(estimate: OdometryEstimate) -> dict[str, Any]:
    """The fields of a `geometry_msgs/TwistWithCovariance`."""
    rates = estimate.speed_m_s, estimate.speed_left_m_s, estimate.yaw_rate_rad_s
    return twist_with_covariance(*rates, estimate.twist_cov)


def twist_with_covariance(forward_m_s: Any, left_m_s: Any, yaw_rate_rad_s: Any, cov: np.ndarray) -> dict[str, Any]:
    """The fields of a `geometry_msgs/TwistWithCovariance` from speeds, a yaw rate and their covariance (3, 3)."""
    twist = {"linear": vector(forward_m_s, left_m_s), "angular": vector(z=yaw_rate_rad_s)}
    return {"twist": twist, "covariance": six_by_six(cov)}


def header(stamp_s: float, frame_id: str) -> dict[str, Any]:
    """A `std_msgs/Header`: whole seconds and nanoseconds, zero where the time is not known."""
    sec, nanosec = divmod(round(stamp_s * 1e9), 10**9) if math.isfinite(stamp_s) else (0, 0)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}


def vector(x: Any = 0.0, y: Any = 0.0, z: Any = 0.0) -> dict[str, float]:
    """A point or vector."""
    return {"x": float(x), "y": float(y), "z": float(z)}


def six_by_six(cov: np.ndarray) -> list[float]:
    """The covariance (3, 3) of x, y and yaw as 36 numbers, row by row."""
    full = _UNKNOWN.copy()
    for row, values in zip(PLANE, np.asarray(cov, dtype=float).tolist(), strict=True):
        for column, value in zip(PLANE, values, strict=True):
            full[6 * row + column] = value
    return full
