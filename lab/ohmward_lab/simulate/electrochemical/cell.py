"""A cell of porous electrodes: a PyBaMM model, a parameter set by name, and the cell's age."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ohmward.checks import require_between, require_one_of, require_positive
from ohmward.errors import InputError
from ohmward.optional import require
from ohmward_lab.simulate.electrochemical.stepper import CellEquations, VoltageLimits, step_function

_USER = "a simulated electrochemical cell"
_CURRENT, _AMBIENT = "Current function [A]", "Ambient temperature [K]"
_VOLTAGE, _TEMPERATURE = "Terminal voltage [V]", "Volume-averaged cell temperature [K]"
#: Names of the models.
MODELS = ("SPMe", "DFN", "lead-acid")
#: PyBaMM's set of a lead-acid cell; all others are of lithium or sodium.
_LEAD_ACID = "Sulzer2019"
#: Points over negative electrode, separator, positive electrode, and over the radius of both kinds of particles.
#: On a drive at 5 degC twice as many change the voltage by less than 2 mV.
_POINTS = {"x_n": 8, "x_s": 5, "x_p": 8, "r_n": 12, "r_p": 12}
#: Capacities are counted between the voltage limits at this rate (1 is 1 C) and 25 degC.
COUNTED_RATE = 1 / 20


@dataclass(frozen=True)
class ElectrochemicalCell:
    """Cells in series, all alike, as PyBaMM describes one.

    Raises:
        InputError: an unknown model or a value out of its range.
    """

    parameter_set: str  #: its name in PyBaMM: "Prada2013", "ORegan2022", "Sulzer2019"
    #: "SPMe" (single particle with electrolyte), "DFN" (Doyle, Fuller, Newman) or "lead-acid" (the full porous
    #: electrode model)
    model: str = "SPMe"
    n_series: int = 1  #: cells in series
    #: limits of one cell; those of the parameter set by default
    voltage_min_V: float | None = None
    voltage_max_V: float | None = None
    lost_lithium: float = 0.0  #: share of the cyclable lithium that is lost; 0 for a new cell
    #: share of the active material that is lost, in both electrodes; of a lead-acid cell the share of its plates
    lost_material: float = 0.0
    resistance_ratio: float = 1.0  #: of charge transfer and electrolyte, over that of a new cell

    def __post_init__(self) -> None:
        require_one_of("cell.model", self.model, MODELS)
        require_positive("cell.n_series", self.n_series)
        require_between("cell.lost_lithium", self.lost_lithium, 0.0, 0.9)
        require_between("cell.lost_material", self.lost_material, 0.0, 0.9)
        require_positive("cell.resistance_ratio", self.resistance_ratio)
        if self.model == "lead-acid" and self.lost_lithium:
            raise InputError("cell.lost_lithium must be 0 in a lead-acid cell; use cell.lost_material")

    @cached_property
    def limits(self) -> VoltageLimits:
        """Voltage limits of one cell."""
        values = _parameter_values(self.parameter_set)
        low, high = values["Lower voltage cut-off [V]"], values["Upper voltage cut-off [V]"]
        return VoltageLimits(
            low if self.voltage_min_V is None else self.voltage_min_V,
            high if self.voltage_max_V is None else self.voltage_max_V,
        )

    @cached_property
    def nominal_Ah(self) -> float:
        """Capacity on the label of a new cell [Ah]: the parameter set's own."""
        return float(_parameter_values(self.parameter_set)["Nominal cell capacity [A.h]"])

    @cached_property
    def parameters(self) -> Any:
        """PyBaMM's parameter values of the full cell, at this age, with current and ambient temperature as inputs."""
        values = _parameter_values(self.parameter_set)
        values["Lower voltage cut-off [V]"], values["Upper voltage cut-off [V]"] = self.limits
        values["Open-circuit voltage at 0% SOC [V]"], values["Open-circuit voltage at 100% SOC [V]"] = self.limits
        if self.model == "lead-acid":
            values["Electrode height [m]"] *= 1.0 - self.lost_material
        else:
            _lose_material_and_lithium(values, self.lost_material, self.lost_lithium)
        _raise_resistance(values, self.resistance_ratio)
        values[_CURRENT] = values[_AMBIENT] = "[input]"
        values["Initial temperature [K]"] = _pybamm().InputParameter(_AMBIENT)
        return values

    @cached_property
    def compiled(self) -> tuple[Any, Callable[[float], np.ndarray]]:
        """The step of `stepper.step_function`, and the full cell's state at rest at an ambient temperature [K]."""
        try:
            return _compile(self)
        except KeyError as error:
            raise InputError(
                f"cell.parameter_set {self.parameter_set!r} does not describe a cell of model {self.model!r}: "
                f"{str(error.args[0]).partition('. ')[0]}"
            ) from error


