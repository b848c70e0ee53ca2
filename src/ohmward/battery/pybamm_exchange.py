"""Exchange with PyBaMM and PyBOP: parameter values of their equivalent circuit, data sets and solutions.

Currents > 0 discharge there, and charge here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.battery.battery import Battery, require_battery
from ohmward.battery.models.temperature import KELVIN, coldness_per_K
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs.log import Log
from ohmward.optional import require

#: Thermal mass [J/K] large enough to hold the cell at ambient temperature, since a battery file has no thermal data.
_NO_WARMING_J_K = 1e9
#: Distance from SoC 0 and 1 at the start: PyBaMM's circuit refuses to begin where it would stop.
_INSIDE = 1e-6
#: Smallest resistance [ohm] of an RC pair: its capacitance is the time constant over it.
_LEAST_OHM = 1e-9


def to_pybamm(battery: Battery, soc: float = 1.0, temperature_degC: float = 25.0) -> Any:
    """`pybamm.ParameterValues` of the battery for `pybamm.equivalent_circuit.Thevenin`, as PyBOP takes them too.

    The model wants `options={"number of rc elements": battery.thevenin.pairs}`. Its curve is the mean of the branches:
    hysteresis, the nonlinear ohmic drop of charge transfer and the extra activation at empty have no place there.

    soc: at the start.
    temperature_degC: of the cell and of the ambient air.

    Raises:
        InputError: it is not a battery.
        MissingPackageError: PyBaMM is not installed.
    """
    pybamm = require("pybamm", "the exchange with PyBaMM")
    p = require_battery(battery).thevenin
    curve = p.ocv
    values: dict[str, Any] = {
        "chemistry": "ecm",
        "Initial SoC": min(max(soc, _INSIDE), 1.0 - _INSIDE),
        "Initial temperature [K]": temperature_degC + KELVIN,
        "Ambient temperature [K]": temperature_degC + KELVIN,
        "Cell capacity [A.h]": p.capacity_Ah,
        "Nominal cell capacity [A.h]": p.capacity_Ah,
        "Current function [A]": p.capacity_Ah,
        "Lower voltage cut-off [V]": battery.voltage_min_V,
        "Upper voltage cut-off [V]": battery.voltage_max_V,
        "Cell thermal mass [J/K]": _NO_WARMING_J_K,
        "Cell-jig heat transfer coefficient [W/K]": 1.0,
        "Jig thermal mass [J/K]": _NO_WARMING_J_K,
        "Jig-air heat transfer coefficient [W/K]": 1.0,
        "Entropic change [V/K]": 0.0,
        "RCR lookup limit [A]": 100.0 * p.capacity_Ah,
        "Open-circuit voltage [V]": lambda z: _along(
            pybamm,
            tuple(
                np.add(curve.voltage_V, np.multiply(curve.temperature_V_per_K, temperature_degC - curve.reference_degC))
            ),
            z,
            "OCV",
        ),
        "R0 [Ohm]": lambda T, i, z: (
            _arrhenius(pybamm, p, p.activation_K, T)
            * (
                (i >= 0) * _along(pybamm, p.r0_discharge_ohm, z, "R0")
                + (i < 0) * _along(pybamm, p.r0_charge_ohm, z, "R0c")
            )
        ),
    }
    for j, (row, tau_s) in enumerate(zip(p.r_ohm, p.tau_s, strict=True), start=1):
        values |= _pair(pybamm, p, j, row, tau_s)
    return pybamm.ParameterValues(values)


def to_dataset(log: Log) -> dict[str, np.ndarray]:
    """Columns of a log as PyBaMM and PyBOP name them: `pybop.Dataset(to_dataset(log))`.

    Samples without a current or a voltage are left out.
    """
    measured = np.isfinite(log.current_A) & np.isfinite(log.voltage_V)
    return {
        "Time [s]": log.time_s[measured],
        "Current function [A]": -log.current_A[measured],
        "Voltage [V]": log.voltage_V[measured],
    }


def log_of_solution(solution: Any, name: str = "pybamm") -> Log:
    """Log of a `pybamm.Solution` of any PyBaMM model; a time that two steps share appears once."""
    time_s, first = np.unique(solution["Time [s]"].entries, return_index=True)
    columns = [solution[key].entries[first] for key in ("Current [A]", "Voltage [V]")]
    try:
        temperature = np.asarray(solution["Volume-averaged cell temperature [C]"].entries)[first]
    except KeyError:
        temperature = np.asarray(solution["Cell temperature [degC]"].entries)[first]
    return Log(name, time_s, -columns[0], columns[1], temperature_degC=temperature)


def _pair(pybamm: Any, p: Thevenin, j: int, row: tuple[float, ...], tau_s: float) -> dict[str, Any]:
    """Values of the j-th RC element: its resistance, and the capacitance that gives its time constant."""

    def resistance(T: Any, i: Any, z: Any) -> Any:
        return _arrhenius(pybamm, p, p.activation_of_pairs_K, T) * _along(
            pybamm, tuple(np.maximum(row, _LEAST_OHM)), z, f"R{j}"
        )

    def capacitance(T: Any, i: Any, z: Any) -> Any:
        return tau_s * _arrhenius(pybamm, p, p.tau_activation_K, T) / resistance(T, i, z)

    return {
        f"R{j} [Ohm]": resistance,
        f"C{j} [F]": capacitance,
        f"Element-{j} initial overpotential [V]": 0.0,
    }


def _along(pybamm: Any, values: tuple[float, ...], soc: Any, name: str) -> Any:
    """Values on a uniform grid of SoC as PyBaMM interpolates them."""
    return pybamm.Interpolant(np.linspace(0.0, 1.0, len(values)), np.array(values), soc, name)


def _arrhenius(pybamm: Any, p: Thevenin, activation_K: float, temperature_degC: Any) -> Any:
    """Factor of a resistance or a time constant at a temperature."""
    return pybamm.exp(activation_K * coldness_per_K(temperature_degC, p.reference_degC))
