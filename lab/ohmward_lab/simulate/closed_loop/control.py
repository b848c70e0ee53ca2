"""Commands over time, and the torque controller of the driven wheels, which runs at its own rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_each_positive, require_finite, require_one_of
from ohmward.errors import InputError
from ohmward.filters.gate import choose
from ohmward.trace import clip, where
from ohmward.traction.control import (
    Limits,
    Measurement,
    Report,
    SlidingMode,
    SlipCommand,
    SlipController,
    SpeedCommand,
    SpeedController,
    Uncertainty,
    driven_wheel,
)
from ohmward.traction.control.slip_law import SlipLaw
from ohmward.traction.robot.robot import Robot
from ohmward_lab.traction.compared_slip_laws import FuzzySlidingMode, SlipPid, SlipRatioSlidingMode
from ohmward_lab.traction.wheel_speed_cascade import DriveState, WheelSpeedCascade, WheelSpeedDrive

#: Keys of a command that each mode takes; the first one is required.
MODES: dict[str, tuple[str, ...]] = {
    "speed": ("speed_m_s", "yaw_rate_rad_s"),
    "slip": ("slip_ratio", "reverse"),
    "torque": ("torque_Nm",),
    "wheel-speed": ("speed_m_s", "yaw_rate_rad_s"),
    "ramp": ("speed_m_s", "yaw_rate_rad_s"),
}
LAWS = ("sliding-mode", "fuzzy", "slip-ratio", "pid", "cascade")
#: Time [s] between two steps of the cascade; drives take a new wheel speed at 50 Hz.
CASCADE_S = 0.02
_TIMING = ("from_s", "mode")
#: Acceleration limit that disables the ramp.
NO_RAMP_M_S2 = 1e6


@dataclass(frozen=True)
class Command:
    """Command from a time on; its mode determines which keys it takes."""

    from_s: float = 0.0  #: time at which it begins, >= 0
    speed_m_s: float | None = None  #: forward, < 0 in reverse; 0 stops
    yaw_rate_rad_s: float | None = None  #: > 0 to the left
    slip_ratio: float | None = None  #: in (-1, 1), < 0 brakes
    reverse: bool | None = None  #: drive backwards with that slip
    torque_Nm: float | None = None  #: of each driven wheel
    mode: str | None = None  #: of the controller from then on; None is that of the controller's settings

    def __post_init__(self) -> None:
        require_between("commands.from_s", self.from_s, 0.0, math.inf)
        if self.mode is not None:
            require_one_of("commands.mode", self.mode, MODES)
        for name in ("speed_m_s", "yaw_rate_rad_s", "torque_Nm"):
            if getattr(self, name) is not None:
                require_finite(f"commands.{name}", getattr(self, name))
        if self.slip_ratio is not None and not -1 < self.slip_ratio < 1:
            raise InputError(f"commands.slip_ratio must be between -1 and 1 (0.12 is 12 %), got {self.slip_ratio:g}")


@dataclass(frozen=True)
class Control:
    """The controller and its limits."""

    #: of commands without one: "speed" within slip bounds, "slip", "torque" without feedback, or a wheel-speed PI that
    #: ignores slip, "wheel-speed" at once or "ramp"
    mode: str = "speed"
    #: in mode "slip": "sliding-mode", "fuzzy", "slip-ratio" ([T] 5.3), "pid", or "cascade", which asks a wheel-speed PI
    #: for speeds at 50 Hz
    law: str = "sliding-mode"
    slip_bound: float = 0.12  #: in mode "speed", >= 0.001 and < 1
    acceleration_m_s2: float = 0.5  #: of the ramps, > 0
    #: of each driven wheel, > 0
    torque_limit_Nm: float = 12.0
    torque_rate_Nm_per_s: float = 5000.0
    friction: float = 0.5  #: assumed by the laws, with an error of up to as much, > 0
    interval_s: float = 0.001  #: between steps, > 0 and at most 0.02

    def __post_init__(self) -> None:
        require_one_of("controller.mode", self.mode, MODES)
        require_one_of("controller.law", self.law, LAWS)
        require_each_positive(
            "controller.", self, "acceleration_m_s2", "torque_limit_Nm", "torque_rate_Nm_per_s", "friction"
        )
        require_between("controller.slip_bound", self.slip_bound, 0.001, 0.999)
        require_between("controller.interval_s", self.interval_s, 1e-4, CASCADE_S)

    def mode_of(self, command: Command) -> str:
        """Mode of a command: its own, or that of these settings."""
        return command.mode or self.mode

    def check(self, command: Command) -> None:
        """Refuse a command that does not fit the mode or the limits.

        Raises:
            InputError: a missing key that the mode needs, a key that it does not take, a torque too large.
        """
        mode = self.mode_of(command)
        where_from = "controller.mode" if command.mode is None else "commands.mode"
        used = MODES[mode]
        given = [f.name for f in fields(command) if f.name not in _TIMING and getattr(command, f.name) is not None]
        if used[0] not in given:
            raise InputError(f'commands.{used[0]} is missing; {where_from} = "{mode}" needs it')
        if unused := [name for name in given if name not in used]:
            raise InputError(
                f'commands.{unused[0]} is not taken by {where_from} = "{mode}", which takes '
                f"{', '.join(used)}; remove it or choose another mode"
            )
        if command.torque_Nm is not None and abs(command.torque_Nm) > self.torque_limit_Nm:
            raise InputError(
                f"commands.torque_Nm must be within ± {self.torque_limit_Nm:g} (controller.torque_limit_Nm), got "
                f"{command.torque_Nm:g}; lower it or raise the limit"
            )


class WheelCommand(NamedTuple):
    """Command for the wheels."""

    travel_m_s: Any  #: (driven,) of the wheels' centres
    #: numbers, the same for all wheels
    slip_ratio: Any
    direction: Any
    torque_Nm: Any  #: (driven,) of the wheels


class Controller(NamedTuple):
    """A controller; both functions can be traced."""

    #: state before the first step; from its measurement and the torque [N m] to take over from
    init: Callable[[Measurement, Any], Any]
    #: state after a step, the torque to hold, and a report; from state, command, measurement and dt_s
    step: Callable[[Any, WheelCommand, Measurement, Any], tuple[Any, Any, Report]]


def wheel_command(command: Command, robot: Robot) -> WheelCommand:
    """The command for this robot's wheels."""
    motion = np.zeros(robot.freedoms)
    motion[0], motion[-1] = command.speed_m_s or 0.0, command.yaw_rate_rad_s or 0.0
    travel = robot.rolling[: robot.driven] @ motion
    torque = np.full(robot.driven, command.torque_Nm or 0.0)
    return WheelCommand(travel, command.slip_ratio or 0.0, -1.0 if command.reverse else 1.0, torque)


