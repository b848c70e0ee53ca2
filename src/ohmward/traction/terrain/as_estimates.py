"""Slip on floors as the estimates of an observer, so that scores, reports and files take either."""

from __future__ import annotations

import numpy as np

from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.slip_alarm import SlipAlarm
from ohmward.traction.terrain.slip_on_floors import FloorRun


def as_estimates(track: FloorRun, robot: Robot, test: SlipAlarm | None = None) -> SlipEstimate:
    """The track as estimates (T, ...); what is no question here is as assumed: radius, level ground, friction.

    test: what slip is allowed.
    """
    n, test = robot.driven, test or SlipAlarm()
    rim = track.rim @ robot.rolling[:n].T
    travel = np.sqrt(np.sum(track.rim[:, :-1] ** 2, axis=1))[:, None]
    slip, std = np.nan_to_num(track.slip_ratio) * travel, np.nan_to_num(track.slip_ratio_std) * travel
    nothing, ones = np.zeros(len(track.time_s)), np.ones(len(track.time_s))
    return SlipEstimate(
        speed_m_s=track.motion[:, 0],
        speed_std_m_s=track.motion_std[:, 0],
        yaw_rate_rad_s=track.motion[:, -1],
        yaw_rate_std_rad_s=track.motion_std[:, -1],
        wheel_speed_rad_s=rim / robot.wheel.radius_m,
        slip_speed_m_s=slip,
        slip_speed_std_m_s=std,
        slip_ratio=slip_ratio(rim, rim - slip),
        traction_N=track.force_N,
        friction_ratio=np.ones_like(slip),
        friction_std=np.zeros_like(slip),
        grade_rad=nothing,
        grade_std_rad=nothing,
        radius_ratio=ones,
        radius_std=nothing,
        grip=np.ones_like(slip),
        unobserved_s=nothing,
        slipping=test.slips(slip, std, rim).astype(float),
        immobilised=nothing,
        flags=nothing,
    )
