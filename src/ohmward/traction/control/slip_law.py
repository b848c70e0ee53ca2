"""Interface of the slip laws: torque from motion, and the memory between steps.

Sliding surface as a slip speed: no division, so it holds at rest.

sigma = r omega - v - lambda_d V_f,   V_f = max(V, v_0, l v_0 - (l - 1) V),   V = max(|r omega|, |v|)

Where V is above the floor v_0 this is V (lambda - lambda_d). Below it a slip speed is held: lambda_d v_0 with l = 1,
and with a launch l > 1 one that starts at l times as much and comes down to lambda_d v_0 at V = v_0. Sigma moves as

d sigma/dt = gain r domega/dt - drift dv/dt - V_f dlambda_d/dt

gain = 1 - lambda_d V_f' sign(r omega) and drift = 1 where the rim is faster, gain = 1 and drift = 1 + lambda_d V_f'
sign(v) where travel is, with V_f' = dV_f/dV. |lambda_d| < 1 and l lambda_d > -1 keep the gain away from zero: spinning
at standstill, where the gain of the slip ratio itself vanishes, is a state like any other.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from ohmward.trace import maximum, where
from ohmward.traction.control.signals import DrivenWheel


class Motion(NamedTuple):
    """Motion of a wheel and its target slip, along the commanded direction: a law knows no reverse."""

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
    torque_before_Nm: Any = None  #:    given in the previous step; None if the torque is free


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


class SlidingSurface(NamedTuple):
    """Distance of a wheel from a slip, and the factors of its rate; speeds in m/s."""

    sigma: Any  #:           distance, > 0 where the slip is too large
    reference_speed: Any  #: V_f
    #:     see the module
    gain: Any
    drift: Any


def surface(rim_m_s: Any, travel_m_s: Any, slip_target: Any, floor_m_s: Any, launch: Any = 1.0) -> SlidingSurface:
    """The surface of a slip ratio in (-1, 1) for these speeds of rim and travel; launch >= 1 for driving."""
    rim, travel = abs(rim_m_s), abs(travel_m_s)
    V = maximum(rim, travel)
    V_f = maximum(V, maximum(floor_m_s, launch * floor_m_s - (launch - 1) * V))
    slope = where(floor_m_s < V, 1.0, 1.0 - launch)
    return SlidingSurface(
        rim_m_s - travel_m_s - slip_target * V_f,
        V_f,
        where(rim >= travel, 1 - slip_target * slope * _sign(rim_m_s), 1.0),
        where(travel > rim, 1 + slip_target * slope * _sign(travel_m_s), 1.0),
    )


def _sign(x: Any) -> Any:
    return where(x >= 0, 1.0, -1.0)


def rim_speed_m_s(travel_m_s: Any, slip_target: Any, floor_m_s: float) -> Any:
    """Speed of the rim on the surface; the robot travels forward, and braking never reverses the wheel."""
    driving = maximum(travel_m_s / (1 - maximum(slip_target, 0.0)), travel_m_s + slip_target * floor_m_s)
    braking = maximum(travel_m_s * (1 + slip_target), 0.0)
    return where(slip_target >= 0, driving, braking)