def make_controller(control: Control, robot: Robot) -> Controller:
    """The controller that the settings name, for all driven wheels of this robot."""
    one = wheel_controller(control, robot)

    def init(m: Measurement, torque_Nm: Any) -> tuple:
        given = np.broadcast_to(torque_Nm, robot.driven)
        return tuple(one.init(of_wheel(m, k), given[k]) for k in range(robot.driven))

    def step(states: tuple, command: WheelCommand, m: Measurement, dt_s: Any) -> tuple[tuple, np.ndarray, Report]:
        steps = [one.step(state, of_wheel(command, k), of_wheel(m, k), dt_s) for k, state in enumerate(states)]
        after, torques, reports = zip(*steps, strict=True)
        return tuple(after), np.array(torques), Report(*(np.array(values) for values in zip(*reports, strict=True)))

    return Controller(init, step)


def of_wheel(values: Any, k: int) -> Any:
    """Element k of each field that is an array, the other fields as they are."""
    return type(values)(*(v[k] if isinstance(v, np.ndarray) else v for v in values))


def wheel_controller(control: Control, robot: Robot) -> Controller:
    """The controller that the settings name, for one driven wheel."""
    limits = Limits(control.torque_limit_Nm, control.torque_rate_Nm_per_s)
    if control.mode == "torque":
        return _open_loop(limits)
    if control.mode in ("wheel-speed", "ramp"):
        acceleration = control.acceleration_m_s2 if control.mode == "ramp" else NO_RAMP_M_S2
        return _wheel_speed_loop(WheelSpeedDrive(limits), robot.wheel.radius_m, acceleration)
    wheel = driven_wheel(robot)
    sliding = SlidingMode(Uncertainty(force_N=control.friction * wheel.load_N))
    if control.mode == "speed":
        loop = SpeedController(wheel, sliding, limits, acceleration_m_s2=control.acceleration_m_s2)
        return _loop(loop, lambda command: SpeedCommand(command.travel_m_s, control.slip_bound))
    if control.law == "cascade":
        return _cascade(WheelSpeedCascade(wheel), WheelSpeedDrive(limits))
    laws: dict[str, SlipLaw] = {
        "sliding-mode": sliding,
        "fuzzy": FuzzySlidingMode(sliding),
        "slip-ratio": SlipRatioSlidingMode(sliding.uncertainty),
        "pid": SlipPid(),
    }
    return _loop(
        SlipController(wheel, laws[control.law], limits),
        lambda command: SlipCommand(command.slip_ratio, command.direction),
    )


