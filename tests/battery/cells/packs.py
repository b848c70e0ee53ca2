"""Packs of unequal cells for tests: the circuit of one cell, with another capacity, resistance and charge in each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from battery.examples import NMC, Truth, simulate
from ohmward.battery.battery import Battery
from ohmward.battery.models.noise import BatteryNoise, usual_sensor
from ohmward.battery.models.thevenin import Thevenin
from ohmward.logs.log import Log


class Cell(NamedTuple):
    """A cell beside the model's: ratios of capacity and resistance, and points of SoC that it stands lower."""

    capacity: float = 1.0
    resistance: float = 1.0
    lower: float = 0.0


EQUAL = (Cell(),) * 4
HEALTHY = (Cell(1.01, 0.97), Cell(0.99, 1.03, 0.005), Cell(1.0, 1.0), Cell(0.985, 1.05, 0.01))
#: The last one has 85 % of the capacity, 1.5 times the resistance, and stands 5 points lower.
UNEQUAL = (Cell(1.01, 0.97), Cell(0.99, 1.03), Cell(), Cell(0.85, 1.5, 0.05))


def day(hours: float = 6.0, dt_s: float = 10.0, seed: int = 0, capacity_Ah: float = 2.0) -> np.ndarray:
    """Current of a day [A]: drives of 0.1 to 0.4 C, a rest, a charge at 0.35 C, drives again; 52 % are used."""
    rng = np.random.default_rng(seed)
    steps = int(3600 * hours / dt_s)
    load = -capacity_Ah * np.repeat(rng.uniform(0.1, 0.4, steps // 3 + 1), 3)[:steps]
    phase = np.arange(steps) / steps
    load[(phase > 0.45) & (phase < 0.5)] = 0.0
    load[(phase > 0.5) & (phase < 0.75)] = 0.35 * capacity_Ah
    load[:20] = 0.0
    return load


def aged(model: Thevenin, cell: Cell) -> Thevenin:
    """The circuit of a cell."""
    return model.worn(cell.capacity, cell.resistance)


def truths(cells: tuple[Cell, ...], current_A: np.ndarray, model: Thevenin = NMC, dt_s: float = 10.0) -> list[Truth]:
    """The truth of each cell under one current, from 95 %."""
    return [simulate(aged(model, cell), current_A, 0.95 - cell.lower, dt_s) for cell in cells]


def log_of(found: list[Truth], offset_A: float = 0.0, noise_V: float = 0.001, seed: int = 1) -> Log:
    """The log of a pack with the voltages of its cells."""
    rng = np.random.default_rng(seed)
    cells = {
        f"cell_voltage_{k + 1}_V": truth.voltage_V + noise_V * rng.standard_normal(len(truth.time_s))
        for k, truth in enumerate(found)
    }
    first = found[0]
    return Log("pack", first.time_s, first.current_A + offset_A, np.sum(list(cells.values()), axis=0), None, cells)


def battery(model: Thevenin = NMC, n_series: int = 4) -> Battery:
    """The battery file of a pack of new cells."""
    noise = BatteryNoise(
        voltage_std_V=0.002 * n_series,
        model_std_V=(0.004 * n_series,) * 2,
        capacity_std=0.05,
        resistance_std=0.2,
    )
    return Battery(
        "pack", model.capacity_Ah, "nmc", n_series, thevenin=model.in_series(n_series), noise=noise,
        sensor=usual_sensor(model.capacity_Ah),
    )  # fmt: skip
