"""Speed and slip from wheels and gyro, of a robot whose motor currents do not show the force that drives it.

Which wheel slips, and how fast the robot moves, follows from the hypotheses of the odometry (`modes`): in each of them
some wheel rolls, which shows the speed. Forces and friction stay unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np

from ohmward.filters.flags import flags_of
from ohmward.filters.sanitize import some, within
from ohmward.trace import sqrt, where
from ohmward.traction.dynamics.slip import slip_ratio
from ohmward.traction.motion.outside_speed import ALARM
from ohmward.traction.motion.sample import STEEPEST_RAD, RobotSample, no_sample
from ohmward.traction.odometry.pose_filter import PoseFilter, PoseState, PoseStep
from ohmward.traction.odometry.sample import OdometryFlag, OdometrySample
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.speed_evidence import SEEN_S

#: Incidents of the odometry that raise a flag of the estimate.
INCIDENTS: dict[SlipFlag, tuple[OdometryFlag, ...]] = {
    SlipFlag.BAD_TIME: (OdometryFlag.BAD_TIME,),
    SlipFlag.GAP: (OdometryFlag.GAP,),
    SlipFlag.NO_ENCODER: (OdometryFlag.NO_ENCODER, OdometryFlag.NO_WHEELS),
    SlipFlag.GYRO_REJECTED: (OdometryFlag.TURN_REJECTED, OdometryFlag.NO_GYRO),
    SlipFlag.SPEED_REJECTED: (OdometryFlag.SPEED_REJECTED,),
    SlipFlag.ENCODER_SPIKE: (OdometryFlag.WHEEL_JUMP,),
    SlipFlag.NOT_POSITIVE_DEFINITE: (OdometryFlag.NOT_POSITIVE_DEFINITE,),
}


@dataclass(frozen=True)
class SlipByOdometry:
    """Settings; `init` and `step` are pure functions of them."""

    odometry: PoseFilter

    @property
    def robot(self) -> Robot:
        """Robot with its wheels."""
        return self.odometry.robot

    def no_sample(self) -> RobotSample:
        """A sample without any measurement, to be filled with `_replace`."""
        return no_sample(self.robot)

    def init(self, first: RobotSample) -> PoseState:
        """State before the first sample."""
        return self.odometry.init(OdometrySample(first))

    def step(self, state: PoseState, sample: RobotSample) -> tuple[PoseState, SlipEstimate]:
        """State and estimate after a sample."""
        found = self.odometry.observe(state, OdometrySample(sample))
        return found.state, self.conclude(found, sample)

    def conclude(self, found: PoseStep, sample: RobotSample) -> SlipEstimate:
        """Speed and slip after a step of the odometry; the grade is the measured pitch, else level."""
        pose, n = found.estimate, self.robot.driven
        motion = np.array([pose.speed_m_s, pose.speed_left_m_s, pose.yaw_rate_rad_s])
        travel_m_s = self.odometry.rolling @ motion
        rim_m_s = travel_m_s + pose.slip_speed_m_s
        rims = zip(rim_m_s, travel_m_s, strict=True)
        conditions: dict[IntFlag, Any] = {
            flag: some(found.incidents[of] for of in causes) for flag, causes in INCIDENTS.items()
        }
        conditions |= {SlipFlag.NO_CURRENT: True, SlipFlag.SPEED_UNOBSERVED: found.unobserved_s > SEEN_S}
        return SlipEstimate(
            speed_m_s=pose.speed_m_s,
            speed_std_m_s=sqrt(pose.twist_cov[0, 0]),
            yaw_rate_rad_s=pose.yaw_rate_rad_s,
            yaw_rate_std_rad_s=sqrt(pose.twist_cov[2, 2]),
            wheel_speed_rad_s=rim_m_s / (self.robot.wheel.radius_m * pose.radius_ratio),
            slip_speed_m_s=pose.slip_speed_m_s,
            slip_speed_std_m_s=pose.slip_speed_std_m_s,
            slip_ratio=np.array([slip_ratio(rim, travel) for rim, travel in rims]),
            traction_N=np.full(n, np.nan),
            friction_ratio=np.ones(n),
            friction_std=np.zeros(n),
            grade_rad=where(within(sample.pitch_rad, STEEPEST_RAD), sample.pitch_rad, 0.0),
            grade_std_rad=0.0,
            radius_ratio=pose.radius_ratio,
            radius_std=pose.radius_std,
            grip=1.0 - pose.slip_probability,
            unobserved_s=found.unobserved_s,
            slipping=np.array([where(p > 0.5, 1.0, 0.0) for p in pose.slip_probability]),
            immobilised=where(pose.stuck_probability > ALARM, 1.0, 0.0),
            flags=flags_of(conditions),
        )
