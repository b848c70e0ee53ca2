"""Runs of a simulated electrochemical cell: the truth under a current profile, and logs of tests and working days.

The truth is counted from full to empty; the logs are as the sensors of a robot record it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import KELVIN, ROOM_DEGC
from ohmward.checks import require_between, require_one_of
from ohmward.errors import OhmwardError
from ohmward.logs import Log, Note
from ohmward_lab.simulate.electrochemical.cell import COUNTED_RATE, ElectrochemicalCell
from ohmward_lab.simulate.mission import DayPlan, first_discharged, working_day
from ohmward_lab.simulate.plant import fine_times
from ohmward_lab.simulate.profile import Profile, bench_times, low_rate_profile, pulse_profile
from ohmward_lab.simulate.sensors import BatterySensors, Sensor

_HOUR_S = 3600.0
#: Longest step [s] in a rest or at constant current.
_LONGEST_SOLVER_STEP_S = 10.0
#: Time [s] for which protection opens.
_OPEN_S = 60.0
#: Step [s] of a discharge at low rate: 0.04 % of the capacity.
_CAPACITY_STEP_S = 30.0
#: A discharge runs on by this share of the label until the cell is empty; sets hold up to 1.8 of it (Ramadass2004).
_STRETCH, _MOST_STRETCHES = 0.4, 10
#: The capacity is nearly linear in the lost shares: a few steps come this near, which is what a counted one shows.
_SECANT_STEPS, _CAPACITY_TOLERANCE = 5, 1e-3


class CellTruth(NamedTuple):
    """Truth over time, (T,) each."""

    time_s: np.ndarray
    current_A: np.ndarray  #: charges where it is > 0
    #: of the whole battery
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    #: charge above that of the empty cell over the capacity, both counted at low rate and 25 degC between the voltage
    #: limits, at the cell's age
    soc: np.ndarray


def simulate_cell(cell: ElectrochemicalCell, profile: Profile, time_s: np.ndarray) -> CellTruth:
    """The truth at `time_s` (T,) under a load, from the full cell at rest at the first ambient temperature.

    Protection and charger keep the voltage between the cell's limits, so the current may be less than the load asks;
    where the electrolyte of an empty cell gives out before its voltage falls, protection opens for a minute.

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
    charge_Ah = np.concatenate([[0.0], np.cumsum(-current_A[1:] * np.diff(grid))]) / _HOUR_S
    rows = np.searchsorted(grid, time_s)
    return CellTruth(
        grid[rows],
        -current_A[rows],
        cell.n_series * voltage_V[rows],
        kelvin[rows] - KELVIN,
        1.0 + charge_Ah[rows] / capacity_Ah(cell),
    )


def _run(step: Any, state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Outputs (3, n) of n steps from `state`; inputs (3, n) as in `stepper.step_function`."""
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
        OhmwardError: it holds more than four times its label.
    """
    rate_A = COUNTED_RATE * cell.nominal_Ah
    count = round(_STRETCH / COUNTED_RATE * _HOUR_S / _CAPACITY_STEP_S)
    step, rest = cell.compiled
    inputs = np.repeat([[_CAPACITY_STEP_S], [rate_A], [ROOM_DEGC + KELVIN]], count, axis=1)
    state, current_A = rest(ROOM_DEGC + KELVIN), np.zeros(0)
    for _ in range(_MOST_STRETCHES):
        states, outputs = step.mapaccum(count)(state, inputs)
        state, current_A = states[:, -1], np.append(current_A, np.array(outputs)[0])
        if (limited := current_A < 0.999 * rate_A).any():
            return float(np.sum(current_A[: np.argmax(limited)]) * _CAPACITY_STEP_S / _HOUR_S)
    raise OhmwardError(
        f"{cell.parameter_set} is not empty after {_STRETCH * _MOST_STRETCHES:g} times its {cell.nominal_Ah:g} Ah: "
        "set voltage_min_V where it is"
    )


def aged(cell: ElectrochemicalCell, capacity_ratio: float, resistance_ratio: float = 1.0) -> ElectrochemicalCell:
    """The cell when its capacity and resistance have come to these ratios of the new cell's.

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
        if abs(excess[-1]) < _CAPACITY_TOLERANCE:
            return older
        lost.append(lost[-1] - excess[-1] * (lost[-1] - lost[-2]) / (excess[-1] - excess[-2]))
    return replace(cell, lost_material=lost[-1], lost_lithium=lost[-1], resistance_ratio=resistance_ratio)


#: What `record_cell` knows to record, and what each is.
RECORDS = {
    "pulse-test": "from full to empty in steps of 10 %, with pulses and an hour of rest at each",
    "low-rate-test": "from full to empty and back at C/20",
    "day": "eight hours of drives, pauses and rests from full, two charges in between",
}
#: Interval [s] of a low-rate test's logger and of a robot's.
_SLOW_S, _ROBOT_S = 10.0, 1.0
#: Resolution [V] of a usual converter, for one cell.
FINE_V = 0.001
#: Distance [V] of one cell from its cut-off at which a test has reached it.
_CUT_OFF_V = 0.005


def record_cell(
    cell: ElectrochemicalCell, record: str, ambient_degC: float = ROOM_DEGC, seed: int = 1, new_Ah: float | None = None
) -> Log:
    """Log of a test or a day from full, with the true SoC as the extra column `soc_true`.

    record: of RECORDS.  seed: draws the drives of a day and the noise.  new_Ah: capacity of the new cell [Ah], of which
    currents are multiples; by default the capacity that the cell has.

    Raises:
        InputError: another record.
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
        return profile, np.arange(0.0, profile.time_s[-1], _SLOW_S)
    profile, _ = first_discharged(working_day(rng, rate_Ah, DayPlan(degC)), rate_Ah, 0.0)
    return profile, np.arange(0.0, profile.time_s[-1], _ROBOT_S)


def until_cut_off(truth: CellTruth, cell: ElectrochemicalCell) -> CellTruth:
    """The truth of a test to its first cut-off where the model of the empty cell is not to be trusted: lead-acid."""
    below = truth.voltage_V <= cell.n_series * (cell.limits.low_V + _CUT_OFF_V)
    if cell.model != "lead-acid" or not below.any():
        return truth
    return CellTruth(*(values[: np.argmax(below) + 1] for values in truth))


def usual_sensors(
    capacity_Ah: float, n_series: int = 1, offset: float = 0.0, gain: float = 0.0, voltage_step_V: float = FINE_V
) -> BatterySensors:
    """Sensors of a robot with this offset of the current, as a share of C, and this error of its gain.

    Current: noise of 0.2 %, resolution of 0.1 % of C. Voltage: noise of 1 mV and the resolution given, of each cell.
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
