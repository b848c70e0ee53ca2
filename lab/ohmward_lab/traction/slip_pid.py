"""PID on the slip ratio: the baseline.

tau = K_p e + K_i int e dt + K_d de/dt,   e = -sigma / V_f

The error is that of the slip ratio, taken against v_0 below it; its derivative goes through a lag. The integral stops
while the torque is limited and the error would wind it up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_each_not_negative, require_positive
from ohmward.trace import where
from ohmward.traction.control.signals import DrivenWheel, limited
from ohmward.traction.control.slip_law import Motion, surface


class PidMemory(NamedTuple):
    """Torque of the integral [N m], the last error, its rate [1/s] through the lag."""

    integral_Nm: Any
    error: Any
    rate_per_s: Any


@dataclass(frozen=True)
class SlipPid:
    """Settings of the law."""

    proportional_Nm: float = 30.0  #: K_p, torque per unit of slip ratio, >= 0
    integral_Nm_per_s: float = 1000.0  #: K_i, >= 0
    derivative_Nm_s: float = 0.0  #: K_d, >= 0
    derivative_lag_s: float = 0.005  #: > 0

    def __post_init__(self) -> None:
        require_each_not_negative("slip_pid.", self, "proportional_Nm", "integral_Nm_per_s", "derivative_Nm_s")
        require_positive("slip_pid.derivative_lag_s", self.derivative_lag_s)

    def init(self, zero: Any) -> PidMemory:
        """Nothing integrated, no error yet."""
        return PidMemory(zero, zero, zero)

    def torque_Nm(self, memory: PidMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        error = self.error(motion)
        rate = self.rate_per_s(memory, error, motion.dt_s)
        return self.proportional_Nm * error + memory.integral_Nm + self.derivative_Nm_s * rate

    def remember(self, memory: PidMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> PidMemory:
        """The integral and the error after the step."""
        error = self.error(motion)
        windup = limited(demanded_Nm, torque_Nm) & ((demanded_Nm - torque_Nm) * error > 0.0)
        more = where(windup, 0.0, self.integral_Nm_per_s * error * motion.dt_s)
        return PidMemory(memory.integral_Nm + more, error, self.rate_per_s(memory, error, motion.dt_s))

    def error(self, motion: Motion) -> Any:
        """e: slip ratio that is lacking."""
        here = surface(motion.rim_m_s, motion.travel_m_s, motion.slip_target, motion.floor_m_s, motion.launch)
        return -here.sigma / here.reference_speed

    def rate_per_s(self, memory: PidMemory, error: Any, dt_s: Any) -> Any:
        """de/dt through its lag."""
        change = error - memory.error - memory.rate_per_s * dt_s
        return memory.rate_per_s + change / (self.derivative_lag_s + dt_s)