def _loop(loop: SpeedController | SlipController, asked: Callable[[WheelCommand], Any]) -> Controller:
    """A controller of speed or slip; `asked` turns a command into its own."""

    def init(m: Measurement, torque_Nm: Any) -> Any:
        return loop.init(m)._replace(torque_Nm=torque_Nm)

    def step(state: Any, command: WheelCommand, m: Measurement, dt_s: Any) -> Any:
        return loop.step(state, asked(command), m, dt_s)

    return Controller(init, step)


class CascadeLoop(NamedTuple):
    """States of the cascade and of the drive; reference [rad/s], report and age [s] of the cascade's last step."""

    outer: Any
    drive: Any
    reference_rad_s: Any
    report: Report
    age_s: Any


def _cascade(outer: WheelSpeedCascade, drive: WheelSpeedDrive) -> Controller:
    def init(m: Measurement, torque_Nm: Any) -> CascadeLoop:
        state, zero = outer.init(m), 0.0 * m.wheel_speed_rad_s
        motor = DriveState(torque_Nm, torque_Nm)
        return CascadeLoop(state, motor, state.reference_rad_s, _report_without_slip(zero), CASCADE_S)

    def step(state: CascadeLoop, command: WheelCommand, m: Measurement, dt_s: Any) -> Any:
        slip_command = SlipCommand(command.slip_ratio, command.direction)
        due = state.age_s > CASCADE_S - 0.5 * dt_s
        now = outer.step(state.outer, slip_command, m, CASCADE_S)
        before = state.outer, state.reference_rad_s, state.report
        after, reference, report = (choose(due, new, old) for new, old in zip(now, before, strict=True))
        motor, torque = drive.step(state.drive, reference, m.wheel_speed_rad_s, dt_s)
        age_s = where(due, 0.0, state.age_s) + dt_s
        return CascadeLoop(after, motor, reference, report, age_s), torque, report

    return Controller(init, step)


class RampLoop(NamedTuple):
    """State of the drive, and the rim's speed [m/s] that the ramp has reached."""

    drive: Any
    rim_m_s: Any


def _wheel_speed_loop(drive: WheelSpeedDrive, radius_m: float, acceleration_m_s2: float) -> Controller:
    def init(m: Measurement, torque_Nm: Any) -> RampLoop:
        return RampLoop(DriveState(torque_Nm, torque_Nm), radius_m * m.wheel_speed_rad_s)

    def step(state: RampLoop, command: WheelCommand, m: Measurement, dt_s: Any) -> Any:
        change = acceleration_m_s2 * dt_s
        rim = clip(command.travel_m_s, state.rim_m_s - change, state.rim_m_s + change)
        motor, torque = drive.step(state.drive, rim / radius_m, m.wheel_speed_rad_s, dt_s)
        return RampLoop(motor, rim), torque, _report_without_slip(torque)

    return Controller(init, step)


def _open_loop(limits: Limits) -> Controller:
    def init(m: Measurement, torque_Nm: Any) -> Any:
        return torque_Nm + 0.0 * m.wheel_speed_rad_s

    def step(state: Any, command: WheelCommand, m: Measurement, dt_s: Any) -> Any:
        torque = limits.apply(command.torque_Nm + 0.0 * state, state, dt_s)
        return torque, torque, _report_without_slip(torque)

    return Controller(init, step)


def _report_without_slip(torque_Nm: Any) -> Report:
    """Report of a controller without slip."""
    nothing = math.nan + 0.0 * torque_Nm
    return Report(nothing, nothing, nothing, nothing, torque_Nm, 0.0 * torque_Nm)
