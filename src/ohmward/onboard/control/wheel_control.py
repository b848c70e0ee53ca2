"""Torques and speeds of the driven wheels from estimates and an operator's set-points."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ohmward.onboard.control.operator_command import NOTHING, DriveLimits, OperatorCommand
from ohmward.trace import Kernel
from ohmward.trace.kernel import repeatable_lowering
from ohmward.traction.control import (
    ForceFilter,
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
from ohmward.traction.control.slip_law import rim_speed_m_s
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.estimate import SlipEstimate

#: Slip speed [m/s] that is always allowed, so that a robot can start and climb; as in `SpeedController`.
_CREEP_M_S = 0.06


class WheelCommands(NamedTuple):
    """Commands for the driven wheels; a drive takes one of them."""

    #: (driven,)
    torque_Nm: np.ndarray
    wheel_speed_rad_s: np.ndarray
    report: Report  #: report of the torque controller


class _EachWheel:
    """Controller of all driven wheels, with its step compiled for one wheel; with NumPy it took ten times as long.

    controller: `SpeedController` or `SlipController`.  wheels: number of driven ones.
    command: type of its set-points.
    """

    def __init__(self, controller: SpeedController | SlipController, wheels: int, command: type):
        self._controller = controller
        first = Measurement(*[0.0] * len(Measurement._fields))
        start = _floats(controller.init(first))
        example = command(0.0, 0.0), first, 0.0
        # compiled before the motors turn: a compilation beside the loop would delay its beats
        kernel = Kernel(partial(_step, controller), start, example, lowering=repeatable_lowering())
        self._lives = [kernel.live(start) for _ in range(wheels)]

    def begin(self, first: Measurement, torque_Nm: np.ndarray) -> None:
        """Start from a measurement, with the previous torques."""
        for wheel, live in enumerate(self._lives):
            state = self._controller.init(_of_wheel(first, wheel))
            live.state = _floats(state._replace(torque_Nm=torque_Nm[wheel]))

    def step(self, asked: SlipCommand | SpeedCommand, measured: Measurement, dt_s: float) -> tuple[np.ndarray, Report]:
        """Torques (driven,) [N m] and report."""
        found = [
            live.step((_of_wheel(asked, wheel), _of_wheel(measured, wheel), dt_s))
            for wheel, live in enumerate(self._lives)
        ]
        torques, reports = zip(*found, strict=True)
        return np.array(torques), Report(*map(np.array, zip(*reports, strict=True)))


def _step(controller: SpeedController | SlipController, state: Any, sample: Any) -> tuple[Any, Any]:
    """A step in the form that `Kernel.live` takes."""
    after, torque_Nm, report = controller.step(state, *sample)
    return after, (torque_Nm, report)


def _of_wheel(record: Any, wheel: int) -> Any:
    """The record of one wheel, from a record with fields of shape (driven,)."""
    return type(record)(*(float(values[wheel]) for values in record))


def _floats(tree: Any) -> Any:
    """A state with floats for all numbers."""
    if not isinstance(tree, tuple):
        return float(tree)
    parts = [_floats(part) for part in tree]
    return type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)


class WheelControl:
    """Slip control of all driven wheels: a speed within slip bounds, or a slip.

    Args:
        robot: the robot that drives.
        limits: of torque, acceleration and slip.
    """

    def __init__(self, robot: Robot, limits: DriveLimits):
        self.robot, self.limits = robot, limits
        wheel = driven_wheel(robot)
        law = SlidingMode(Uncertainty(force_N=limits.friction * wheel.load_N))
        torque = Limits(limits.torque_Nm, limits.torque_rate_Nm_per_s)
        lag = ForceFilter(oldest_s=limits.estimate_timeout_s)
        speed = SpeedController(wheel, law, torque, lag, limits.acceleration_m_s2)
        slip = SlipController(wheel, law, torque, lag)
        self._floor_m_s = slip.floor_m_s
        self._speed = _EachWheel(speed, robot.driven, SpeedCommand)
        self._slip = _EachWheel(slip, robot.driven, SlipCommand)
        self.reset()

    def reset(self) -> None:
        """Restart without torque and from the speeds of the next step."""
        self._torque_Nm: np.ndarray | None = None
        self._holds_slip = False
        self._rim_m_s: np.ndarray | None = None

    def step(self, command: OperatorCommand, estimate: SlipEstimate, age_s: float, dt_s: float) -> WheelCommands:
        """The commands to hold for the next `dt_s`; age_s: of the estimate."""
        n = self.robot.driven
        travel = self._travel_m_s(estimate.speed_m_s, estimate.yaw_rate_rad_s)
        std = np.full(n, float(estimate.speed_std_m_s))
        nothing = np.full(n, np.nan)
        m = Measurement(np.array(estimate.wheel_speed_rad_s, float), travel, np.full(n, age_s), std, nothing, nothing)
        holds_slip = abs(command.slip_ratio) >= NOTHING
        loop = self._slip if holds_slip else self._speed
        if self._torque_Nm is None or holds_slip != self._holds_slip:
            loop.begin(m, np.zeros(n) if self._torque_Nm is None else self._torque_Nm)
            self._holds_slip = holds_slip
        wanted = self._travel_m_s(command.speed_m_s, command.yaw_rate_rad_s)
        direction = np.where(wanted < 0.0, -1.0, 1.0)
        slip = np.full(n, command.slip_ratio if holds_slip else command.slip_bound)
        asked = SlipCommand(slip, direction) if holds_slip else SpeedCommand(wanted, slip)
        self._torque_Nm, report = loop.step(asked, m, dt_s)
        rim = self._rim_speed(wanted, direction, slip, holds_slip, travel, dt_s)
        return WheelCommands(self._torque_Nm, rim / self.robot.wheel.radius_m, report)

    def _rim_speed(
        self,
        wanted: np.ndarray,
        direction: np.ndarray,
        slip: np.ndarray,
        holds_slip: bool,
        travel: np.ndarray,
        dt_s: float,
    ) -> np.ndarray:
        """Speed [m/s] of the rims: a ramp to the wanted speed within the slip bounds, or to the speed for the slip."""
        before = travel if self._rim_m_s is None else self._rim_m_s
        ahead = direction * travel
        floor = self._floor_m_s
        driving = np.maximum(rim_speed_m_s(ahead, abs(slip), floor), ahead + _CREEP_M_S)
        braking = np.minimum(rim_speed_m_s(ahead, -abs(slip), floor), ahead - _CREEP_M_S)
        if holds_slip:
            aim = direction * np.where(slip > 0.0, driving, np.maximum(braking, 0.0))
        else:
            aim = direction * np.clip(direction * wanted, braking, driving)
        change = self.limits.acceleration_m_s2 * dt_s
        ramp = np.clip(aim, before - change, before + change)
        # Where the ground gives way the bound applies at once; the ramp is for the wanted speed.
        self._rim_m_s = ramp if holds_slip else direction * np.clip(direction * ramp, braking, driving)
        return self._rim_m_s

    def _travel_m_s(self, speed_m_s: float, yaw_rate_rad_s: float) -> np.ndarray:
        """Speeds [m/s] of the driven wheels' centres along the wheels."""
        motion = np.zeros(self.robot.freedoms)
        motion[0], motion[-1] = speed_m_s, yaw_rate_rad_s
        return np.asarray(self.robot.rolling[: self.robot.driven] @ motion)
