"""The sliding surface as a slip speed: no division, so it holds at rest.

sigma = r omega - v - lambda_d V_f,   V_f = max(|r omega|, |v|, v_0)

Where V_f is above its floor v_0 this is V (lambda - lambda_d); at rest it asks for the slip speed lambda_d v_0. With
the larger of the two speeds in V_f, sigma moves as

d sigma/dt = gain r domega/dt - drift dv/dt - V_f dlambda_d/dt

gain = 1 - lambda_d sign(r omega) and drift = 1 where the rim is faster, gain = 1 and drift = 1 + lambda_d sign(v) where
travel is, both 1 below the floor. |lambda_d| < 1 keeps the gain away from zero: spinning at standstill, where the gain
of the slip ratio itself vanishes, is a state like any other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ohmward.trace import maximum, where


class Surface(NamedTuple):
    """Where a wheel is with respect to a slip, and how that changes; speeds in m/s.

    sigma:           distance, > 0 where the slip is too large.
    reference_speed: V_f.
    gain, drift:     see the module.
    """

    sigma: Any
    reference_speed: Any
    gain: Any
    drift: Any


def surface(rim_m_s: Any, travel_m_s: Any, slip_target: Any, floor_m_s: Any) -> Surface:
    """The surface of a slip ratio in (-1, 1) for these speeds of rim and travel."""
    rim, travel = abs(rim_m_s), abs(travel_m_s)
    V_f = maximum(maximum(rim, travel), floor_m_s)
    by_rim = (rim >= travel) & (rim > floor_m_s)
    by_travel = (travel > rim) & (travel > floor_m_s)
    return Surface(
        rim_m_s - travel_m_s - slip_target * V_f,
        V_f,
        where(by_rim, 1 - slip_target * _sign(rim_m_s), 1.0),
        where(by_travel, 1 + slip_target * _sign(travel_m_s), 1.0),
    )


def _sign(x: Any) -> Any:
    return where(x >= 0, 1.0, -1.0)
