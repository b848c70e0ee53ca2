"""Errata of the RC model in [T] 3.2 to 3.4 and [P] 2.2: each form against the circuit itself."""

from __future__ import annotations

import numpy as np

from ohmward.battery.models import rc
from ohmward_lab.reproduce.row import Erratum, differs

#: A circuit with unequal branches, that of [P]; one with R_b = R_s, that of [T]; state, current [A] and short step [s].
_UNEQUAL = rc.Circuit(9000.0, 40.0, 0.09, 0.06, 0.05)
_EQUAL = rc.Circuit(9000.0, 40.0, 0.07, 0.07, 0.05)
_X = np.array([12.5, 12.3])
_CURRENT_A = -2.0
_SHORT_S = 1e-4
#: D [ohm] for which the frozen step of 3.4.2 loses the shares that the table of errata names, with steps of 1 s.
_FROZEN_D_OHM = 0.11


def _rate_V_per_s(p: rc.Circuit) -> float:
    """dV/dt [V/s] at constant current, from the circuit: central difference of the exact step."""
    ahead = rc.voltage(rc.next_state(_X, _CURRENT_A, p, _SHORT_S), _CURRENT_A, p)[0]
    return float((ahead - rc.voltage(_X, _CURRENT_A, p)[0]) / _SHORT_S)


def _branch_resistance() -> bool:
    """(3.1): R_t and two branches R_e in parallel, by Kirchhoff's laws for a current of 1 A into dead capacitors."""
    p = _EQUAL
    node = np.array([[1 / p.r_bulk_ohm + 1 / p.r_surface_ohm]])
    true = p.r_terminal_ohm + float(np.linalg.solve(node, np.array([1.0]))[0])
    return differs(p.r_terminal_ohm + p.r_bulk_ohm, float(rc.instant_resistance(p)), true, 1e-12)


def _t_rate(p: rc.Circuit, base_V: float, current_factor: float) -> float:
    """Right-hand side of (3.2) [V/s] with this voltage in place of V_cs or V_t, and this factor of the current."""
    g = 0.5 / p.r_bulk_ohm
    mixed = g * p.r_terminal_ohm * (1 / p.c_surface_F - 1 / p.c_bulk_F)
    return g * (1 / p.c_bulk_F - 1 / p.c_surface_F) * (base_V - _X[0]) + (current_factor + mixed) * _CURRENT_A


def _terminal_voltage() -> bool:
    """(3.2): V_cs on the right-hand side against V_t."""
    p, V = _EQUAL, float(rc.voltage(_X, _CURRENT_A, _EQUAL)[0])
    half = 0.5 / p.c_surface_F
    return differs(_t_rate(p, _X[1], half), _t_rate(p, V, half), _rate_V_per_s(p), 1e-4)


def _current_factor() -> bool:
    """(3.2): 1/(2 R_e C_s) against 1/(2 C_s)."""
    p, V = _EQUAL, float(rc.voltage(_X, _CURRENT_A, _EQUAL)[0])
    printed = _t_rate(p, V, 0.5 / (p.r_bulk_ohm * p.c_surface_F))
    return differs(printed, _t_rate(p, V, 0.5 / p.c_surface_F), _rate_V_per_s(p), 1e-4)


def _jump() -> bool:
    """f_3 in (3.6): a step of the current moves V at once, by (R_t + R_e/2) times it."""
    p = _EQUAL
    true = float((rc.voltage(_X, _CURRENT_A, p) - rc.voltage(_X, 0.0, p))[0])
    return differs(0.0, _CURRENT_A * (p.r_terminal_ohm + p.r_bulk_ohm / 2), true, 1e-12)


def _charge_sign() -> bool:
    """(3.52): the charge of both capacitors rises by i dt, so that SoC does with + i dt / Q."""
    p = _UNEQUAL
    after = rc.next_state(_X, _CURRENT_A, p, 10.0)
    true = float(p.c_bulk_F * (after[0] - _X[0]) + p.c_surface_F * (after[1] - _X[1]))
    return differs(-10.0 * _CURRENT_A, 10.0 * _CURRENT_A, true, 1e-9)


def _frozen_loss(c_surface_F: float) -> float:
    """Share of the charge that a first step of 1 s loses where each capacitor takes the other's voltage as constant."""
    p = rc.Circuit(9000.0, c_surface_F, 0.5 * _FROZEN_D_OHM, 0.5 * _FROZEN_D_OHM, 0.05)
    stored = 0.0
    for own_F, other_ohm in ((p.c_bulk_F, p.r_surface_ohm), (p.c_surface_F, p.r_bulk_ohm)):
        stored += own_F * other_ohm * -np.expm1(-1.0 / (_FROZEN_D_OHM * own_F))
    return 1.0 - float(stored)


