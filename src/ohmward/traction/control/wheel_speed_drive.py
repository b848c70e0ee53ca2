"""Speed loop of an ordinary drive: PI from wheel speed to torque, with anti-windup.

tau = K_p e + K_i int e dt,   e = omega_ref - omega

It stands for the motor controller under `wheel_speed_cascade`, and is the baseline that knows nothing of slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_each_positive
from ohmward.trace import where
from ohmward.traction.control.signals import Limits, limited


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
        """No torque."""
        zero = 0.0 * wheel_speed_rad_s
        return DriveState(zero, zero)

    def step(
        self, state: DriveState, reference_rad_s: Any, wheel_speed_rad_s: Any, dt_s: Any
    ) -> tuple[DriveState, Any]:
        """The state after the step and the torque [N m] to hold for the next `dt_s`."""
        error = reference_rad_s - wheel_speed_rad_s
        demanded = self.proportional_Nm_s * error + state.integral_Nm
        torque = self.limits.apply(demanded, state.torque_Nm, dt_s)
        windup = limited(demanded, torque) & ((demanded - torque) * error > 0.0)
        integral = state.integral_Nm + where(windup, 0.0, self.integral_Nm * error * dt_s)
        return DriveState(integral, torque), torque
