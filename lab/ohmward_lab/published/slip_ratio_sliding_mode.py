"""Sliding mode on the slip ratio: the law of [T] 5.3, corrected, to compare with; `sliding_mode` is the one to use.

dlambda/dt = f + B tau,   V = max(r omega, v)
B = r (1 - max(lambda, 0)) / (J V)
f = -(1 + min(lambda, 0)) dv/dt / V - r^2 (1 - max(lambda, 0)) F / (J V)
tau = [ -f_hat + dlambda_d/dt - k sat((lambda - lambda_d) / phi) ] / B_hat
k = beta (df + eta) + (beta - 1) |-f_hat + dlambda_d/dt|,   phi = max(phi_0, k max(T, 5 dt))

In the text that we worked from, B lacks 1 - lambda (5.26), f_hat has the wrong sign and B_hat^-1 stands twice
(5.33-5.35), sat is 1 inside the layer (5.47). B vanishes for a wheel that spins at standstill and all of it grows
without bound towards V = 0: floors hold both away from zero here. The gain k grows as 1/V; a layer of one width, which
[T] has, is then too thin for a slow wheel, and the torque cycles from step to step. A layer that follows its gain
(Slotine and Li) starts from rest too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_each_not_negative, require_each_positive
from ohmward.trace import clip, maximum, minimum
from ohmward.traction.control.signals import DrivenWheel
from ohmward.traction.control.sliding_mode import STEPS_PER_TIME_CONSTANT, Uncertainty
from ohmward.traction.control.slip_law import Motion, NoMemory

#: The least 1 - lambda that the law divides by.
LEAST_REMAINDER = 0.05


class SlipDynamics(NamedTuple):
    """dlambda/dt = f + B tau with the believed force; f [1/s], B [1/(N m s)]; `f_error` bounds f - f_hat."""

    slip_ratio: Any
    f: Any
    B: Any
    f_error: Any


@dataclass(frozen=True)
class SlipRatioSlidingMode:
    """Settings of the law."""

    uncertainty: Uncertainty  #: that the gain has to outweigh
    reaching_per_s: float = 1.0  #: eta, > 0
    layer: float = 0.02  #: phi_0, least layer as a slip ratio, > 0
    floor_m_s: float = 0.05  #: least V, > 0
    #: T, of the slip inside the layer, >= 0; 0 and steps of no time leave the layer at phi_0
    time_constant_s: float = 0.005

    def __post_init__(self) -> None:
        require_each_positive("slip_ratio_sliding_mode.", self, "reaching_per_s", "layer", "floor_m_s")
        require_each_not_negative("slip_ratio_sliding_mode.", self, "time_constant_s")

    def init(self, zero: Any) -> NoMemory:
        """The law has no memory."""
        return NoMemory()

    def torque_Nm(self, memory: NoMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        d = self.dynamics(motion, wheel)
        beta = self.uncertainty.inertia_factor
        u = -d.f + motion.target_rate_per_s
        k = beta * (d.f_error + self.reaching_per_s) + (beta - 1) * abs(u)
        layer = maximum(self.layer, k * maximum(self.time_constant_s, STEPS_PER_TIME_CONSTANT * motion.dt_s))
        return (u - k * clip((d.slip_ratio - motion.slip_target) / layer, -1.0, 1.0)) / d.B

    def remember(self, memory: NoMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> NoMemory:
        """The same: the law has no memory."""
        return memory

    def dynamics(self, motion: Motion, wheel: DrivenWheel) -> SlipDynamics:
        """f, B and the bound of f, with V and 1 - lambda held away from zero."""
        r, J, unsure = wheel.radius_m, wheel.inertia_kg_m2, self.uncertainty
        V = maximum(maximum(motion.rim_m_s, motion.travel_m_s), self.floor_m_s)
        slip = (motion.rim_m_s - motion.travel_m_s) / V
        grip, skid = maximum(1 - maximum(slip, 0.0), LEAST_REMAINDER), 1 + minimum(slip, 0.0)
        f = -(skid * motion.acceleration_m_s2 + r * r * grip * motion.force_N / J) / V
        beta = unsure.inertia_factor
        by_force = r * r * grip * (beta * unsure.force_N + (beta - 1) * abs(motion.force_N)) / J
        return SlipDynamics(slip, f, r * grip / (J * V), (abs(skid) * unsure.acceleration_m_s2 + by_force) / V)
