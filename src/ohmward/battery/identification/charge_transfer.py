"""Ohmic drop of a battery whose chemistry says how charge transfer bends it: lead-acid.

Transfer of charge follows Butler and Volmer, i = 2 i_0 sinh(F V / 2RT) with equal coefficients: a current three times
as large takes less than three times the voltage. Where one electrode takes most of the drop it is
V_t asinh(R_0 i / V_t) with V_t = 2RT / F for each cell, and nothing is sought; where conduction does, it is R_0 i. The
logs choose.
"""

from __future__ import annotations

from ohmward.battery.identification.circuit_fit import CircuitFit, fit_circuit
from ohmward.battery.identification.circuit_solve import CircuitProblem
from ohmward.battery.models.temperature import KELVIN
from ohmward.logs.log import Note

_GAS_J_PER_MOL_K, _FARADAY_C_PER_MOL = 8.314462618, 96485.33212
#: A bent drop is taken where it leaves less than this share of the squared residuals of a straight one: 0.25 to 0.56 in
#: pulses, low-rate tests and drives of cells with this law, 1.15 to 2.4 of a measured and a simulated battery without.
#: The evidence does not tell: its robust weights take the pulses that a straight drop misses for outliers.
_CLEARLY_LESS = 0.8


def cells_transfer_V(reference_degC: float, n_series: int) -> float:
    """V_t of cells in series [V]."""
    return n_series * 2 * _GAS_J_PER_MOL_K * (reference_degC + KELVIN) / _FARADAY_C_PER_MOL


def try_bent(problem: CircuitProblem, straight: CircuitFit, n_series: int) -> tuple[CircuitFit, Note]:
    """The fit with a bent drop where the logs clearly show it, else the straight one; a note on it."""
    transfer_V = cells_transfer_V(problem.reference_degC, n_series)
    near = straight.solution.rates._replace(transfer_V=transfer_V)
    bent = fit_circuit(problem._replace(transfer_V=transfer_V), len(near.tau_s), near=(near,))
    left = bent.solution.misfit / straight.solution.misfit
    found = (
        f"one bent by charge transfer ({transfer_V:.2g} V) leaves {left:.0%} of the squared residuals of a straight one"
    )
    if left < _CLEARLY_LESS:
        return bent, Note(f"ohmic drop: {found}, and is taken")
    return straight, Note(f"ohmic drop: straight; {found}")
