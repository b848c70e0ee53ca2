"""Slip control with its safety logic: armed by an operator, stopped by any fault; no clock, no thread, no network.

DISARMED --armed at rest, nothing wrong--> ARMED --any fault--> STOPPED --operator disarms--> DISARMED

A fault is an estimate or an operator command that is too old, a speed that is too uncertain, a step of the loop that
comes late, an exception, or a number that is not finite. When stopped, the wheels get no torque, a speed of 0 and no
enable until the operator has disarmed, even if the fault is over.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ohmward.onboard.control.operator_command import SAFE_STOP_S, DriveLimits, OperatorCommand
from ohmward.onboard.control.wheel_control import WheelCommands, WheelControl
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import RobotState
from ohmward.traction.control import ControlFlag
from ohmward.traction.robot.robot import Robot


class DrivePhase(StrEnum):
    """Phase of the drive."""

    DISARMED = "disarmed"
    ARMED = "armed"
    STOPPED = "stopped"


class DriveOutput(NamedTuple):
    """Commands of a step."""

    phase: DrivePhase  #: enable is 1 in `ARMED` only
    reason: str  #: reason for the phase, a few words for the operator
    #: (driven,)
    torque_Nm: np.ndarray
    wheel_speed_rad_s: np.ndarray


class DriveControl:
    """The controller of one robot.

    Args:
        robot: the robot that drives.
        limits: limits of the operator, and timeouts.

    Attributes:
        phase, reason: of the last step.
    """

    def __init__(self, robot: Robot, limits: DriveLimits):
        self.robot, self.limits = robot, limits
        self.phase, self.reason = DrivePhase.DISARMED, "not armed"
        self._wheels = WheelControl(robot, limits)
        self._stepped_s = -np.inf
        self._uncertain_s = 0.0
        self._counter = 0
        self._requested = ""

    def step(self, now_s: float, state: RobotState | None, operator: OperatorCommand | None) -> DriveOutput:
        """Commands for now; never raises.

        state: the newest one, None before the first.
        operator: the newest set-points, None while no operator is connected.
        """
        dt_s, self._stepped_s = now_s - self._stepped_s, now_s
        try:
            commands = self._step(now_s, dt_s, state, operator)
        except Exception as error:
            LOG.exception("slip control: unexpected error")
            self.stop(f"fault of the controller ({type(error).__name__}: {error})")
            commands = None
        if commands is None:
            zero = np.zeros(self.robot.driven)
            return DriveOutput(self.phase, self.reason, zero, zero)
        return DriveOutput(self.phase, self.reason, commands.torque_Nm, commands.wheel_speed_rad_s)

    def stop(self, reason: str) -> None:
        """Stop until the operator has disarmed."""
        if self.phase != DrivePhase.STOPPED:
            LOG.warning("slip control: safe stop, %s", reason)
        self.phase, self.reason = DrivePhase.STOPPED, reason
        self._wheels.reset()

    def request_stop(self, reason: str) -> None:
        """Stop with the next step; may be called from any thread."""
        self._requested = reason

    def numbers(self, output: DriveOutput) -> Mapping[str, float]:
        """Numbers for the drives, by name; the counter goes from 255 back to 0."""
        self._counter = (self._counter + 1) % 256
        found = {"enable": float(output.phase == DrivePhase.ARMED), "counter": float(self._counter)}
        commands = zip(self.robot.driven_wheels, output.torque_Nm, output.wheel_speed_rad_s, strict=True)
        for place, torque, speed in commands:
            found |= {f"torque_Nm.{place}": float(torque), f"wheel_speed_rad_s.{place}": float(speed)}
        return found

    def _step(
        self, now_s: float, dt_s: float, state: RobotState | None, operator: OperatorCommand | None
    ) -> WheelCommands | None:
        """Commands of the wheels; None if they get none."""
        fault = self._fault(now_s, dt_s, state, operator)
        requested, self._requested = self._requested, ""
        if requested:
            self.stop(requested)
            return None
        if self.phase == DrivePhase.ARMED and fault:
            self.stop(fault)
        if operator is not None and not operator.armed and now_s - operator.given_s <= self.limits.operator_timeout_s:
            if self.phase != DrivePhase.DISARMED:
                LOG.info("slip control: disarmed")
            self.phase, self.reason = DrivePhase.DISARMED, "not armed"
            self._wheels.reset()
        elif self.phase == DrivePhase.DISARMED:
            self._arm(fault, operator)
        if self.phase != DrivePhase.ARMED or state is None or state.slip is None or operator is None:
            return None
        command = operator.limited(self.limits)
        found = self._wheels.step(command, state.slip, max(now_s - state.drive_time_s, 0.0), dt_s)
        if not (np.isfinite(found.torque_Nm).all() and np.isfinite(found.wheel_speed_rad_s).all()):
            self.stop("fault of the controller (a command is not a finite number)")
            return None
        uncertain = bool(np.any(np.asarray(found.report.flags, int) & ControlFlag.STALE))
        self._uncertain_s = self._uncertain_s + dt_s if uncertain else 0.0
        if self._uncertain_s > self.limits.estimate_timeout_s:
            self.stop("the speed is too uncertain to control slip")
            return None
        return found

    def _arm(self, fault: str, operator: OperatorCommand | None) -> None:
        """Arm if the operator asks for it, at rest and without a fault; otherwise state the reason."""
        if operator is None:
            self.reason = "no operator"
        elif fault:
            self.reason = fault
        elif not operator.at_rest:
            self.reason = "set speed, turn and slip to 0 to arm"
        else:
            LOG.info("slip control: armed")
            self.phase, self.reason, self._uncertain_s = DrivePhase.ARMED, "", 0.0
            self._wheels.reset()

    def _fault(self, now_s: float, dt_s: float, state: RobotState | None, operator: OperatorCommand | None) -> str:
        """The fault that stops the robot; empty without any."""
        if operator is None:
            return "the operator is gone"
        if not now_s - operator.given_s <= self.limits.operator_timeout_s:
            return f"nothing from the operator for {1e3 * (now_s - operator.given_s):.0f} ms"
        if state is None or state.slip is None:
            return "no estimate of speed and slip"
        if not now_s - state.drive_time_s <= self.limits.estimate_timeout_s:
            return f"the estimate is {1e3 * (now_s - state.drive_time_s):.0f} ms old"
        if self.phase == DrivePhase.ARMED and not 0.0 <= dt_s <= SAFE_STOP_S:
            return f"the control loop was held up for {1e3 * dt_s:.0f} ms"
        return ""
