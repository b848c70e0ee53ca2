"""The RC model (Saft), a bulk and a surface capacitor behind resistors ([T] 3.2, [P] 2.2), as a Thevenin circuit.

Bulk capacitor C_b behind R_b, surface capacitor C_s behind R_s, both behind R_t. With D = R_b + R_s, C = C_b + C_s,
s = C_s / C and the charge q since the start, its voltage is exactly that of a Thevenin circuit with one RC pair:

    V = V_start + q / C + R_1 F[i] + R_0 i        F a first-order filter of gain 1 and time constant tau
    R_0 = R_t + R_b R_s / D      R_1 = (R_b - s D)^2 / D      tau = s (1 - s) C D

where the OCV curve stands in place of the straight line V_start + q / C. So a battery of five elements is filtered and
identified as a Thevenin circuit; the steps in the elements' own states, as published, are those of `rc_circuit`.

No test can separate the five elements: the voltage depends on four numbers only. [T] and [P] resolve this by R_b = R_s;
where that would make R_t negative (a slow, large C_s), R_t is the 0.625 R_0 of the rule in [P], and R_b > R_s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.one_pair import one_pair
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_each_positive, require_finite
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.quantities import SECONDS_PER_HOUR

#: R_b and R_s as shares of R_total, by the rule of [P] 2.2.
BRANCH_SHARE = 0.75
#: R_t as a share of R_total, by the same rule.
TERMINAL_SHARE = 1 - BRANCH_SHARE / 2


class Circuit(NamedTuple):
    """The five elements of the circuit, floats or traced scalars; the parameters `p` of every function here."""

    c_bulk_F: Any  #: capacitance C_b [F]
    c_surface_F: Any  #: capacitance C_s [F]
    r_bulk_ohm: Any  #: resistance R_b in front of C_b [ohm]
    r_surface_ohm: Any  #: resistance R_s in front of C_s [ohm]
    r_terminal_ohm: Any  #: resistance R_t in front of both [ohm]


@dataclass(frozen=True)
class RcModel:
    """Parameters of the RC model of one cell or pack, and the curve that links it to state of charge."""

    #: capacitances [F], > 0
    c_bulk_F: float
    c_surface_F: float
    #: resistances in front of the capacitors [ohm], > 0
    r_bulk_ohm: float
    r_surface_ohm: float
    r_terminal_ohm: float  #: resistance in front of both [ohm], > 0
    ocv: OcvCurve  #: open-circuit voltage of the same cell or pack
    capacity_Ah: float  #: charge between full and empty, > 0
    #: the resistances grow with exp(activation_K (1/T - 1/T_reference)), the reference being that of the curve; the
    #: time constant grows by the same factor
    activation_K: float = 0.0

    def __post_init__(self) -> None:
        require_each_positive("rc.", self, *Circuit._fields, "capacity_Ah")
        require_finite("rc.activation_K", self.activation_K)
        if self.r_surface_ohm * self.c_surface_F > self.r_bulk_ohm * self.c_bulk_F:
            raise InputError(
                f"rc: the surface must follow faster than the bulk, r_surface_ohm * c_surface_F <= r_bulk_ohm * "
                f"c_bulk_F, got {self.r_surface_ohm * self.c_surface_F:g} s > {self.r_bulk_ohm * self.c_bulk_F:g} s; "
                "exchange the two branches"
            )

    @property
    def circuit(self) -> Circuit:
        """The five elements alone."""
        return Circuit(*(getattr(self, name) for name in Circuit._fields))

    @property
    def capacity_As(self) -> float:
        """Capacity in ampere seconds."""
        return SECONDS_PER_HOUR * self.capacity_Ah


def divider(p: Circuit | RcModel) -> tuple[Any, Any]:
    """R_b / D and R_s / D; a half each, without a division, where both are the very same object, as in [T]."""
    if p.r_bulk_ohm is p.r_surface_ohm:
        return 0.5, 0.5
    per_D = 1 / (p.r_bulk_ohm + p.r_surface_ohm)
    return p.r_bulk_ohm * per_D, p.r_surface_ohm * per_D


def instant_resistance(p: Circuit | RcModel) -> Any:
    """R_t + R_b R_s / D [ohm]: what a sudden change of current sees."""
    return p.r_terminal_ohm + p.r_surface_ohm * divider(p)[0]


def slow_resistance(p: Circuit | RcModel) -> Any:
    """R_1 = (R_b - s D)^2 / D [ohm], s = C_s / (C_b + C_s): seen by a steady current in addition."""
    D = p.r_bulk_ohm + p.r_surface_ohm
    uneven = p.r_bulk_ohm - p.c_surface_F / (p.c_bulk_F + p.c_surface_F) * D
    return uneven * uneven / D


def dc_resistance(p: Circuit | RcModel) -> Any:
    """R_0 + R_1 [ohm]: the resistance to a steady current."""
    return instant_resistance(p) + slow_resistance(p)


def four_numbers(p: Circuit | RcModel) -> tuple[Any, Any, Any, Any]:
    """C = C_b + C_s [F], R_0 and R_1 [ohm] and tau = 1 / `relaxation_rate` [s]: all that the voltage depends on."""
    return p.c_bulk_F + p.c_surface_F, instant_resistance(p), slow_resistance(p), 1 / relaxation_rate(p)


class Nominal(NamedTuple):
    """Elements with R_b = R_s, as in [T]: reference and start of the parameters that are estimated with the state."""

    #: capacitances C_b and C_s [F]
    c_bulk_F: float
    c_surface_F: float
    r_ohm: float  #: R_e = R_b = R_s [ohm]
    r_terminal_ohm: float  #: R_t [ohm]


def nominal_of(model: RcModel) -> Nominal:
    """Elements of the model with R_b = R_s: its own if they are equal, else [P]'s shares of the same DC resistance."""
    if model.r_bulk_ohm == model.r_surface_ohm:
        return Nominal(model.c_bulk_F, model.c_surface_F, model.r_bulk_ohm, model.r_terminal_ohm)
    r_total_ohm = dc_resistance(model) / (1 + BRANCH_SHARE / 2)
    return Nominal(model.c_bulk_F, model.c_surface_F, BRANCH_SHARE * r_total_ohm, TERMINAL_SHARE * r_total_ohm)


