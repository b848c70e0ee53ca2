"""Speed controller within slip bounds: the normal driving mode of a robot.

F = m [a_ref + 2 w e + w^2 int e dt],   e = v_ref - v,   tau = r F + J a_ref / r,   then between two bounds:

tau(-lambda_max) <= tau <= tau(+lambda_max)

The bounds are the torques with which the sliding mode law would hold the slips -lambda_max and +lambda_max. While the
wheel grips they leave room; where the ground gives way they override the speed loop, continuously, and the law holds
the slip at its bound until the speed loop needs less. While the torque is bounded v_ref goes no further than the speed
itself, and the integral is frozen.

v_ref is a ramp that eases off: a_ref = a min(1, sqrt(|v_c - v_ref| / v_e)) falls linearly in time to zero. Copper and
creep lose the square of the force, and of all ways to cover a distance in a time and end at a speed, the one of least
int a^2 dt has an acceleration linear in time. A ramp that starts with 4/3 of a constant one's acceleration and eases
off all the way covers the same distance in the same time, with 8/9 of int a^2 dt.

At standstill, with speed 0 commanded, the loop uses the rim's speed in e: the integral is then the wheel's angle, and
the wheel holds its position.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ohmward.checks import require_each_positive
from ohmward.filters.flags import flags_of
from ohmward.trace import clip, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.control.force_filter import SHORTEST_CONTROL_STEP_S, ForceFilter, WheelEstimate, plausible_step_s
from ohmward.traction.control.signals import (
    ControlFlag,
    DrivenWheel,
    Limits,
    Measurement,
    Report,
    SpeedCommand,
    limited,
)
from ohmward.traction.control.sliding_mode import SlidingMode
from ohmward.traction.control.slip_law import Motion
from ohmward.traction.dynamics.slip import driving_slip_ratio

#: A smaller slip bound is below what any speed estimate resolves, and would demand an unlimited force.
_LEAST_BOUND = 1e-3


class SpeedState(NamedTuple):
    """State of the speed controller."""

    estimate: WheelEstimate  #:      of the wheel
    torque_Nm: Any  #:     given in the last step
    reference_m_s: Any  #: speed reached by the ramp
    integral_m: Any  #:    of the speed error


class Bounds(NamedTuple):
    """Torques [N m] that hold the slip at its bounds, and sigma [m/s] of each."""

    lower_Nm: Any
    upper_Nm: Any
    lower_sigma: Any
    upper_sigma: Any


@dataclass(frozen=True)
class SpeedController:
    """Settings; `init` and `step` are pure functions of them."""

    wheel: DrivenWheel  #: parameters of each driven wheel
    law: SlidingMode  #: law that holds the slip at its bounds
    limits: Limits  #: of the torque
    force_filter: ForceFilter = field(default_factory=ForceFilter)  #: estimates force and acceleration
    acceleration_m_s2: float = 0.5  #: a, largest of the ramp, > 0
    easing_m_s: float = 0.25  #: v_e, last part of a change of speed, over which the ramp eases off, > 0
    bandwidth_rad_s: float = 3.0  #: w, of the speed loop, > 0
    creep_m_s: float = 0.06  #: slip speed that is always allowed, so that a robot can start and climb, > 0
    stop_m_s: float = 0.05  #: speed below which a robot commanded to stop has stopped, > 0

    def __post_init__(self) -> None:
        require_each_positive(
            "speed_controller.", self, "acceleration_m_s2", "easing_m_s", "bandwidth_rad_s", "creep_m_s", "stop_m_s"
        )

    def init(self, first: Measurement) -> SpeedState:
        """State before the first step: no torque, and the ramp starts from the present speed."""
        estimate = self.force_filter.init(first)
        zero = 0.0 * estimate.wheel_speed_rad_s
        return SpeedState(estimate, zero, estimate.travel_speed_m_s, zero)

    def step(
        self, state: SpeedState, command: SpeedCommand, measurement: Measurement, dt_s: Any
    ) -> tuple[SpeedState, Any, Report]:
        """State after the step, torque [N m] to hold for the next `dt_s`, and report."""
        dt_s = plausible_step_s(dt_s)
        estimate = self.force_filter.update(state.estimate, state.torque_Nm, measurement, self.wheel, dt_s)
        known = estimate.known > 0.5
        valid = is_speed(command)
        acting = known & valid
        rim = self.wheel.radius_m * estimate.wheel_speed_rad_s
        stopped = self.stopped(state, command, estimate)

        acceleration = self.ramp_m_s2(state, command, dt_s)
        error = state.reference_m_s - where(stopped, rim, estimate.travel_speed_m_s)
        demanded = where(acting, self.speed_torque_Nm(acceleration, error, state.integral_m), 0.0)
        bounds = self.bounds(command, estimate, dt_s)
        bounded = where(acting, between(demanded, bounds), 0.0)
        torque = self.limits.apply(bounded, state.torque_Nm, dt_s)

        lacking = where(limited(demanded, torque), demanded - torque, 0.0)
        waiting = lacking * acceleration > 0.0
        reference = self.next_reference(state, estimate, waiting, acceleration, dt_s)
        integral = state.integral_m + where(waiting | (lacking * error > 0.0), 0.0, error * dt_s)
        after = SpeedState(
            estimate,
            torque,
            where(acting, reference, estimate.travel_speed_m_s),
            where(acting, integral, 0.0),
        )
        flags = flags_of(
            {
                ControlFlag.STALE: logical_not(known),
                ControlFlag.STOPPED: stopped & acting,
                ControlFlag.TORQUE_LIMITED: limited(bounded, torque),
                ControlFlag.SLIP_BOUND: limited(demanded, bounded),
                ControlFlag.BAD_COMMAND: logical_not(valid),
            }
        )
        sigma = where(demanded >= 0, bounds.upper_sigma, bounds.lower_sigma)
        ratio = driving_slip_ratio(rim, estimate.travel_speed_m_s)
        return after, torque, Report(ratio, command.slip_bound, sigma, estimate.force_N, demanded, flags)

    def next_reference(
        self, state: SpeedState, estimate: WheelEstimate, waiting: Any, acceleration_m_s2: Any, dt_s: Any
    ) -> Any:
        """Reference speed after the step; while torque is lacking, no further than the speed itself."""
        ahead = (estimate.travel_speed_m_s - state.reference_m_s) * acceleration_m_s2 > 0.0
        held = where(ahead, estimate.travel_speed_m_s, state.reference_m_s)
        return where(waiting, held, state.reference_m_s + acceleration_m_s2 * dt_s)

    def ramp_m_s2(self, state: SpeedState, command: SpeedCommand, dt_s: Any) -> Any:
        """Acceleration of the reference towards the command."""
        to_go = where(is_speed(command), command.speed_m_s, 0.0) - state.reference_m_s
        most = self.acceleration_m_s2 * minimum(1.0, sqrt(abs(to_go) / self.easing_m_s))
        return clip(to_go / maximum(dt_s, SHORTEST_CONTROL_STEP_S), -most, most)

    def speed_torque_Nm(self, acceleration_m_s2: Any, error_m_s: Any, integral_m: Any) -> Any:
        """Torque of the speed loop, critically damped; the wheel's own inertia takes part of it."""
        w, r = self.bandwidth_rad_s, self.wheel.radius_m
        corrected = acceleration_m_s2 + 2 * w * error_m_s + w * w * integral_m
        return r * self.wheel.mass_kg * corrected + self.wheel.inertia_kg_m2 / r * acceleration_m_s2

    def bounds(self, command: SpeedCommand, estimate: WheelEstimate, dt_s: Any) -> Bounds:
        """Torques that hold the slip at its bounds."""
        bound = where(is_speed(command), command.slip_bound, 0.5)
        motion = Motion(
            self.wheel.radius_m * estimate.wheel_speed_rad_s,
            estimate.travel_speed_m_s,
            estimate.acceleration_m_s2,
            estimate.force_N,
            bound,
            0.0,
            self.creep_m_s / bound,
            dt_s,
        )
        below = motion._replace(slip_target=-bound)
        memory = self.law.init(0.0 * estimate.wheel_speed_rad_s)
        return Bounds(
            self.law.torque_Nm(memory, below, self.wheel),
            self.law.torque_Nm(memory, motion, self.wheel),
            self.law.surface(below).sigma,
            self.law.surface(motion).sigma,
        )

    def stopped(self, state: SpeedState, command: SpeedCommand, estimate: WheelEstimate) -> Any:
        """True where the robot is commanded to stand and stands."""
        fastest = maximum(abs(self.wheel.radius_m * estimate.wheel_speed_rad_s), abs(estimate.travel_speed_m_s))
        return (command.speed_m_s == 0) & (state.reference_m_s == 0) & (fastest < self.stop_m_s)


def is_speed(command: SpeedCommand) -> Any:
    """True where the command is a finite speed with a bound of slip in its range."""
    return (abs(command.speed_m_s) < float("inf")) & (command.slip_bound >= _LEAST_BOUND) & (command.slip_bound < 1.0)


def between(demanded_Nm: Any, b: Bounds) -> Any:
    """The torque within its bounds; if they cross, far outside, the one on the side of the slip counts."""
    from_above = minimum(maximum(demanded_Nm, b.lower_Nm), b.upper_Nm)
    from_below = maximum(minimum(demanded_Nm, b.upper_Nm), b.lower_Nm)
    return where(b.upper_sigma + b.lower_sigma > 0.0, from_above, from_below)
