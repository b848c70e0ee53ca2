"""A porous-electrode cell simulated with PyBaMM: a battery that no model of this package describes exactly.

The cell is a PyBaMM model, a named parameter set, and an age. Its true SoC under a current profile is counted between
full and empty; the logs of tests and working days are as the sensors of a robot record them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import KELVIN, ROOM_DEGC
from ohmward.checks import require_between, require_one_of, require_positive
from ohmward.errors import InputError, OhmwardError
from ohmward.logs import Log, Note
from ohmward.optional import require
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward_lab.simulate.electrochemical_step import CellEquations, VoltageLimits, step_function
from ohmward_lab.simulate.mission import DayPlan, first_discharged, working_day
from ohmward_lab.simulate.plant import fine_times
from ohmward_lab.simulate.profile import Profile, bench_times, low_rate_profile, pulse_profile
from ohmward_lab.simulate.sensors import BatterySensors, Sensor

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
_COUNTED_RATE = 1 / 20


@dataclass(frozen=True)
class ElectrochemicalCell:
    """Identical cells in series, each one as PyBaMM describes it.

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
    #: share of the active material that is lost, in both electrodes; for a lead-acid cell the share of its plates
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
        """The step of `step_function`, and the full cell's state at rest at an ambient temperature [K]."""
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
    """PyBaMM; its telemetry, for which it asks at the first import, stays disabled."""
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


#: Longest step [s] in a rest or at constant current.
_LONGEST_SOLVER_STEP_S = 10.0
#: Time [s] for which protection opens.
_OPEN_S = 60.0
#: Step [s] of a discharge at low rate: 0.04 % of the capacity.
_CAPACITY_STEP_S = 30.0
#: A discharge runs on by this share of the label until the cell is empty; sets hold up to 1.8 of it (Ramadass2004).
_RUN_ON, _MOST_STRETCHES = 0.4, 10
#: The capacity is nearly linear in the lost shares: a few steps reach this tolerance, the resolution of a counted one.
_SECANT_STEPS, _SECANT_TOLERANCE = 5, 1e-3


class CellTruth(NamedTuple):
    """Truth over time, (T,) each."""

    time_s: np.ndarray
    current_A: np.ndarray  #: > 0 charges
    #: of the whole battery
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    #: charge above that of the empty cell over the capacity, both counted at low rate and 25 degC between the voltage
    #: limits, at the cell's age
    soc: np.ndarray


def simulate_cell(cell: ElectrochemicalCell, profile: Profile, time_s: np.ndarray) -> CellTruth:
    """The truth at `time_s` (T,) under a load, from the full cell at rest at the first ambient temperature.

    Protection and charger keep the voltage between the cell's limits, so the current may be less than the load demands;
    where the electrolyte of an empty cell is depleted before its voltage falls, protection opens for a minute.

    Raises:
        OhmwardError: the equations have no solution even without current.
    """
    grid = _grid(profile, time_s)
    middle = 0.5 * (grid[1:] + grid[:-1])
    current = np.interp(middle, profile.time_s, profile.current_A)
    ambient = np.interp(middle, profile.time_s, profile.ambient_degC) + KELVIN
    step, rest = cell.compiled
    inputs = np.vstack([np.diff(grid), -current, ambient])
    first = rest(float(profile.ambient_degC[0]) + KELVIN)
    outputs = _run(step, first, inputs)
    start = np.array([[0.0], [first[-1]], [profile.ambient_degC[0] + KELVIN]])
    current_A, voltage_V, kelvin = np.concatenate([start, outputs], axis=1)
    charge_Ah = np.concatenate([[0.0], np.cumsum(-current_A[1:] * np.diff(grid))]) / SECONDS_PER_HOUR
    rows = np.searchsorted(grid, time_s)
    return CellTruth(
        grid[rows],
        -current_A[rows],
        cell.n_series * voltage_V[rows],
        kelvin[rows] - KELVIN,
        1.0 + charge_Ah[rows] / capacity_Ah(cell),
    )


