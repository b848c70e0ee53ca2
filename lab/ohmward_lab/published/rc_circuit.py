"""Step and voltage of the RC circuit in its own states, the voltages of both capacitors ([T] 3.2, [P] 2.2).

With D = R_b + R_s and current i > 0 charging:

    dV_cb/dt = (V_cs - V_cb + R_s i) / (D C_b)
    dV_cs/dt = (V_cb - V_cs + R_b i) / (D C_s)
    V        = (R_s V_cb + R_b V_cs) / D + (R_t + R_b R_s / D) i

The state of charge is that of the bulk capacitor: V_cb is an open-circuit voltage, which the OCV curve maps to SoC
([P] 3.1). The circuit is linear, and exact only as far as the curve is a straight line.

[T] and [P] also carry V as a third state, driven by V and V_cb under the assumption di/dt = 0. Its deviation from the
output above decays on its own,

    d(V - h)/dt = A33 (V - h),   h = output above,   A33 = R_s / (C_b R_b D) - 1 / (C_s D),

so that V as a state is the output plus a disturbance that decays with time constant -1/A33. `next_state_with_voltage`
steps it exactly, with the jump (R_t + R_b R_s / D) (i_k - i_(k-1)) that di/dt = 0 leaves out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.temperature import arrhenius_factor
from ohmward.errors import InputError
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.trace import Scalar, minimum
from ohmward_lab.published.rc import Circuit, RcModel, divider, instant_resistance, relaxation_rate


def capacitance_for(capacity_Ah: float, ocv: OcvCurve) -> float:
    """C_b + C_s = Q / (OCV(1) - OCV(0)) [F]: the straight line between full and empty holds the capacity.

    Raises:
        InputError: the curve does not rise from SoC 0 to 1.
    """
    span = ocv.voltage_V[-1] - ocv.voltage_V[0]
    if not span > 0:
        raise InputError(f"ocv.voltage_V must rise from SoC 0 to 1 to give a capacitance, but rises by {span:g} V")
    return SECONDS_PER_HOUR * capacity_Ah / span


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


def next_state_with_voltage(
    x: np.ndarray, before_A: Scalar, mean_A: Scalar, now_A: Scalar, p: Circuit | RcModel, dt_s: Scalar
) -> np.ndarray:
    """State with V as third element after a step, exact; V jumps with the current, which [T] and [P] leave out.

    Where the surface is slower than the bulk (R_s C_s > R_b C_b) V as a state is unstable; there the disturbance stays
    constant instead of growing.

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


def transition(p: Circuit | RcModel, dt_s: Scalar) -> tuple[np.ndarray, np.ndarray]:
    """F (2, 2) and B (2,) of the exact step x+ = F x + B i, for linear filters."""
    columns = [next_state(e, 0.0, p, dt_s) for e in np.eye(2)]
    return np.column_stack(columns), next_state(np.zeros(2), 1.0, p, dt_s)


def circuit_at(model: RcModel, temperature_degC: Scalar) -> Circuit:
    """The elements at this temperature."""
    if model.activation_K == 0.0:
        return model.circuit
    factor = arrhenius_factor(temperature_degC, model.activation_K, model.ocv.reference_degC)
    c_bulk, c_surface, r_bulk, r_surface, r_terminal = model.circuit
    even = r_bulk == r_surface  # the very same object, so that a step need not divide them
    bulk_ohm = factor * r_bulk
    return Circuit(c_bulk, c_surface, bulk_ohm, bulk_ohm if even else factor * r_surface, factor * r_terminal)


def at_rest(model: RcModel, soc: float) -> np.ndarray:
    """State (2,) of a battery that has rested at `soc`: both capacitors at open-circuit voltage."""
    ocv = model.ocv.mean_V(soc, model.ocv.reference_degC)
    return np.array([ocv, ocv])
