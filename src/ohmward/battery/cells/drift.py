"""Warnings about cells that drift apart from the others of their pack, by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ohmward.battery.cells.cell_sample import CellEstimate
from ohmward.filters.consistency import BAND_95

#: Differences to the typical cell that a healthy pack may have: three standard deviations of packs in use, 1 point of
#: charge where a monitor balances them, 2 % of capacity, 5 % of resistance and 5 % more at the cold end of the row.
SOC_TOLERANCE, CAPACITY_TOLERANCE, RESISTANCE_TOLERANCE = 0.03, 0.06, 0.2
#: A warning is given once the difference lies beyond its tolerance by this many standard deviations: three quantities
#: of up to a hundred cells are looked at, at every sample.
CERTAIN = 3.0


class CellWarning(NamedTuple):
    """A cell that differs from the typical one of its pack beyond what a healthy pack does."""

    cell: int  #: its index
    quantity: str  #: "state of charge", "capacity" or "resistance"
    #: to the typical cell, of capacity and resistance as a share
    difference: float
    std: float
    text: str  #: a sentence with the name of the cell


def drifted(cells: CellEstimate) -> dict[str, np.ndarray]:
    """(..., n) conditions that a cell has certainly drifted beyond the tolerance.

    cells: every field (..., n).
    """
    soc = np.abs(cells.soc_difference) - CERTAIN * cells.soc_difference_std > SOC_TOLERANCE
    capacity = 1.0 - cells.capacity_ratio - CERTAIN * cells.capacity_ratio_std > CAPACITY_TOLERANCE
    resistance = cells.resistance_ratio - 1.0 - CERTAIN * cells.resistance_ratio_std > RESISTANCE_TOLERANCE
    return {"state of charge": soc, "capacity": capacity, "resistance": resistance}


def cell_warnings(cells: CellEstimate, names: Sequence[str]) -> tuple[CellWarning, ...]:
    """Warnings about the cells at one instant, the cell with most of them first.

    cells: every field (n,).  names: (n,) of the cells.
    """
    found = list(_warnings(cells, names))
    count = [sum(warning.cell == k for warning in found) for k in range(len(names))]
    return tuple(sorted(found, key=lambda warning: -count[warning.cell]))


def ranges(cells: CellEstimate) -> dict[str, tuple[float, float]]:
    """Largest minus smallest SoC, capacity and resistance of the cells, and the standard deviation of that range.

    cells: every field (n,).
    """
    values = {
        "SoC": (cells.soc_difference, cells.soc_difference_std),
        "capacity": (cells.capacity_ratio, cells.capacity_ratio_std),
        "resistance": (cells.resistance_ratio, cells.resistance_ratio_std),
    }
    found = {}
    for name, (value, std) in values.items():
        low, high = int(np.argmin(value)), int(np.argmax(value))
        found[name] = float(value[high] - value[low]), float(np.hypot(std[low], std[high]))
    return found


def _warnings(cells: CellEstimate, names: Sequence[str]) -> Iterator[CellWarning]:
    values = {
        "state of charge": (cells.soc_difference, cells.soc_difference_std),
        "capacity": (cells.capacity_ratio - 1.0, cells.capacity_ratio_std),
        "resistance": (cells.resistance_ratio - 1.0, cells.resistance_ratio_std),
    }
    for quantity, conditions in drifted(cells).items():
        difference, std = values[quantity]
        for k in np.flatnonzero(conditions).tolist():
            d, s = float(difference[k]), float(std[k])
            yield CellWarning(k, quantity, d, s, _sentence(names[k], quantity, d, s))


def _sentence(name: str, quantity: str, difference: float, std: float) -> str:
    unit = "points" if quantity == "state of charge" else "%"
    side = "above" if difference > 0.0 else "below"
    size, band = 100 * abs(difference), 100 * BAND_95 * std
    return f"{name}: {quantity} {size:.1f} ± {band:.1f} {unit} {side} the typical cell's"