def _frozen_partner() -> bool:
    """3.4.2: the frozen step loses charge, the exact step of the pair none."""
    p = rc.Circuit(9000.0, 10.0, 0.5 * _FROZEN_D_OHM, 0.5 * _FROZEN_D_OHM, 0.05)
    rest = np.array([12.0, 12.0])
    moved = rc.next_state(rest, 1.0, p, 1.0) - rest
    exact = abs(p.c_bulk_F * moved[0] + p.c_surface_F * moved[1] - 1.0) < 1e-9
    return bool(exact and 0.005 < _frozen_loss(300.0) < 0.015 and 0.15 < _frozen_loss(10.0) < 0.19)


def _p_rate(p: rc.Circuit, last_ohm: float, sign: float = 1.0) -> float:
    """A31 V_cb + A33 V + B31 i [V/s] of [P] 2.2, with this resistance in R_s R_t of B31, and this sign of A33."""
    V, D = float(rc.voltage(_X, _CURRENT_A, p)[0]), p.r_bulk_ohm + p.r_surface_ohm
    A33 = p.r_surface_ohm / (p.c_bulk_F * p.r_bulk_ohm * D) - sign / (p.c_surface_F * D)
    B31 = (
        p.r_bulk_ohm**2 / (p.c_surface_F * D**2)
        - p.r_surface_ohm * last_ohm / (p.c_bulk_F * p.r_bulk_ohm * D)
        + p.r_terminal_ohm / (p.c_surface_F * D)
        + p.r_surface_ohm * p.r_bulk_ohm / (p.c_surface_F * D**2)
    )
    return A33 * (V - _X[0]) + B31 * _CURRENT_A


def _b31() -> bool:
    """B31: R_s R_s against R_s R_t; a surface as large as the bulk, so that the term shows."""
    p = _UNEQUAL._replace(c_bulk_F=60.0)
    return differs(_p_rate(p, p.r_surface_ohm), _p_rate(p, p.r_terminal_ohm), _rate_V_per_s(p), 1e-3)


def _a33() -> bool:
    """A33 and A31: the lost minus sign."""
    p = _UNEQUAL
    return differs(_p_rate(p, p.r_terminal_ohm, -1.0), _p_rate(p, p.r_terminal_ohm), _rate_V_per_s(p), 1e-3)


def _one_sign() -> bool:
    """A charge raises the voltage of the RC model and of its Thevenin circuit alike, with one sign of the current."""
    after = rc.next_state(_X, 1.0, _UNEQUAL, 10.0) - rc.next_state(_X, 0.0, _UNEQUAL, 10.0)
    return bool((after > 0).all() and rc.instant_resistance(_UNEQUAL) > 0 and rc.slow_resistance(_UNEQUAL) > 0)


ERRATA = (
    Erratum("[T]", "(3.1)", "the resistor of the parallel branches enters as R_e", "R_e / 2", _branch_resistance),
    Erratum("[T]", "(3.2), f_3 in (3.6)", "V_cs on the right-hand side", "the terminal voltage V_t", _terminal_voltage),
    Erratum("[T]", "(3.2), f_3 in (3.6)", "factor 1/(2 R_e C_s) of the current", "1/(2 C_s)", _current_factor),
    Erratum("[T]", "f_3 in (3.6)", "di/dt = 0 at every step", "V jumps by (R_t + R_e/2) di", _jump),
    Erratum(
        "[T]", "3.2, (3.52)", "minus here, plus in 3.4.2 for the same charge", "one sign: i > 0 charges", _charge_sign
    ),
    Erratum(
        "[T]",
        "3.4.2",
        "each capacitor steps with its partner frozen: loses up to 17 % of a step's charge",
        "the exact step of the pair",
        _frozen_partner,
    ),
    Erratum("[P]", "2.2, B31", "R_s R_s", "R_s R_t", _b31),
    Erratum("[P]", "2.2, A31, A33", "minus signs lost", "A33 = R_s/(C_b R_b D) - 1/(C_s D), A31 = -A33", _a33),
    Erratum(
        "[P]",
        "2.2 against 2.3",
        "RC and Thevenin model count current with opposite signs",
        "one: i > 0 charges",
        _one_sign,
    ),
)
