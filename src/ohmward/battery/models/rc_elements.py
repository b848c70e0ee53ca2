"""Elements of the RC model from what is known of it: four numbers of its voltage, the rule of [P], a Thevenin circuit.

No test tells the five elements apart: they stand behind four numbers. [T] and [P] settle it by R_b = R_s; where
that would make R_t negative (a slow, large C_s), R_t is the 0.625 R_0 of the rule in [P], and R_b > R_s.
"""

from __future__ import annotations

import math

import numpy as np

from ohmward.battery.models import rc
from ohmward.battery.models.thevenin import Thevenin
from ohmward.optional import require

#: The straight line of a curve is the best one between these states of charge: most curves bend away at the ends.
_LINE_SOC = (0.1, 0.9)


def circuit_by_rule(r_total_ohm: float, tau_s: float, total_F: float) -> rc.Circuit:
    """Circuit by the rule of [P] 2.2: R_b = R_s = 0.75 R_total, R_t = R_total - R_b / 2, C_s = tau / (2 R_s).

    total_F: C_b + C_s, of which C_s is at most half.
    """
    branch = rc.BRANCH_SHARE * r_total_ohm
    c_surface_F = min(tau_s / (2 * branch), 0.5 * total_F)
    return rc.Circuit(total_F - c_surface_F, c_surface_F, branch, branch, rc.TERMINAL_SHARE * r_total_ohm)


def circuit_of(capacitance_F: float, r0: float, r1: float, tau_s: float) -> rc.Circuit:
    """Circuit with these `rc.four_numbers`: with R_b = R_s where that leaves R_t > 0, else with R_t = 0.625 R_0.

    Without a relaxation (R_1 = 0) it has the shares of the rule, and a surface so fast that all resistance is R_0.
    With R_b = R_s = R_e: R_e = 2 (R_1 + tau / C), and s (1 - s) = 1 / (4 (1 + R_1 C / tau)).
    """
    C = capacitance_F
    if r1 == 0.0:
        return circuit_by_rule(r0 / (1 + rc.BRANCH_SHARE / 2), tau_s, C)
    r_e = 2 * (r1 + tau_s / C)
    if r0 > r_e / 2:
        s = 0.5 * (1 - math.sqrt(1 - 1 / (1 + r1 * C / tau_s)))
        return rc.Circuit((1 - s) * C, s * C, r_e, r_e, r0 - r_e / 2)
    return _uneven_circuit(C, (1 - rc.TERMINAL_SHARE) * r0, r1, tau_s, rc.TERMINAL_SHARE * r0)


def rc_of_thevenin(model: Thevenin) -> rc.RcModel:
    """The RC model that is closest to a Thevenin circuit; `rc.equivalent_thevenin` is its inverse for one pair.

    C_b + C_s belongs to the best straight line through the curve between 10 and 90 %; R_0 and the sum of the pairs are
    their means along SoC; the one time constant is the geometric mean of all, weighted by their resistances.
    """
    soc = np.linspace(*_LINE_SOC, 81)
    slope_V = float(np.polyfit(soc, model.ocv.mean_V(soc, model.reference_degC), 1)[0])
    r0, pairs = float(np.mean(model.r0_discharge_ohm)), np.mean(model.r_ohm, axis=1)
    r1 = float(pairs.sum())
    tau_s = math.exp(float(pairs @ np.log(model.tau_s)) / r1)
    circuit = circuit_of(model.capacity_As / slope_V, r0, r1, tau_s)
    return rc.RcModel(*circuit, model.ocv, model.capacity_Ah, mean_activation_K(model))


def mean_activation_K(model: Thevenin) -> float:
    """Activation of all resistances together: the mean of R_0's and the pairs', weighted by their resistances."""
    r0, r1 = float(np.mean(model.r0_discharge_ohm)), float(sum(map(np.mean, model.r_ohm)))
    own_K = model.activation_K if model.pair_activation_K is None else model.pair_activation_K
    return (r0 * model.activation_K + r1 * own_K) / max(r0 + r1, 1e-12)


def _uneven_circuit(C: float, parallel: float, r1: float, tau: float, r_terminal: float) -> rc.Circuit:
    """Elements with R_b R_s / D = `parallel`: the root in s of a (1 - a) D = parallel, a = R_b / D = s + sqrt(R_1 / D).

    The bulk has the larger share: s in (0, s_1], where a reaches 1 and the left side 0.
    """
    brentq = require("scipy.optimize", "identification").brentq

    def shares(s: float) -> tuple[float, float]:
        D = tau / (s * (1 - s) * C)
        return s + math.sqrt(r1 / D), D

    def excess(s: float) -> float:
        a, D = shares(s)
        return a * (1 - a) * D - parallel

    largest = tau / (tau + r1 * C)
    s = float(brentq(excess, 1e-9 * largest, largest))
    a, D = shares(s)
    return rc.Circuit((1 - s) * C, s * C, a * D, (1 - a) * D, r_terminal)
