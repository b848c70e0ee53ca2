"""Runs of a simulated electrochemical cell: the truth under a current profile, counted from full to empty."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.models.temperature import KELVIN, ROOM_DEGC
from ohmward.checks import require_between
from ohmward.errors import OhmwardError
from ohmward_lab.simulate.electrochemical.cell import COUNTED_RATE, ElectrochemicalCell
from ohmward_lab.simulate.plant import fine_times
from ohmward_lab.simulate.profile import Profile

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
    """Truth over time, (T,) each; the current [A] charges the cell where it is > 0.

    time_s [s], voltage_V [V] and temperature_degC [degC] of the whole battery; soc: charge above that of the empty
    cell over the capacity, both counted at low rate and 25 degC between the voltage limits, at the cell's age.
    """

    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
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
