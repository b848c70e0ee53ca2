"""The loop of the controller: a thread of its own, so that a blocked process does not delay a safe stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

from ohmward.errors import OhmwardError
from ohmward.onboard.control.drive_control import DriveControl, DriveOutput
from ohmward.onboard.control.operator_command import OperatorCommand
from ohmward.onboard.robot_state import RobotState

#: Number of stop commands that the loop sends at its end.
_LAST_COMMANDS = 3

#: Time without an accepted command after which the drives count as gone [s].
_GONE_S = 1.0

#: Sends numbers to the drives; raises if it cannot.
Send = Callable[[Mapping[str, float]], None]


class ControlLoop(threading.Thread):
    """Steps of a controller at a fixed rate.

    Args:
        control: the controller.
        step_s: time between two steps, > 0.

    Attributes:
        send: sends to the drives, set by `drive`.
        state, operator: the newest ones, to be set from outside.
        output: of the last step.
        error: the one that has ended the loop, None while it runs.
    """

    send: Send

    def __init__(self, control: DriveControl, step_s: float):
        super().__init__(name="slip control", daemon=True)
        self.control, self.step_s = control, step_s
        self.state: RobotState | None = None
        self.operator: OperatorCommand | None = None
        self.output: DriveOutput | None = None
        self.error: Exception | None = None
        self._end = threading.Event()

    def drive(self, send: Send) -> None:
        """Begin to step, and to send to the drives."""
        self.send = send
        self.start()

    def run(self) -> None:
        """Step until the end; the last commands stop the robot."""
        next_s = sent_s = time.monotonic()
        while not self._end.is_set():
            self.output = self.control.step(time.monotonic(), self.state, self.operator)
            try:
                self.send(self.control.numbers(self.output))
                sent_s = time.monotonic()
            except Exception as error:  # a bus that is gone raises all kinds of errors
                self.control.stop(f"the drives take no command ({error})")
                if time.monotonic() - sent_s > _GONE_S:
                    self.error = error
                    return
            next_s = max(next_s + self.step_s, time.monotonic())
            self._end.wait(next_s - time.monotonic())
        self.control.stop("the process ends")
        for _ in range(_LAST_COMMANDS):
            self.output = self.control.step(time.monotonic(), None, None)
            try:
                self.send(self.control.numbers(self.output))
            except Exception as error:  # nobody is left to report to
                self.error = error
                return

    def end(self) -> None:
        """Stop the robot and end the loop."""
        self._end.set()
        if self.is_alive():
            self.join(_GONE_S)

    def check(self) -> None:
        """Raise OhmwardError if the loop has ended by itself."""
        if self.error is not None or not self.is_alive():
            raise OhmwardError(f"the drives take no command ({self.error}); is the bus up?") from self.error
