"""Interface of the slip laws: torque from motion, and the memory between steps."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from ohmward.traction.control.driven_wheel import DrivenWheel


class Motion(NamedTuple):
    """Motion of a wheel and the slip that it should have, along the commanded direction: a law knows no reverse."""

    #: speeds of rim and of the wheel's centre
    rim_m_s: Any
    travel_m_s: Any
    acceleration_m_s2: Any  #:   of the wheel's centre, as estimated
    force_N: Any  #:             of the ground on the wheel, as estimated
    slip_target: Any  #:         slip ratio in (-1, 1)
    target_rate_per_s: Any  #:   its rate of change
    floor_m_s: Any  #:           v_0 of the surface, below which a slip speed is held instead of a slip ratio
    dt_s: Any  #:                time for which the torque will be held
    launch: Any = 1.0  #:              l of the surface
    torque_before_Nm: Any = None  #:    given in the step before; None where the torque may be any


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