def usual_model(parameter_set: str) -> str:
    """The model that fits a parameter set and is quick: "SPMe", or "lead-acid"."""
    return "lead-acid" if parameter_set == _LEAD_ACID else "SPMe"


def _pybamm() -> Any:
    """The package; its reports of use to its makers, for which it asks at the first import, are left off."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
    return require("pybamm", _USER)


def _parameter_values(name: str) -> Any:
    pybamm = _pybamm()
    if name not in (known := sorted(pybamm.parameter_sets)):
        raise InputError(f"cell.parameter_set must be one of {', '.join(known)}, got {name!r}")
    return pybamm.ParameterValues(name)


def _lose_material_and_lithium(values: Any, material: float, lithium: float) -> None:
    """Reduce both in the charged cell, then charge it to its limit again."""
    values.set_initial_state(1.0)
    for electrode in ("Negative", "Positive"):
        values[f"{electrode} electrode active material volume fraction"] *= 1.0 - material
    values["Initial concentration in negative electrode [mol.m-3]"] *= 1.0 - lithium
    values.set_initial_state(1.0)


def _raise_resistance(values: Any, ratio: float) -> None:
    """Divide exchange currents and the conductivity of the electrolyte by `ratio`."""
    if ratio == 1.0:
        return
    for name in (
        "Negative electrode exchange-current density [A.m-2]",
        "Positive electrode exchange-current density [A.m-2]",
        "Electrolyte conductivity [S.m-1]",
    ):
        values[name] = _divided(values[name], ratio)


def _divided(value: Any, ratio: float) -> Any:
    """A number or function over `ratio`."""
    return (lambda *arguments: value(*arguments) / ratio) if callable(value) else value / ratio


def _compile(cell: ElectrochemicalCell) -> tuple[Any, Callable[[float], np.ndarray]]:
    pybamm, ca = _pybamm(), require("casadi", _USER)
    pybamm.set_logging_level("ERROR")
    cooled = cell.parameters.get("Cell cooling surface area [m2]") is not None
    options = {"thermal": "lumped" if cooled else "isothermal"}
    models = {"SPMe": pybamm.lithium_ion.SPMe, "DFN": pybamm.lithium_ion.DFN, "lead-acid": pybamm.lead_acid.Full}
    simulation = pybamm.Simulation(
        models[cell.model](options), parameter_values=cell.parameters.copy(), var_pts=_POINTS
    )
    simulation.build()
    found = simulation.built_model.export_casadi_objects(
        [_VOLTAGE, _TEMPERATURE], input_parameter_order=[_CURRENT, _AMBIENT]
    )
    outputs = ca.vertcat(found["variables"][_VOLTAGE], found["variables"][_TEMPERATURE])
    equations = CellEquations(found["x"], found["z"], found["inputs"], found["rhs"], found["algebraic"], outputs)
    start = ca.Function("start", [found["inputs"]], [ca.vertcat(found["x0"], found["z0"])])
    first = ca.Function("first", [found["x"], found["z"], found["inputs"]], [outputs[0]])

    def rest(ambient_K: float) -> np.ndarray:
        inputs = [0.0, ambient_K]
        y = np.array(start(inputs)).ravel()
        voltage_V = float(first(y[: equations.x.numel()], y[equations.x.numel() :], inputs))
        return np.concatenate([y, [0.0, voltage_V]])

    return step_function(equations, cell.limits), rest
