"""Speed of least energy per metre.

e(v) = (idle + r F^2) / v + f + c v,  F = F_0 + D v,     so v* = sqrt((idle + r F_0^2) / (c + r D^2))

Idle power and the heat of the windings from the resistance F_0 cost less per metre at a higher speed; resistance that
grows with speed, and its heat, cost more. The saving of one speed over another, s = e(v) - e(v*), is linear in the
coefficients for known forces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.checks import require_one_of, require_positive
from ohmward.energy.consumption import HEAT, IDLE, SPEED, Consumption, design_row, wheel_work_J
from ohmward.energy.leg import Stretch
from ohmward.errors import InputError

#: Idle power dominates where it takes more than this share of the energy per metre.
DOMINATES = 0.5


class SpeedAdvice(NamedTuple):
    """The advised speed, and its saving."""

    speed_m_s: float  #: of least energy per metre within the limits
    at_limit: bool  #: True where the best speed lies at a limit, so that a wider one would save more
    energy_J_per_m: float  #: at that speed
    #: compared with the present speed
    saving_J_per_m: float
    saving_std_J_per_m: float
    idle_share: float  #: of the energy per metre at the present speed
    idle_dominates: bool  #: True where that is more than half


def speed_advice(c: Consumption, terrain: str, speed_m_s: float, limits_m_s: tuple[float, float]) -> SpeedAdvice:
    """Speed advice for level ground of a terrain.

    speed_m_s: present speed, > 0.
    limits_m_s: slowest and fastest speed that may be advised.

    Raises:
        InputError: a terrain that is not known, a speed or limits that are not > 0, limits that do not ascend.
    """
    require_one_of("terrain", terrain, c.terrains)
    require_positive("speed_m_s", speed_m_s)
    require_positive("limits_m_s", limits_m_s)
    slowest, fastest = limits_m_s
    if not slowest < fastest:
        raise InputError(f"limits_m_s must ascend, got {slowest:g} and {fastest:g}")

    def per_metre(v: float) -> np.ndarray:
        return design_row(c, Stretch(terrain, 1 / v, 1.0, v))

    resistance_N, at_1_m_s_N = (wheel_work_J(c, Stretch(terrain, 1.0, 1.0, v)) for v in (0.0, 1.0))  # over 1 m
    heat_W_per_N2 = max(c.mean[HEAT], 0.0)
    standing_W = max(c.mean[IDLE], 0.0) + heat_W_per_N2 * resistance_N**2
    drag = max(c.mean[SPEED], 0.0) * per_metre(1.0)[SPEED] + heat_W_per_N2 * (at_1_m_s_N - resistance_N) ** 2
    best = fastest if drag <= 0.0 else float(np.clip(np.sqrt(standing_W / drag), slowest, fastest))
    now, then = per_metre(speed_m_s), per_metre(best)
    saving = now - then
    idle_share = float(now[IDLE] * c.mean[IDLE] / (now @ c.mean))
    return SpeedAdvice(
        best,
        best in limits_m_s,
        float(then @ c.mean),
        float(saving @ c.mean),
        float(np.sqrt(saving @ c.cov @ saving)),
        idle_share,
        idle_share > DOMINATES,
    )
