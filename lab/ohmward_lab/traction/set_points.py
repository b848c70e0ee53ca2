"""Set points of slip: the one of the largest force, and the one of the least energy, which is smaller.

The share of the wheel's power that moves the robot against a load is (1 - lambda) (1 - R/F), with the wheel's rolling
resistance R. More slip gives more force and wastes more of it, so the best slip lies below the peak.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.errors import InputError
from ohmward.traction.friction.law import TractionLaw, contact

_GRID = 400
_LARGEST_SLIP_RATIO = 0.999
_GOLDEN = (5**0.5 - 1) / 2


class Peak(NamedTuple):
    """Largest force of the ground, and the slip of it."""

    slip_ratio: float
    slip_speed_m_s: float
    force_N: float


class BestSlip(NamedTuple):
    """Slip of the least energy, the force there, and the share of the wheel's power that moves the robot."""

    slip_ratio: float
    force_N: float
    efficiency: float


def peak(law: TractionLaw, load_N: float, travel_speed_m_s: float) -> Peak:
    """The largest force of a driving wheel at this travel speed; at the end of the range where a law has no peak."""
    _check(load_N, travel_speed_m_s)
    slip, force_N = maximize(lambda slip: driving_force(law, slip, load_N, travel_speed_m_s))
    return Peak(slip, travel_speed_m_s * slip / (1 - slip), force_N)


def best_slip(law: TractionLaw, load_N: float, resistance_N: float, travel_speed_m_s: float) -> BestSlip:
    """The slip at which a driving wheel turns the largest share of its power into pull.

    Raises:
        InputError: the ground does not even give the force that the resistance takes.
    """
    _check(load_N, travel_speed_m_s)
    require_between("resistance_N", resistance_N, 0.0, np.inf)

    def efficiency(slip: Any) -> Any:
        force_N = driving_force(law, slip, load_N, travel_speed_m_s)
        return (1 - slip) * (1 - resistance_N / np.maximum(force_N, 1e-12))

    slip, share = maximize(efficiency)
    force_N = float(driving_force(law, slip, load_N, travel_speed_m_s))
    if force_N <= resistance_N:
        raise InputError(f"resistance_N must be below what the ground gives ({force_N:g} N), got {resistance_N:g}")
    return BestSlip(slip, force_N, share)


def driving_force(law: TractionLaw, slip_ratio: Any, load_N: float, travel_speed_m_s: float) -> Any:
    """Force [N] at a slip ratio in [0, 1) and a travel speed > 0."""
    return law.force_N(contact(travel_speed_m_s / (1 - slip_ratio), travel_speed_m_s, load_N))


def maximize(f: Callable[[Any], Any]) -> tuple[float, float]:
    """Slip ratio and value of the largest f on (0, 1): a grid, then golden sections around its best point."""
    grid = np.linspace(0.0, _LARGEST_SLIP_RATIO, _GRID + 1)[1:]
    best = int(np.argmax(f(grid)))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)]
    for _ in range(60):
        inner, outer = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        low, high = (low, outer) if f(inner) >= f(outer) else (inner, high)
    return float(low), float(f(low))


def _check(load_N: float, travel_speed_m_s: float) -> None:
    require_positive("load_N", load_N)
    require_positive("travel_speed_m_s", travel_speed_m_s)
