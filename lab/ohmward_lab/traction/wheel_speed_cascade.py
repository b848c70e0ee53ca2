"""Wheel-speed cascade: holds a slip on ordinary motor drives with a wheel-speed command.

r omega_ref = v / (1 - lambda_d) driving,   v (1 + lambda_d) braking,   |lambda_d| v_0 away from v at least when driving

It is the surface sigma = 0 solved for the rim's speed. The drive's own loop is fast, so 50 Hz are enough; the reference
is computed for the middle of the time for which it will hold, `lead_s` ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_each_positive
from ohmward.filters.flags import flags_of
from ohmward.trace import clip, logical_not, where
from ohmward.traction.control.force_filter import ForceFilter, WheelEstimate, plausible_step_s
from ohmward.traction.control.signals import ControlFlag, DrivenWheel, Limits, Measurement, Report, SlipCommand, limited
from ohmward.traction.control.slip_controller import direction_of, has_stopped, is_slip
from ohmward.traction.control.slip_law import rim_speed_m_s, surface
from ohmward.traction.dynamics.slip import driving_slip_ratio


class CascadeState(NamedTuple):
    """Estimate of the wheel, and the wheel speed [rad/s] commanded in the last step."""

    estimate: WheelEstimate
    reference_rad_s: Any


@dataclass(frozen=True)
class WheelSpeedCascade:
    """Settings; `init` and `step` are pure functions of them."""

    wheel: DrivenWheel  #: parameters of each driven wheel
    force_filter: ForceFilter = field(default_factory=ForceFilter)  #: estimates the acceleration
    floor_m_s: float = 0.2  #: v_0, > 0
    lead_s: float = 0.01  #: time by which the travel speed is predicted ahead, >= 0
    wheel_acceleration_rad_s2: float = 200.0  #: largest change of the reference, > 0
    stop_m_s: float = 0.05  #: speed below which braking has ended, > 0

    def __post_init__(self) -> None:
        require_each_positive("wheel_speed_cascade.", self, "floor_m_s", "wheel_acceleration_rad_s2", "stop_m_s")
        require_between("wheel_speed_cascade.lead_s", self.lead_s, 0.0, math.inf)

    def init(self, first: Measurement) -> CascadeState:
        """State before the first step: the wheel's speed is its reference."""
        estimate = self.force_filter.init(first)
        return CascadeState(estimate, estimate.wheel_speed_rad_s)

    def step(
        self, state: CascadeState, command: SlipCommand, measurement: Measurement, dt_s: Any
    ) -> tuple[CascadeState, Any, Report]:
        """State after the step, wheel speed [rad/s] to command, and a report without force and torque."""
        dt_s = plausible_step_s(dt_s)
        r = self.wheel.radius_m
        estimate = self.force_filter.update(state.estimate, 0.0, measurement, self.wheel, dt_s)
        rim, v = r * estimate.wheel_speed_rad_s, estimate.travel_speed_m_s
        known = estimate.known > 0.5
        valid = is_slip(command)
        stopped = has_stopped(command, rim, v, self.stop_m_s)
        acting = known & valid & logical_not(stopped)

        direction = direction_of(command, rim, v)
        ahead = direction * (v + estimate.acceleration_m_s2 * self.lead_s)
        target = where(valid, command.slip_ratio, 0.0)
        demanded = where(acting, direction * rim_speed_m_s(ahead, target, self.floor_m_s) / r, 0.0)
        change = self.wheel_acceleration_rad_s2 * dt_s
        reference = clip(demanded, state.reference_rad_s - change, state.reference_rad_s + change)

        flags = flags_of(
            {
                ControlFlag.STALE: logical_not(known),
                ControlFlag.STOPPED: stopped & known,
                ControlFlag.TORQUE_LIMITED: limited(demanded, reference),
                ControlFlag.BAD_COMMAND: logical_not(valid),
            }
        )
        sigma = surface(direction * rim, direction * v, target, self.floor_m_s).sigma
        ratio = driving_slip_ratio(rim, v)
        report = Report(ratio, target, sigma, math.nan * reference, math.nan * reference, flags)
        return CascadeState(estimate, reference), reference, report


class DriveState(NamedTuple):
    """Torque of the integral and torque given in the last step [N m]."""

    integral_Nm: Any
    torque_Nm: Any


@dataclass(frozen=True)
class WheelSpeedDrive:
    """Settings; `init` and `step` are pure functions of them."""

    limits: Limits  #: of the torque
    proportional_Nm_s: float = 2.0  #: K_p, torque per rad/s, > 0
    integral_Nm: float = 40.0  #: K_i, torque per rad, > 0

    def __post_init__(self) -> None:
        require_each_positive("wheel_speed_drive.", self, "proportional_Nm_s", "integral_Nm")

    def init(self, wheel_speed_rad_s: Any) -> DriveState:
        """State without torque."""
        zero = 0.0 * wheel_speed_rad_s
        return DriveState(zero, zero)

    def step(
        self, state: DriveState, reference_rad_s: Any, wheel_speed_rad_s: Any, dt_s: Any
    ) -> tuple[DriveState, Any]:
        """The state after the step and the torque [N m] to hold for the next `dt_s`."""
        dt_s = plausible_step_s(dt_s)
        error = reference_rad_s - wheel_speed_rad_s
        demanded = self.proportional_Nm_s * error + state.integral_Nm
        torque = self.limits.apply(demanded, state.torque_Nm, dt_s)
        windup = limited(demanded, torque) & ((demanded - torque) * error > 0.0)
        integral = state.integral_Nm + where(windup, 0.0, self.integral_Nm * error * dt_s)
        return DriveState(integral, torque), torque
