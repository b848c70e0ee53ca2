"""Slip on floors as estimates of the speed observer, so that scores, reports and files take either."""

from __future__ import annotations

import numpy as np

from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate
from ohmward.traction.speed_observer.slip_alarm import SlipAlarm
from ohmward.traction.terrain.demand import travel_speed
from ohmward.traction.terrain.slip_on_floors import FloorRun


def as_estimates(run: FloorRun, robot: Robot) -> SlipEstimate:
    """The run as estimates (T, ...); radius, level ground and friction are as assumed."""
    rim = run.rim @ robot.rolling[: robot.driven].T
    travel = travel_speed(run.rim)[:, None]
    slip, std = np.nan_to_num(run.slip_ratio) * travel, np.nan_to_num(run.slip_ratio_std) * travel
    nothing, ones = np.zeros(len(run.time_s)), np.ones(len(run.time_s))
    return SlipEstimate(
        speed_m_s=run.motion[:, 0],
        speed_std_m_s=run.motion_std[:, 0],
        yaw_rate_rad_s=run.motion[:, -1],
        yaw_rate_std_rad_s=run.motion_std[:, -1],
        wheel_speed_rad_s=rim / robot.wheel.radius_m,
        slip_speed_m_s=slip,
        slip_speed_std_m_s=std,
        slip_ratio=slip_ratio(rim, rim - slip),
        traction_N=run.force_N,
        friction_ratio=np.ones_like(slip),
        friction_std=np.zeros_like(slip),
        grade_rad=nothing,
        grade_std_rad=nothing,
        radius_ratio=ones,
        radius_std=nothing,
        grip=np.ones_like(slip),
        unobserved_s=nothing,
        slipping=SlipAlarm().slips(slip, std, rim).astype(float),
        immobilised=nothing,
        flags=nothing,
    )