def _run(step: Any, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Outputs (3, n) of n steps from `state`; inputs (3, n) as in `step_function`."""
    inputs, done = inputs.copy(), np.zeros((3, 0))
    while (start := done.shape[1]) < inputs.shape[1]:
        states, outputs = (np.array(part) for part in step.mapaccum(inputs.shape[1] - start)(state, inputs[:, start:]))
        failed = ~np.isfinite(outputs).all(axis=0)
        if not failed.any():
            return np.concatenate([done, outputs], axis=1)
        count = max(int(np.argmax(failed)) - 1, 0)
        opened = start + count + np.flatnonzero(np.cumsum(inputs[0, start + count :]) <= _OPEN_S)
        if not inputs[1, opened].any():
            raise OhmwardError("the equations of the cell have no solution here: take a smaller load or shorter steps")
        inputs[1, opened] = 0.0
        done = np.concatenate([done, outputs[:, :count]], axis=1)
        state = states[:, count - 1] if count else state
    return done


def _grid(profile: Profile, time_s: np.ndarray) -> np.ndarray:
    """Times [s] of the steps: every change of the load, every wanted time, and between them as many as needed."""
    times = np.union1d(profile.time_s, time_s)
    return fine_times(times[times <= time_s[-1]], _LONGEST_SOLVER_STEP_S)


@lru_cache(maxsize=64)
def capacity_Ah(cell: ElectrochemicalCell) -> float:
    """Capacity [Ah] between the voltage limits at 1/20 C and 25 degC, of the cell at its age.

    Raises:
        OhmwardError: the cell holds more than four times its label.
    """
    rate_A = _COUNTED_RATE * cell.nominal_Ah
    count = round(_RUN_ON / _COUNTED_RATE * SECONDS_PER_HOUR / _CAPACITY_STEP_S)
    step, rest = cell.compiled
    inputs = np.repeat([[_CAPACITY_STEP_S], [rate_A], [ROOM_DEGC + KELVIN]], count, axis=1)
    state, current_A = rest(ROOM_DEGC + KELVIN), np.zeros(0)
    for _ in range(_MOST_STRETCHES):
        states, outputs = step.mapaccum(count)(state, inputs)
        state, current_A = states[:, -1], np.append(current_A, np.array(outputs)[0])
        if (limited := current_A < 0.999 * rate_A).any():
            return float(np.sum(current_A[: np.argmax(limited)]) * _CAPACITY_STEP_S / SECONDS_PER_HOUR)
    raise OhmwardError(
        f"{cell.parameter_set} is not empty after {_RUN_ON * _MOST_STRETCHES:g} times its {cell.nominal_Ah:g} Ah: "
        "set voltage_min_V where it is"
    )


def aged(cell: ElectrochemicalCell, capacity_ratio: float, resistance_ratio: float = 1.0) -> ElectrochemicalCell:
    """The cell aged to these ratios of the new cell's capacity and resistance.

    A lithium cell has lost equal shares of lithium and of active material, as ageing studies find both (Birkl et al.
    2017, J. Power Sources 341, 373); their size is found from the capacity by the secant method.

    Raises:
        InputError: capacity_ratio outside [0.3, 1].
    """
    require_between("capacity_ratio", capacity_ratio, 0.3, 1.0)
    share = 1.0 - capacity_ratio
    if cell.model == "lead-acid" or share == 0.0:
        return replace(cell, lost_material=share, resistance_ratio=resistance_ratio)
    new_Ah = capacity_Ah(cell)
    lost, excess = [0.0, 0.5 * share], [share]
    for _ in range(_SECANT_STEPS):
        older = replace(cell, lost_material=lost[-1], lost_lithium=lost[-1], resistance_ratio=resistance_ratio)
        excess.append(capacity_Ah(older) / new_Ah - capacity_ratio)
        if abs(excess[-1]) < _SECANT_TOLERANCE:
            return older
        lost.append(lost[-1] - excess[-1] * (lost[-1] - lost[-2]) / (excess[-1] - excess[-2]))
    return replace(cell, lost_material=lost[-1], lost_lithium=lost[-1], resistance_ratio=resistance_ratio)


#: Records that `record_cell` can make, with their descriptions.
RECORDS = {
    "pulse-test": "from full to empty in steps of 10 %, with pulses and an hour of rest at each",
    "low-rate-test": "from full to empty and back at C/20",
    "day": "eight hours of drives, pauses and rests from full, two charges in between",
}
#: Interval [s] of a low-rate test's logger and of a robot's.
_LOGGER_S, _ROBOT_S = 10.0, 1.0
#: Resolution [V] of a usual converter, for one cell.
FINE_V = 0.001
#: A test has reached the cut-off where a cell is this close to it [V].
_CUT_OFF_V = 0.005


def record_cell(
    cell: ElectrochemicalCell, record: str, ambient_degC: float = ROOM_DEGC, seed: int = 1, new_Ah: float | None = None
) -> Log:
    """Log of a test or a day from full, with the true SoC as the extra column `soc_true`.

    record: one of RECORDS.  seed: draws the drives of a day and the noise.  new_Ah: capacity of the new cell [Ah], of
    which currents are multiples; by default the present capacity of the cell.

    Raises:
        InputError: an unknown record.
    """
    require_one_of("record", record, tuple(RECORDS))
    rng = np.random.default_rng(seed)
    rate_Ah = capacity_Ah(cell) if new_Ah is None else new_Ah
    profile, time_s = _load(record, rate_Ah, ambient_degC, rng)
    truth = simulate_cell(cell, profile, time_s)
    truth = truth if record == "day" else until_cut_off(truth, cell)
    name = f"simulated {cell.parameter_set} {record} at {ambient_degC:g} degC"
    log = log_of(truth, usual_sensors(rate_Ah, cell.n_series), rng, name)
    note = Note(f"simulated, not measured: PyBaMM's {cell.parameter_set}, {cell.model}, {capacity_Ah(cell):.4g} Ah")
    return log.with_notes(note)


def _load(record: str, rate_Ah: float, degC: float, rng: np.random.Generator) -> tuple[Profile, np.ndarray]:
    """Load of a record and the times [s] at which its logger samples."""
    if record == "pulse-test":
        profile = pulse_profile(rate_Ah, degC)
        return profile, bench_times(profile)
    if record == "low-rate-test":
        profile = low_rate_profile(rate_Ah, degC)
        return profile, np.arange(0.0, profile.time_s[-1], _LOGGER_S)
    profile, _ = first_discharged(working_day(rng, rate_Ah, DayPlan(degC)), rate_Ah, 0.0)
    return profile, np.arange(0.0, profile.time_s[-1], _ROBOT_S)


def until_cut_off(truth: CellTruth, cell: ElectrochemicalCell) -> CellTruth:
    """The truth of a lead-acid test up to its first cut-off, since the model of the empty cell is unreliable."""
    below = truth.voltage_V <= cell.n_series * (cell.limits.low_V + _CUT_OFF_V)
    if cell.model != "lead-acid" or not below.any():
        return truth
    return CellTruth(*(values[: np.argmax(below) + 1] for values in truth))


def usual_sensors(
    capacity_Ah: float, n_series: int = 1, offset: float = 0.0, gain: float = 0.0, voltage_step_V: float = FINE_V
) -> BatterySensors:
    """Sensors of a robot with this offset of the current, as a share of C, and this error of its gain.

    Current: noise of 0.2 %, resolution of 0.1 % of C. Voltage: noise of 1 mV and the given resolution, per cell.
    Temperature: 0.1 K.
    """
    C, cells = capacity_Ah, n_series
    return BatterySensors(
        Sensor(-10 * C, 10 * C, 0.001 * C, 0.002 * C, offset=offset * C, gain_error=gain),
        Sensor(0.0, 10.0 * cells, voltage_step_V * cells, 0.001 * cells),
        Sensor(-55.0, 125.0, 0.1, 0.05),
    )


def log_of(truth: CellTruth, sensors: BatterySensors, rng: np.random.Generator, name: str) -> Log:
    """Log of the truth, its time from 0, with the true SoC as the extra column `soc_true`."""
    return sensors.log(name, truth.time_s - truth.time_s[0], truth, rng)
