"""Sliding mode on the slip speed, [T] 5.3 freed of its singularities.

tau = r F_hat + J_hat / (gain r) [ drift a_hat + V_f dlambda_d/dt - k (sigma + k_i I) / Phi ],   I = int sigma dt

with the surface sigma of `surface`. The ground's force enters where the torque does, so the inertia does not scale it,
and the condition sigma dsigma/dt <= -eta |sigma| outside the layer needs

k >= gain r^2 dF / J_hat + (beta - 1) |drift a_hat + V_f dlambda_d/dt| + beta (drift da + eta)

for |F - F_hat| <= dF, |dv/dt - a_hat| <= da, J_hat / beta <= J <= beta J_hat. The layer is as wide as the loop needs:
Phi = k max(T, 5 dt), so that inside it sigma decays with the time constant T, or five steps where those are longer
(Slotine and Li). Outside the layer the textbook's saturation would hold the torque at the least that the condition
needs; here the rate keeps growing as k sqrt(2 |sigma| / Phi - 1), up to the limit of the drive: a spinning wheel is
braked with full torque, and as it slows down the torque returns by k J_hat / r per time constant, no faster, which
takes the least time under a bound on the torque's rate. Away from zero the torque grows at no more than half of that
rate; towards zero it is free. A bias that the layer leaves is removed by the observed force; k_i > 0 removes it where
F_hat is a guess. The integral is frozen while the slip is far from its target: a wheel that spins at 60 m/s for half a
second would leave 30 m in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from ohmward.checks import require_between, require_each_not_negative, require_each_positive
from ohmward.trace import clip, maximum, minimum, sqrt, where
from ohmward.traction.control.signals import DrivenWheel, limited
from ohmward.traction.control.slip_law import Motion, SlidingSurface, surface
from ohmward.traction.friction.law import direction_and_size

#: Steps in the shortest time constant of a sampled loop (Slotine and Li).
STEPS_PER_TIME_CONSTANT = 5.0
#: Largest distance of a slip ratio from its target for the integral: beyond, it is still on its way there, not a bias.
INTEGRAL_REACH = 0.1

#: Time constants in which the torque may grow by the gain's demand: RLMA brakes a spin with its 12 N m after 30 ms
#: instead of 3, and ends it 15 ms later; the torque's change from step to step has half the RMS.
GROWTH_TIME_CONSTANTS = 2.0


@dataclass(frozen=True)
class Uncertainty:
    """Bounds of the errors of a law's model."""

    force_N: float  #: dF, of the ground's force, >= 0
    acceleration_m_s2: float = 1.0  #: da, of the wheel's centre, >= 0
    inertia_factor: float = 1.2  #: beta, the true inertia is within J/beta and J beta, >= 1

    def __post_init__(self) -> None:
        require_each_not_negative("uncertainty.", self, "force_N", "acceleration_m_s2")
        require_between("uncertainty.inertia_factor", self.inertia_factor, 1.0, math.inf)


class SlidingMemory(NamedTuple):
    """Integral of sigma [m]; 0 without integral action."""

    integral_m: Any


@dataclass(frozen=True)
class SlidingMode:
    """Settings of the law."""

    uncertainty: Uncertainty  #: error bounds that the gain has to outweigh
    reaching_m_s2: float = 1.0  #: eta, least rate at which sigma decreases outside the layer, > 0
    time_constant_s: float = 0.005  #: T, of sigma inside the layer, > 0
    integral_per_s: float = 0.0  #: k_i, >= 0

    def __post_init__(self) -> None:
        require_each_positive("sliding_mode.", self, "reaching_m_s2", "time_constant_s")
        require_between("sliding_mode.integral_per_s", self.integral_per_s, 0.0, math.inf)

    def init(self, zero: Any) -> SlidingMemory:
        """Memory with a zero integral."""
        return SlidingMemory(zero)

    def torque_Nm(self, memory: SlidingMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] at the wheel without limits."""
        here = self.surface(motion)
        k = self.gain_m_s2(here, motion, wheel)
        return self.torque_with(k, self.layer_m_s(k, motion.dt_s), memory, motion, wheel)

    def torque_with(self, k: Any, layer_m_s: Any, memory: SlidingMemory, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque [N m] of the law with another gain k [m/s^2] and layer."""
        here = self.surface(motion)
        inertia_kg_m = wheel.inertia_kg_m2 / (here.gain * wheel.radius_m)
        distance = (here.sigma + self.integral_per_s * memory.integral_m) / layer_m_s
        rate = equivalent_rate(here, motion) - k * reaching_share(distance)
        torque_Nm = wheel.radius_m * motion.force_N + inertia_kg_m * rate
        if motion.torque_before_Nm is None:
            return torque_Nm
        growth_Nm = inertia_kg_m * k * k / layer_m_s * motion.dt_s / GROWTH_TIME_CONSTANTS
        before_Nm = motion.torque_before_Nm
        return clip(torque_Nm, minimum(before_Nm, 0.0) - growth_Nm, maximum(before_Nm, 0.0) + growth_Nm)

    def remember(self, memory: SlidingMemory, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> SlidingMemory:
        """The integral grows above the floor and near the target, unless a limited torque would wind it up."""
        here = self.surface(motion)
        outside = abs(here.sigma) > INTEGRAL_REACH * here.reference_speed
        windup = limited(demanded_Nm, torque_Nm) & ((torque_Nm - demanded_Nm) * here.sigma > 0.0)
        integral = memory.integral_m + where(outside | windup, 0.0, here.sigma * motion.dt_s)
        rolling = maximum(abs(motion.rim_m_s), abs(motion.travel_m_s)) > motion.floor_m_s
        return SlidingMemory(where(rolling, integral, 0.0))

    def surface(self, motion: Motion) -> SlidingSurface:
        """The surface of the target slip."""
        return surface(motion.rim_m_s, motion.travel_m_s, motion.slip_target, motion.floor_m_s, motion.launch)

    def gain_m_s2(self, here: SlidingSurface, motion: Motion, wheel: DrivenWheel) -> Any:
        """The smallest k that satisfies the sliding condition."""
        beta = self.uncertainty.inertia_factor
        by_force = here.gain * wheel.radius_m**2 * self.uncertainty.force_N / wheel.inertia_kg_m2
        by_inertia = (beta - 1) * abs(equivalent_rate(here, motion))
        return by_force + by_inertia + beta * (here.drift * self.uncertainty.acceleration_m_s2 + self.reaching_m_s2)

    def layer_m_s(self, k: Any, dt_s: Any) -> Any:
        """Phi for the gain k."""
        return k * maximum(self.time_constant_s, STEPS_PER_TIME_CONSTANT * dt_s)


def reaching_share(distance: Any) -> Any:
    """Rate at which sigma should decrease, over k, at a distance in layers; its slope is continuous."""
    direction, size = direction_and_size(distance)
    return direction * where(size > 1.0, sqrt(2.0 * maximum(size, 1.0) - 1.0), size)


def equivalent_rate(here: SlidingSurface, motion: Motion) -> Any:
    """The gain r domega/dt [m/s^2] that holds sigma constant."""
    return here.drift * motion.acceleration_m_s2 + here.reference_speed * motion.target_rate_per_s
