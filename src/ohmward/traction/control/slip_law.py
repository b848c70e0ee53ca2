"""Interface of the slip laws: torque from motion, and the memory between steps."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from ohmward.traction.control.driven_wheel import DrivenWheel


class Motion(NamedTuple):
    """Motion of a wheel and the slip that it should have, along the commanded direction: a law knows no reverse.

    rim_m_s, travel_m_s: speeds of rim and of the wheel's centre.
    acceleration_m_s2:   of the wheel's centre, as estimated.
    force_N:             of the ground on the wheel, as estimated.
    slip_target:         slip ratio in (-1, 1).
    target_rate_per_s:   its rate of change.
    floor_m_s:           v_0 of the surface, below which a slip speed is held instead of a slip ratio.
    dt_s:                time for which the torque will be held.
    launch:              l of the surface.
    torque_before_Nm:    given in the step before; None where the torque may be any.
    """

    rim_m_s: Any
    travel_m_s: Any
    acceleration_m_s2: Any
    force_N: Any
    slip_target: Any
    target_rate_per_s: Any
    floor_m_s: Any
    dt_s: Any
    launch: Any = 1.0
    torque_before_Nm: Any = None


class SlipLaw(Protocol):
    """A law that holds a slip. Implementations are frozen dataclasses; the memory is a NamedTuple of numbers."""

    def init(self, zero: Any) -> Any:
        """Memory before the first step; `zero` has the shape of the wheels."""
        ...

    def torque_Nm(self, memory: Any, motion: Motion, wheel: DrivenWheel) -> Any:
        """Torque at the wheel without limits."""
        ...

    def remember(self, memory: Any, motion: Motion, demanded_Nm: Any, torque_Nm: Any) -> Any:
        """Memory after a step in which `torque_Nm` was given where the law demanded `demanded_Nm`."""
        ...


class NoMemory(NamedTuple):
    """The memory of a law without one."""
