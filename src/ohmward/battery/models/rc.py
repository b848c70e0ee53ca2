"""The RC model (Saft): a bulk and a surface capacitor behind resistors ([T] 3.2, [P] 2.2).

With D = R_b + R_s and current i > 0 charging:

    dV_cb/dt = (V_cs - V_cb + R_s i) / (D C_b)
    dV_cs/dt = (V_cb - V_cs + R_b i) / (D C_s)
    V        = (R_s V_cb + R_b V_cs) / D + (R_t + R_b R_s / D) i

State of charge is that of the bulk capacitor: V_cb is an open-circuit voltage, and the OCV curve says which charge it
belongs to ([P] 3.1). The model is linear, and exact only as far as the curve is a straight line.

[T] and [P] also carry V as a third state, driven by V and V_cb under the assumption di/dt = 0. Its deviation from the
output above decays on its own,

    d(V - h)/dt = A33 (V - h),   h = output above,   A33 = R_s / (C_b R_b D) - 1 / (C_s D),

so that V as a state is the output plus a disturbance that decays with time constant -1/A33. `next_state_with_voltage`
steps it so: exactly, and with the jump (R_t + R_b R_s / D) (i_k - i_(k-1)) that di/dt = 0 drops.

No test tells the five elements apart: they stand behind four numbers. [T] and [P] settle it by R_b = R_s; where
that would make R_t negative (a slow, large C_s), R_t is the 0.625 R_0 of the rule in [P], and R_b > R_s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import arrhenius_factor
from ohmward.battery.models.thevenin import Thevenin
from ohmward.checks import require_each_positive, require_finite
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward.trace import minimum
from ohmward.trace.expression import Scalar

#: R_b and R_s as shares of R_total, by the rule of [P] 2.2.
BRANCH_SHARE = 0.75
#: R_t as a share of R_total, by the same rule.
TERMINAL_SHARE = 1 - BRANCH_SHARE / 2

STATE_NAMES = ("bulk_V", "surface_V")
STATE_NAMES_WITH_VOLTAGE = (*STATE_NAMES, "terminal_V")


class Circuit(NamedTuple):
    """The five elements of the circuit, floats or traced scalars; the parameters `p` of every function here."""

    #: capacitances C_b, C_s [F]
    c_bulk_F: Any
    c_surface_F: Any
    #: resistances R_b, R_s in front of them [ohm]
    r_bulk_ohm: Any
    r_surface_ohm: Any
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
    #: the resistances grow with exp(activation_K (1/T - 1/T_reference)), the reference being that of the curve; with
    #: the capacitances the time constant grows as much
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

    def circuit_at(self, temperature_degC: Scalar) -> Circuit:
        """The elements at this temperature."""
        if self.activation_K == 0.0:
            return self.circuit
        factor = arrhenius_factor(temperature_degC, self.activation_K, self.ocv.reference_degC)
        c_bulk, c_surface, r_bulk, r_surface, r_terminal = self.circuit
        even = r_bulk == r_surface  # the very same object, so that a step need not divide them
        bulk_ohm = factor * r_bulk
        return Circuit(c_bulk, c_surface, bulk_ohm, bulk_ohm if even else factor * r_surface, factor * r_terminal)

    @property
    def capacity_As(self) -> float:
        """Capacity in ampere seconds."""
        return 3600.0 * self.capacity_Ah

    def at_rest(self, soc: float) -> np.ndarray:
        """State (2,) of a battery that has rested at `soc`: both capacitors at open-circuit voltage."""
        ocv = self.ocv.mean_V(soc, self.ocv.reference_degC)
        return np.array([ocv, ocv])


def capacitance_for(capacity_Ah: float, ocv: OcvCurve) -> float:
    """C_b + C_s = Q / (OCV(1) - OCV(0)) [F]: the straight line between full and empty holds the capacity.

    Raises:
        InputError: the curve does not rise from SoC 0 to 1.
    """
    span = ocv.voltage_V[-1] - ocv.voltage_V[0]
    if not span > 0:
        raise InputError(f"ocv.voltage_V must rise from SoC 0 to 1 to give a capacitance, but rises by {span:g} V")
    return 3600.0 * capacity_Ah / span


def next_state(x: np.ndarray, current_A: Scalar, p: Circuit | RcModel, dt_s: Scalar) -> np.ndarray:
    """State after `dt_s` of constant current, exact for the coupled pair.

    With the bulk's share of a common elastance, s = (1/C_b) / (1/C_b + 1/C_s), the charge raises the weighted mean
    (1 - s) V_cb + s V_cs by i dt / (C_b + C_s), and the difference d = V_cs - V_cb relaxes at `relaxation_rate` towards
    (R_b - s D) i.

    x: (2,) [V_cb, V_cs] in V.  current_A: mean over the step.  dt_s: >= 0.
    Returns: (2,), the same at the end of the step.
    """
    bulk, surface = x
    d = surface - bulk
    per_bulk, per_surface = 1 / p.c_bulk_F, 1 / p.c_surface_F
    s = per_bulk / (per_bulk + per_surface)
    decay = np.exp(relaxation_rate(p) * -dt_s)
    change = (1 - decay) * ((p.r_bulk_ohm - s * (p.r_bulk_ohm + p.r_surface_ohm)) * current_A - d)
    bulk_next = bulk + s * per_surface * (current_A * dt_s) - s * change
    return np.array([bulk_next, bulk_next + (d + change)])


def voltage(x: np.ndarray, current_A: Scalar, p: Circuit | RcModel) -> np.ndarray:
    """Terminal voltage [V] in state x = [V_cb, V_cs] at the current of this instant, as (1,)."""
    bulk, surface = x
    bulk_share, _ = divider(p)
    return np.array([bulk + bulk_share * (surface - bulk) + instant_resistance(p) * current_A])


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


def next_state_with_voltage(
    x: np.ndarray, before_A: Scalar, mean_A: Scalar, now_A: Scalar, p: Circuit | RcModel, dt_s: Scalar
) -> np.ndarray:
    """State with V as third element after a step, exact; V jumps with the current, which [T] and [P] leave out.

    Where the surface is slower than the bulk (R_s C_s > R_b C_b) V as a state is unstable; the disturbance stays there
    as it is instead of growing.

    x: (3,) [V_cb, V_cs, V] in V.
    before_A, mean_A, now_A: current at the start of the step, its mean over the step, and at the end.
    Returns: (3,), the same at the end of the step.
    """
    after = next_state(x[:2], mean_A, p, dt_s)
    disturbance = x[2] - voltage(x[:2], before_A, p)[0]
    decay = np.exp(minimum(disturbance_rate(p) * dt_s, 0.0))
    return np.array([*after, voltage(after, now_A, p)[0] + decay * disturbance])


def disturbance_rate(p: Circuit | RcModel) -> Any:
    """A33 [1/s], the rate at which V as a state returns to the circuit's output; negative while R_s C_s < R_b C_b."""
    bulk_share, surface_share = divider(p)
    ratio = surface_share / bulk_share
    return (ratio * (1 / p.c_bulk_F) - 1 / p.c_surface_F) * (1 / (p.r_bulk_ohm + p.r_surface_ohm))


