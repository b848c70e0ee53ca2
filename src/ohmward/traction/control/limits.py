"""Limits of a drive: torque, and its rate of change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ohmward.checks import require_each_positive
from ohmward.trace import clip
from ohmward.traction.robot.motor import Motor

#: A torque [N m] that differs by less from the one asked for is that torque.
SAME_TORQUE = 1e-9


@dataclass(frozen=True)
class Limits:
    """Limits of the torque at the wheel."""

    torque_Nm: float  #: largest size, > 0
    rate_Nm_per_s: float = 5000.0  #: largest rate of change, > 0

    def __post_init__(self) -> None:
        require_each_positive("limits.", self, "torque_Nm", "rate_Nm_per_s")

    @classmethod
    def of_current(cls, motor: Motor, current_A: float, rate_A_per_s: float) -> Limits:
        """The limits of a drive that limits current and its change."""
        constant = motor.wheel_constant_Nm_per_A
        return cls(constant * current_A, constant * rate_A_per_s)

    def apply(self, demanded_Nm: Any, before_Nm: Any, dt_s: Any) -> Any:
        """The torque nearest to the demanded one that may follow `before_Nm`, which is within the limits."""
        change = self.rate_Nm_per_s * dt_s
        return clip(clip(demanded_Nm, before_Nm - change, before_Nm + change), -self.torque_Nm, self.torque_Nm)


def limited(demanded_Nm: Any, torque_Nm: Any) -> Any:
    """True where the torque differs from the demanded one."""
    return abs(demanded_Nm - torque_Nm) > SAME_TORQUE
