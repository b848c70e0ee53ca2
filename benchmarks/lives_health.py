"""Five days of a cell that has aged to 80 %, with the file of the new cell: capacity, resistance and charge found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from figure import Figure, at_least, at_most, table
from lives_cells import (
    CELLS,
    DAYS_AFTER,
    PULSES,
    Life,
    LifeCell,
    aged_cell,
    battery_from,
    capacity_of,
    measured,
    truth_of,
    truth_of_life,
)
from ohmward.battery.soc.estimator import SocEstimator
from ohmward.battery.soc.registry import DEFAULT
from ohmward.battery.soc.score import score
from ohmward_lab.simulate.electrochemical import ElectrochemicalCell
from ohmward_lab.simulate.mission import DayPlan
from ohmward_lab.simulate.profile import steps

_RATIO = 0.8
_DAYS = Life(5 * (DayPlan(25.0, 3.0, load=0.8, charged_fully=True),), _RATIO)
_PULSE_S = 10.0


def health() -> list[Figure]:
    """The figures of every cell whose days are quick to simulate."""
    return [figure for cell in CELLS if not cell.slow for figure in _of_cell(cell)]


def health_table(figures: list[Figure]) -> list[str]:
    """Figures in Markdown."""
    return table(("cell", "quantity", "value", "to reach", ""), [(f.data, *f.cells[2:]) for f in figures])


def _of_cell(cell: LifeCell) -> Iterator[Figure]:
    truth = truth_of_life(cell, _DAYS)
    log = measured(truth, cell, "five cycles", days_after=DAYS_AFTER[_RATIO])
    battery = battery_from(cell, PULSES)
    estimates = SocEstimator(battery, float(truth.soc[0])).run(log).estimates
    found = score(estimates.soc, truth.soc, estimates.soc_std)
    older = aged_cell(cell.new, _RATIO)
    capacity = estimates.soh_capacity[-1] * battery.capacity_Ah / capacity_of(older) - 1.0
    resistance = estimates.resistance_ratio[-1] / (pulse_ohm(older) / pulse_ohm(cell.new)) - 1.0
    assert found is not None
    yield at_most(cell.name, DEFAULT, "error of the capacity, %", 100 * abs(capacity), 3.0, ".1f")
    yield at_most(cell.name, DEFAULT, "error of the resistance, %", 100 * abs(resistance), 10.0, ".1f")
    yield at_most(cell.name, DEFAULT, "RMSE of the state of charge, points", 100 * found.rmse, 1.0, ".2f")
    yield at_least(cell.name, DEFAULT, "covered, %", 100 * found.coverage_95, 90.0, ".0f")


def pulse_ohm(cell: ElectrochemicalCell) -> float:
    """Resistance [ohm] over a pulse of 1 C and ten seconds at half charge, after a rest of an hour."""
    rate_A = capacity_of(cell)
    profile = steps([(600.0, 0.0), (5400.0, -rate_A / 3), (3600.0, 0.0), (_PULSE_S, -rate_A), (5.0, 0.0)])
    before_s = 600.0 + 5400.0 + 3600.0
    times = np.array([0.0, before_s - 1.0, before_s + _PULSE_S - 0.5])
    truth = truth_of(cell, profile, times, "pulse")
    return float((truth.voltage_V[1] - truth.voltage_V[2]) / -truth.current_A[2])
