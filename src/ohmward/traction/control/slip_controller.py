"""Holds a slip with torque: one shell around any law, for limits, reverse, dropouts and standstill.

Laws see motion along the commanded direction; braking opposes travel, whichever way it goes. Where the measurement or
the command cannot be used, and where a robot that brakes has come to a stop, the torque goes to zero as fast as its
limit lets it, and the law forgets what it had integrated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_positive
from ohmward.trace import clip, logical_not, maximum, where
from ohmward.traction.control.driven_wheel import DrivenWheel
from ohmward.traction.control.force_filter import Observed, Observer, believable_step_s
from ohmward.traction.control.limits import Limits, limited
from ohmward.traction.control.signals import ControlFlag, Measurement, Report, SlipCommand
from ohmward.traction.control.slip_law import Motion, SlipLaw
from ohmward.traction.control.surface import surface
from ohmward.traction.dynamics.slip import driving_slip_ratio, travel_direction

#: A shorter time [s] is no time to take a rate over.
_SHORTEST = 1e-9


class SlipState(NamedTuple):
    """What the controller carries from step to step.

    seen:        what is believed of the wheel.
    memory:      the law's.
    torque_Nm:   given in the last step.
    slip_target: slip ratio reached by the ramp.
    direction:   1 forward, -1 reverse, 0 before the first step.
    limited_s:   how long the limit of the torque has kept the slip away from its target.
    """

    seen: Observed
    memory: Any
    torque_Nm: Any
    slip_target: Any
    direction: Any
    limited_s: Any


@dataclass(frozen=True)
class SlipController:
    """Settings; `init` and `step` are pure functions of them.

    Attributes:
        wheel: what is known of each driven wheel.
        law: `SlidingMode`, `FuzzySlidingMode`, `SlipRatioSlidingMode` or `SlipPid`.
        limits: of the torque.
        observer: of force and acceleration, and what it takes as a measurement.
        target_rate_per_s: how fast the slip that is held follows the command, > 0.
        floor_m_s: v_0, below which a slip speed is held instead of a slip ratio, > 0.
        launch: how many times that slip speed a driving wheel starts with from rest, >= 1.
        stop_m_s: below this speed braking has come to its end, > 0.
        tolerance: deviation of the slip ratio that counts as reached, > 0.
        reset_after_s: a slip that stays out of reach so long is reported, > 0.
    """

    wheel: DrivenWheel
    law: SlipLaw
    limits: Limits
    observer: Observer = field(default_factory=Observer)
    target_rate_per_s: float = 5.0
    floor_m_s: float = 0.25
    launch: float = 6.0
    stop_m_s: float = 0.05
    tolerance: float = 0.02
    reset_after_s: float = 0.2

    def __post_init__(self) -> None:
        for name in ("target_rate_per_s", "floor_m_s", "stop_m_s", "tolerance", "reset_after_s"):
            require_positive(f"slip_controller.{name}", getattr(self, name))
        require_between("slip_controller.launch", self.launch, 1.0, math.inf)

    def init(self, first: Measurement) -> SlipState:
        """The state before the first step, without torque and with no slip to hold."""
        seen = self.observer.init(first)
        zero = 0.0 * seen.wheel_speed_rad_s
        return SlipState(seen, self.law.init(zero), zero, zero, zero, zero)

    def step(
        self, state: SlipState, command: SlipCommand, measurement: Measurement, dt_s: Any
    ) -> tuple[SlipState, Any, Report]:
        """The state after the step, the torque [N m] to hold for the next `dt_s`, and what the controller saw."""
        dt_s = believable_step_s(dt_s)
        seen = self.observer.observe(state.seen, state.torque_Nm, measurement, self.wheel, dt_s)
        direction = self.direction(command, seen)
        target, motion = self.motion(state, command, seen, direction, dt_s)
        known, stopped, understood = seen.known > 0.5, self.stopped(command, seen), understandable(command)
        acting = known & logical_not(stopped) & understood

        fresh = self.law.init(0.0 * state.torque_Nm)
        memory = choose_memory(direction == state.direction, state.memory, fresh)
        wished = where(acting, direction * self.law.torque_Nm(memory, motion, self.wheel), 0.0)
        torque = self.limits.apply(wished, state.torque_Nm, dt_s)
        after = self.law.remember(memory, motion, direction * wished, direction * torque)
        here = surface(motion.rim_m_s, motion.travel_m_s, target, self.floor_m_s, motion.launch)
        missing = limited(wished, torque) & (abs(here.sigma) > self.tolerance * here.reference_speed)
        limited_s = where(acting & missing, state.limited_s + dt_s, 0.0)

        flags = (
            where(known, 0.0, float(ControlFlag.STALE))
            + where(stopped & known, float(ControlFlag.STOPPED), 0.0)
            + where(limited(wished, torque), float(ControlFlag.TORQUE_LIMITED), 0.0)
            + where(limited_s > self.reset_after_s, float(ControlFlag.UNREACHABLE), 0.0)
            + where(understood, 0.0, float(ControlFlag.BAD_COMMAND))
        )
        ratio = driving_slip_ratio(direction * motion.rim_m_s, direction * motion.travel_m_s)
        report = Report(ratio, target, here.sigma, seen.force_N, wished, flags)
        kept = choose_memory(acting, after, fresh)
        return SlipState(seen, kept, torque, where(acting, target, 0.0), direction, limited_s), torque, report

    def direction(self, command: SlipCommand, seen: Observed) -> Any:
        """1 forward, -1 reverse: as commanded when driving, that of travel when braking."""
        rim = self.wheel.radius_m * seen.wheel_speed_rad_s
        commanded = where(command.direction >= 0, 1.0, -1.0)
        return where(command.slip_ratio < 0, travel_direction(rim, seen.travel_speed_m_s), commanded)

    def stopped(self, command: SlipCommand, seen: Observed) -> Any:
        """Whether the robot brakes and is too slow for that."""
        rim = abs(self.wheel.radius_m * seen.wheel_speed_rad_s)
        return (command.slip_ratio < 0) & (maximum(rim, abs(seen.travel_speed_m_s)) < self.stop_m_s)

    def motion(
        self, state: SlipState, command: SlipCommand, seen: Observed, direction: Any, dt_s: Any
    ) -> tuple[Any, Motion]:
        """The slip to hold in this step, and the wheel along its direction."""
        wanted = where(understandable(command), command.slip_ratio, 0.0)
        rate = (wanted - state.slip_target) / maximum(dt_s, _SHORTEST)
        rate = clip(rate, -self.target_rate_per_s, self.target_rate_per_s)
        target = state.slip_target + rate * dt_s
        return target, Motion(
            direction * self.wheel.radius_m * seen.wheel_speed_rad_s,
            direction * seen.travel_speed_m_s,
            direction * seen.acceleration_m_s2,
            direction * seen.force_N,
            target,
            rate,
            self.floor_m_s,
            dt_s,
            where(target > 0, self.launch, 1.0),
        )


def understandable(command: SlipCommand) -> Any:
    """Whether the command is a slip ratio."""
    return abs(command.slip_ratio) < 1.0


def choose_memory(condition: Any, a: Any, b: Any) -> Any:
    """Memory `a` where the condition holds, else `b`: nested NamedTuples of numbers."""
    if isinstance(a, tuple):
        return type(a)(*(choose_memory(condition, x, y) for x, y in zip(a, b, strict=True)))
    return where(condition, a, b)
