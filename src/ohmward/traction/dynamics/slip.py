"""Slip speed and slip ratio ([T] 4.1).

s = r omega - v,   lambda = s / max(|r omega|, |v|)

Both have the sign of the force along x. Driving forwards lambda is in (0, 1], braking in [-1, 0); where rim and travel
oppose each other |lambda| is above 1, up to 2. Below a speed floor the ratio is undefined: nan, not a number to trust.
"""

from typing import Any

import numpy as np

from ohmward.trace import maximum, where

#: Below this speed [m/s] a reported slip ratio would be noise over noise.
REPORT_FLOOR = 0.02


def slip_ratio(rim_speed_m_s: Any, travel_speed_m_s: Any, floor_m_s: float = REPORT_FLOOR) -> Any:
    """Slip speed over the larger of the two speeds; nan where both are below the floor."""
    speed = maximum(abs(rim_speed_m_s), abs(travel_speed_m_s))
    ratio = (rim_speed_m_s - travel_speed_m_s) / maximum(speed, floor_m_s)
    return where(speed < floor_m_s, np.nan, ratio)


def driving_slip_ratio(rim_speed_m_s: Any, travel_speed_m_s: Any) -> Any:
    """The slip ratio, positive driving and negative braking in reverse too."""
    return travel_direction(rim_speed_m_s, travel_speed_m_s) * slip_ratio(rim_speed_m_s, travel_speed_m_s)


def travel_direction(rim_speed_m_s: Any, travel_speed_m_s: Any) -> Any:
    """1 forwards, -1 in reverse: the direction of the larger of the two speeds, of travel where they are equal."""
    faster = where(abs(rim_speed_m_s) > abs(travel_speed_m_s), rim_speed_m_s, travel_speed_m_s)
    return where(faster >= 0, 1.0, -1.0)