def relaxation_rate(p: Circuit | RcModel) -> Any:
    """Rate (1/C_b + 1/C_s) / D [1/s] at which the two capacitors come to the same voltage."""
    return (1 / p.c_bulk_F + 1 / p.c_surface_F) * (1 / (p.r_bulk_ohm + p.r_surface_ohm))


def transition(p: Circuit | RcModel, dt_s: Scalar) -> tuple[np.ndarray, np.ndarray]:
    """F (2, 2) and B (2,) of the exact step x+ = F x + B i, for linear filters."""
    columns = [next_state(e, 0.0, p, dt_s) for e in np.eye(2)]
    return np.column_stack(columns), next_state(np.zeros(2), 1.0, p, dt_s)


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


#: The straight line of a curve is the best one between these states of charge: most curves bend away at the ends.
_LINE_SOC = (0.1, 0.9)


def circuit_by_rule(r_total_ohm: float, tau_s: float, total_F: float) -> Circuit:
    """Circuit by the rule of [P] 2.2: R_b = R_s = 0.75 R_total, R_t = R_total - R_b / 2, C_s = tau / (2 R_s).

    total_F: C_b + C_s, of which C_s is at most half.
    """
    branch = BRANCH_SHARE * r_total_ohm
    c_surface_F = min(tau_s / (2 * branch), 0.5 * total_F)
    return Circuit(total_F - c_surface_F, c_surface_F, branch, branch, TERMINAL_SHARE * r_total_ohm)


def circuit_of(capacitance_F: float, r0: float, r1: float, tau_s: float) -> Circuit:
    """Circuit with these `rc.four_numbers`: with R_b = R_s where that leaves R_t > 0, else with R_t = 0.625 R_0.

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
    return RcModel(*circuit, model.ocv, model.capacity_Ah, mean_activation_K(model))


def mean_activation_K(model: Thevenin) -> float:
    """Activation of all resistances together: the mean of R_0's and the pairs', weighted by their resistances."""
    r0, r1 = float(np.mean(model.r0_discharge_ohm)), float(sum(map(np.mean, model.r_ohm)))
    own_K = model.activation_K if model.pair_activation_K is None else model.pair_activation_K
    return (r0 * model.activation_K + r1 * own_K) / max(r0 + r1, 1e-12)


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