def relaxation_rate(p: Circuit | RcModel) -> Any:
    """Rate (1/C_b + 1/C_s) / D [1/s] at which the two capacitors come to the same voltage."""
    return (1 / p.c_bulk_F + 1 / p.c_surface_F) * (1 / (p.r_bulk_ohm + p.r_surface_ohm))


def equivalent_thevenin(model: RcModel) -> Thevenin:
    """The circuit with one RC pair that has the same voltage where the OCV curve is a straight line.

    Its SoC is that of both capacitors together; R_0 = `instant_resistance`, R_1 = `slow_resistance`,
    tau_1 = 1 / `relaxation_rate`.
    """
    _, r0, r1, tau_s = four_numbers(model)
    return Thevenin(
        model.capacity_Ah,
        model.ocv,
        (r0, r0),
        (r0, r0),
        ((r1, r1),),
        (tau_s,),
        activation_K=model.activation_K,
        tau_activation_K=model.activation_K,
        reference_degC=model.ocv.reference_degC,
    )


#: The straight line of a curve is fitted between these states of charge: most curves bend away at the ends.
_LINE_SOC = (0.1, 0.9)


def total_capacitance_F(model: Thevenin) -> float:
    """C_b + C_s that belongs to the best straight line through the curve between 10 and 90 %."""
    soc = np.linspace(*_LINE_SOC, 81)
    slope_V = float(np.polyfit(soc, model.ocv.mean_V(soc, model.reference_degC), 1)[0])
    return model.capacity_As / slope_V


def circuit_by_rule(r_total_ohm: float, tau_s: float, total_F: float) -> Circuit:
    """Circuit by the rule of [P] 2.2: R_b = R_s = 0.75 R_total, R_t = R_total - R_b / 2, C_s = tau / (2 R_s).

    total_F: C_b + C_s, of which C_s is at most half.
    """
    branch = BRANCH_SHARE * r_total_ohm
    c_surface_F = min(tau_s / (2 * branch), 0.5 * total_F)
    return Circuit(total_F - c_surface_F, c_surface_F, branch, branch, TERMINAL_SHARE * r_total_ohm)


def circuit_of(capacitance_F: float, r0: float, r1: float, tau_s: float) -> Circuit:
    """Circuit with these `four_numbers`: with R_b = R_s where that leaves R_t > 0, else with R_t = 0.625 R_0.

    Without a relaxation (R_1 = 0) it has the shares of the rule, and a surface so fast that all resistance is R_0.
    With R_b = R_s = R_e: R_e = 2 (R_1 + tau / C), and s (1 - s) = 1 / (4 (1 + R_1 C / tau)).
    """
    C = capacitance_F
    if r1 == 0.0:
        return circuit_by_rule(r0 / (1 + BRANCH_SHARE / 2), tau_s, C)
    r_e = 2 * (r1 + tau_s / C)
    if r0 > r_e / 2:
        s = 0.5 * (1 - math.sqrt(1 - 1 / (1 + r1 * C / tau_s)))
        return Circuit((1 - s) * C, s * C, r_e, r_e, r0 - r_e / 2)
    return _uneven_circuit(C, (1 - TERMINAL_SHARE) * r0, r1, tau_s, TERMINAL_SHARE * r0)


def rc_of_thevenin(model: Thevenin) -> RcModel:
    """The RC model that is closest to a Thevenin circuit; `equivalent_thevenin` is its inverse for one pair.

    C_b + C_s is the `total_capacitance_F`; the resistances and the time constant are those of `one_pair`.
    """
    alone = one_pair(model)
    circuit = circuit_of(total_capacitance_F(model), alone.r0_discharge_ohm[0], alone.r_ohm[0][0], alone.tau_s[0])
    return RcModel(*circuit, model.ocv, model.capacity_Ah, alone.activation_K)


def _uneven_circuit(C: float, parallel: float, r1: float, tau: float, r_terminal: float) -> Circuit:
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
    return Circuit((1 - s) * C, s * C, a * D, (1 - a) * D, r_terminal)
