"""The speed of the least energy per metre.

e(v) = (idle + heat) / v + f + c v,     so v* = sqrt((idle + heat) / c)

Idle power and the heat of the windings, which the force sets and not the speed, ask for haste; resistance that grows
with speed asks for patience. What one speed saves against another is linear in the coefficients, so its standard
deviation is exact: s = (idle + heat) (1/v - 1/v*) + c (v - v*).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.checks import require_between, require_positive
from ohmward.energy.consumption import SHARED, Consumption
from ohmward.errors import InputError

_IDLE, _SPEED = SHARED.index("idle_W"), SHARED.index("speed_N_s_per_m")

#: Idle power dominates where it takes more than this share of the energy per metre.
DOMINATES = 0.5


class SpeedAdvice(NamedTuple):
    """What to drive, and what it would save.

    speed_m_s: of the least energy per metre within the limits.
    at_limit: whether the best speed lies at a limit, so that a wider one would save more.
    energy_J_per_m: at that speed.
    saving_J_per_m, saving_std_J_per_m: against the present speed.
    idle_share: of the energy per metre at the present speed.
    idle_dominates: whether that is more than half.
    """

    speed_m_s: float
    at_limit: bool
    energy_J_per_m: float
    saving_J_per_m: float
    saving_std_J_per_m: float
    idle_share: float
    idle_dominates: bool


def speed_advice(
    c: Consumption,
    terrain: str,
    speed_m_s: float,
    limits_m_s: tuple[float, float],
    payload_kg: float = 0.0,
    heat_W: float = 0.0,
) -> SpeedAdvice:
    """Advice for level ground of this terrain.

    speed_m_s: present speed, > 0.
    limits_m_s: slowest and fastest speed that may be advised.
    heat_W: of the windings at the steady force, where it is known and not part of what was learned.

    Raises:
        InputError: a terrain that is not known, a speed or limits that are not > 0, limits that do not ascend.
    """
    _check(c, terrain, speed_m_s, limits_m_s, heat_W)
    loaded = (c.prior.mass_kg + payload_kg) / c.prior.mass_kg
    force_N = loaded * c.mean[c.force_index(terrain)]
    haste_W, drag = max(c.mean[_IDLE], 0.0) + heat_W, loaded * max(c.mean[_SPEED], 0.0)
    best = best_speed(haste_W, drag, limits_m_s)
    x = np.zeros(len(c.mean))
    x[_IDLE], x[_SPEED] = 1 / speed_m_s - 1 / best, loaded * (speed_m_s - best)
    now = haste_W / speed_m_s + force_N + drag * speed_m_s
    idle_share = (haste_W - heat_W) / speed_m_s / now
    return SpeedAdvice(
        best,
        best in limits_m_s,
        haste_W / best + force_N + drag * best,
        float(x @ c.mean + heat_W * x[_IDLE]),
        float(np.sqrt(x @ c.cov @ x)),
        float(idle_share),
        bool(idle_share > DOMINATES),
    )


def best_speed(haste_W: float, drag_N_s_per_m: float, limits_m_s: tuple[float, float]) -> float:
    """v* [m/s] within the limits."""
    slowest, fastest = limits_m_s
    if drag_N_s_per_m <= 0.0:
        return fastest
    return float(np.clip(np.sqrt(haste_W / drag_N_s_per_m), slowest, fastest))


def _check(c: Consumption, terrain: str, speed_m_s: float, limits_m_s: tuple[float, float], heat_W: float) -> None:
    if terrain not in c.terrains:
        raise InputError(f"terrain must be one of {', '.join(c.terrains)}; got {terrain!r}")
    require_positive("speed_m_s", speed_m_s)
    require_positive("limits_m_s", limits_m_s)
    require_between("heat_W", heat_W, 0.0, np.inf)
    if not limits_m_s[0] < limits_m_s[1]:
        raise InputError(f"limits_m_s must ascend, got {limits_m_s[0]:g} and {limits_m_s[1]:g}")
