"""Slip controller: a shell around any slip law that handles limits, reverse, dropouts and standstill.

Laws see motion along the commanded direction; braking opposes travel in either direction. If the measurement or the
command cannot be used, or a braking robot has come to a stop, the torque goes to zero as fast as its limit allows, and
the law forgets its integral.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_each_positive
from ohmward.filters.flags import flags_of
from ohmward.filters.gate import choose
from ohmward.trace import clip, logical_not, maximum, where
from ohmward.traction.control.force_filter import SHORTEST_CONTROL_STEP_S, ForceFilter, WheelEstimate, plausible_step_s
from ohmward.traction.control.signals import ControlFlag, DrivenWheel, Limits, Measurement, Report, SlipCommand, limited
from ohmward.traction.control.slip_law import Motion, SlipLaw, surface
from ohmward.traction.dynamics.slip import driving_slip_ratio, travel_direction


class SlipState(NamedTuple):
    """State of the slip controller."""

    estimate: WheelEstimate  #:    of the wheel
    memory: Any  #:      of the law
    torque_Nm: Any  #:   given in the last step
    slip_target: Any  #: slip ratio reached by the ramp
    direction: Any  #:   1 forward, -1 reverse, 0 before the first step
    limited_s: Any  #:   time for which the torque limit has kept the slip away from its target


@dataclass(frozen=True)
class SlipController:
    """Settings; `init` and `step` are pure functions of them."""

    wheel: DrivenWheel  #: parameters of each driven wheel
    law: SlipLaw  #: `SlidingMode`; laws to compare it with are in `ohmward_lab.traction.compared_slip_laws`
    limits: Limits  #: of the torque
    force_filter: ForceFilter = field(default_factory=ForceFilter)  #: estimates force and acceleration
    target_rate_per_s: float = 5.0  #: rate at which the held slip follows the command, > 0
    floor_m_s: float = 0.22  #: v_0, below which a slip speed is held instead of a slip ratio, > 0
    launch: float = 5.0  #: slip speed with which a driving wheel starts from rest, over that slip speed, >= 1
    stop_m_s: float = 0.05  #: speed below which braking has ended, > 0
    tolerance: float = 0.02  #: deviation of the slip ratio that counts as reached, > 0
    unreachable_after_s: float = 0.2  #: a slip that stays out of reach for longer is reported, > 0

    def __post_init__(self) -> None:
        require_each_positive(
            "slip_controller.", self, "target_rate_per_s", "floor_m_s", "stop_m_s", "tolerance", "unreachable_after_s"
        )
        require_between("slip_controller.launch", self.launch, 1.0, math.inf)

    def init(self, first: Measurement) -> SlipState:
        """State before the first step, without torque and with no slip to hold."""
        estimate = self.force_filter.init(first)
        zero = 0.0 * estimate.wheel_speed_rad_s
        return SlipState(estimate, self.law.init(zero), zero, zero, zero, zero)

    def step(
        self, state: SlipState, command: SlipCommand, measurement: Measurement, dt_s: Any
    ) -> tuple[SlipState, Any, Report]:
        """State after the step, torque [N m] to hold for the next `dt_s`, and report."""
        dt_s = plausible_step_s(dt_s)
        estimate = self.force_filter.update(state.estimate, state.torque_Nm, measurement, self.wheel, dt_s)
        rim = self.wheel.radius_m * estimate.wheel_speed_rad_s
        direction = direction_of(command, rim, estimate.travel_speed_m_s)
        target, rate_per_s = self.target(state, command, dt_s)
        motion = self.motion(estimate, direction, target, rate_per_s, dt_s, state.torque_Nm)
        known = estimate.known > 0.5
        stopped = has_stopped(command, rim, estimate.travel_speed_m_s, self.stop_m_s)
        valid = is_slip(command)
        acting = known & logical_not(stopped) & valid

        fresh = self.law.init(0.0 * state.torque_Nm)
        memory = choose(direction == state.direction, state.memory, fresh)
        demanded = where(acting, direction * self.law.torque_Nm(memory, motion, self.wheel), 0.0)
        torque = self.limits.apply(demanded, state.torque_Nm, dt_s)
        memory = self.law.remember(memory, motion, direction * demanded, direction * torque)

        here = surface(motion.rim_m_s, motion.travel_m_s, target, self.floor_m_s, motion.launch)
        saturated = limited(demanded, torque)
        missed = saturated & (abs(here.sigma) > self.tolerance * here.reference_speed)
        limited_s = where(acting & missed, state.limited_s + dt_s, 0.0)
        flags = flags_of(
            {
                ControlFlag.STALE: logical_not(known),
                ControlFlag.STOPPED: stopped & known,
                ControlFlag.TORQUE_LIMITED: saturated,
                ControlFlag.UNREACHABLE: limited_s > self.unreachable_after_s,
                ControlFlag.BAD_COMMAND: logical_not(valid),
            }
        )
        ratio = driving_slip_ratio(direction * motion.rim_m_s, direction * motion.travel_m_s)
        report = Report(ratio, target, here.sigma, estimate.force_N, demanded, flags)
        memory = choose(acting, memory, fresh)
        return SlipState(estimate, memory, torque, where(acting, target, 0.0), direction, limited_s), torque, report

    def target(self, state: SlipState, command: SlipCommand, dt_s: Any) -> tuple[Any, Any]:
        """Slip ratio to hold in this step, on a ramp towards the command, and its rate [1/s]."""
        commanded = where(is_slip(command), command.slip_ratio, 0.0)
        rate = (commanded - state.slip_target) / maximum(dt_s, SHORTEST_CONTROL_STEP_S)
        rate = clip(rate, -self.target_rate_per_s, self.target_rate_per_s)
        return state.slip_target + rate * dt_s, rate

    def motion(
        self, estimate: WheelEstimate, direction: Any, target: Any, rate_per_s: Any, dt_s: Any, torque_before_Nm: Any
    ) -> Motion:
        """Motion of the wheel along its direction, and its target slip."""
        return Motion(
            rim_m_s=direction * self.wheel.radius_m * estimate.wheel_speed_rad_s,
            travel_m_s=direction * estimate.travel_speed_m_s,
            acceleration_m_s2=direction * estimate.acceleration_m_s2,
            force_N=direction * estimate.force_N,
            slip_target=target,
            target_rate_per_s=rate_per_s,
            floor_m_s=self.floor_m_s,
            dt_s=dt_s,
            launch=where(target > 0, self.launch, 1.0),
            torque_before_Nm=direction * torque_before_Nm,
        )


def direction_of(command: SlipCommand, rim_m_s: Any, travel_m_s: Any) -> Any:
    """1 forward, -1 reverse: the commanded direction when driving, that of travel when braking."""
    commanded = where(command.direction >= 0, 1.0, -1.0)
    return where(command.slip_ratio < 0, travel_direction(rim_m_s, travel_m_s), commanded)


def has_stopped(command: SlipCommand, rim_m_s: Any, travel_m_s: Any, stop_m_s: float) -> Any:
    """True where the robot brakes and is too slow to brake any further."""
    return (command.slip_ratio < 0) & (maximum(abs(rim_m_s), abs(travel_m_s)) < stop_m_s)


def is_slip(command: SlipCommand) -> Any:
    """True where the command is a slip ratio with a finite direction."""
    return (abs(command.slip_ratio) < 1.0) & (abs(command.direction) < float("inf"))
