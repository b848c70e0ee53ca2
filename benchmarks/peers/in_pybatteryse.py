"""State of charge on the cells of TU Eindhoven by the package that their authors wrote for them: PyBatterySE.

Its models are identified by its companion PyBatteryID, from the same records and open-circuit voltages, with the basis
functions, orders and optimizers of its examples; its extended Kalman filter has the variances of its README. Its state
space has no hysteresis, so the model of the LFP cell has none either.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from pybatteryid import ModelStructure
from pybatteryid.identification import identify_model
from pybatteryse import load_filter, load_statespace_representation

from measured_cells import HOUR, TUE, tue_log, tue_start, tue_table
from ohmward.logs import Log
from peers.battery_packages import quiet

#: Variances of the current [A^2] and the voltage [V^2]; at the start of SoC and of each overpotential [V^2].
CURRENT, VOLTAGE, FIRST_SOC, FIRST_OVERPOTENTIAL = 1e-2, 1e-3, 1.0, 0.1
OPTIMIZERS = ["lassocv.sklearn", "ridgecv.sklearn"]


class Example(NamedTuple):
    """The model of one of its examples: table of the open-circuit voltage, basis functions, orders n and l."""

    ocv: str
    basis: list[str]
    order: int
    nonlinearity: int


EXAMPLES = {
    "nmc": Example("ocv_nmc_gitt_data.csv", ["d[0.01,0.99]", "s", "1/s", "log[s]", "exp[0.05*sqrt[|i|]]"], 3, 4),
    "lfp": Example("ocv_lfp_quasi_emf.csv", ["1/s", "log[s]", "s", "exp[0.02*sqrt[|i|]]", "d[0.01,0.99]"], 1, 1),
    "nmc_with_temperature": Example(
        "ocv_nmc_with_temperature_gitt_data.csv",
        ["d[0.01,0.99]", "s", "exp[[0.5*s]]", "exp[0.05*sqrt[|i|]]", "exp[[0.00366*T+1]^-1]"],
        3,
        3,
    ),
}


def estimate(cell: str, tests: tuple[str, ...], log: Log, initial_soc: float) -> tuple[np.ndarray, np.ndarray]:
    """State of charge along a log and its standard deviation, (T,) each, with the model of these records.

    Raises:
        KeyError: the filter misses a coefficient that the optimizer has taken out of the model.
    """
    with quiet():
        model = identified(cell, tests)
        space = load_statespace_representation(model, state_components=["s", "overpotentials"])
        ekf = load_filter(space, "extended_kalman_filter", variance_eta_u=CURRENT, variance_eta_y_e=VOLTAGE)
        mean, cov = ekf.run(
            dataset=_dataset(log),
            initial_state=np.array([initial_soc, *[0.0] * model.model_order]),
            initial_covariance=np.diag([FIRST_SOC, *[FIRST_OVERPOTENTIAL] * model.model_order]),
        )
    return _whole(mean[:, 0], len(log)), _whole(np.sqrt(np.maximum(cov[:, 0, 0], 0.0)), len(log))


@cache
def identified(cell: str, tests: tuple[str, ...]) -> Any:
    """Its model of a cell from these records."""
    example = EXAMPLES[cell]
    structure = ModelStructure(battery_capacity=TUE[cell].capacity_Ah * HOUR, sampling_period=1)
    table = tue_table(example.ocv)
    emf = {"soc_values": table[:, 0], "voltage_values": table[:, 1]}
    if cell == "nmc_with_temperature":
        emf |= {"dVdT_values": table[:, 2], "reference_temperature_value": table[0, 3]}
    structure.add_emf_function(emf)
    structure.add_basis_functions(example.basis)
    logs = {test: tue_log(cell, test) for test in tests}
    records = [
        {"initial_soc": _first_soc(cell, test, log, table), "time_values": log.time_s} | _dataset(log)
        for test, log in logs.items()
    ]
    return identify_model(
        records,
        structure,
        model_order=example.order,
        nonlinearity_order=example.nonlinearity,
        optimizers=OPTIMIZERS,
    )


def _first_soc(cell: str, test: str, log: Log, table: np.ndarray) -> float:
    """State of charge at the start: given, or where it is not, from the first voltage, as its example does."""
    if cell != "nmc_with_temperature":
        return tue_start(cell, test)
    assert log.temperature_degC is not None
    warmer_K = log.temperature_degC[0] - table[0, 3]
    return float(np.interp(log.voltage_V[0], table[:, 1] + table[:, 2] * warmer_K, table[:, 0]))


def _dataset(log: Log) -> dict[str, np.ndarray]:
    measured = {"current_values": log.current_A, "voltage_values": log.voltage_V}
    return measured if log.temperature_degC is None else measured | {"temperature_values": log.temperature_degC}


def _whole(values: np.ndarray, samples: int) -> np.ndarray:
    """The values with nan where the filter stopped before the end."""
    return np.concatenate([values, np.full(samples - len(values), np.nan)])
