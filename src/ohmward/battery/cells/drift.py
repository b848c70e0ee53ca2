"""Differences between the cells of a pack: warnings by name, and the weakest cell with the usable charge it leaves.

The string carries one current. A discharge ends when the first cell is empty, a charge when the first one is full:

    usable charge = min of s_k Q_k,    room for charge = min of (1 - s_k) Q_k,
    capacity of the pack = usable + room,    SoC of the pack = usable / (usable + room)      (Plett 2015, BMS II, 4.1)

Equal cells give the SoC and the capacity of a cell.

Cells that are not measured are neither balanced nor compared. The one with the least charge of n lies below the typical
one by the expected minimum of n draws from their spread, which grows with the charge taken out, because the cells
differ in capacity:

    std(s) = sqrt(soc_std^2 + (capacity_std (1 - s))^2),    s_min = s - e_n std(s) +- k_n std(s)

e_n and k_n are mean and standard deviation of the largest of n normal variables (Tippett 1925, Biometrika 17, 364).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ohmward.battery.cells.cell_filter import CellEstimate, CellSpread
from ohmward.battery.chemistries import Normal
from ohmward.filters.consistency import BAND_95

#: The grid of the integral over the largest of n normal variables.
_GRID = np.linspace(-8.0, 8.0, 3201)
#: Least capacity of a pack in computing its state of charge, relative to that of the typical cell.
_LEAST_ROOM = 1e-3


class PackState(NamedTuple):
    """State of a pack by its cells; numbers, or (T,) each."""

    soc: Any  #: of the pack, in [0, 1]: 0 when the first cell is empty, 1 when the first one is full
    soc_std: Any  #: its standard deviation
    #: charge until the first cell is empty
    usable_Ah: Any
    usable_std_Ah: Any
    capacity_Ah: Any  #: charge between the limits that the cells set
    weakest: Any  #: index of the cell that will be empty first
    weakest_soc: Any  #: its state of charge
    weakest_soc_std: Any  #: its standard deviation
    soc_spread: Any  #: state of charge of the fullest cell minus that of the emptiest


def pack_state(cells: CellEstimate, typical_Ah: Any) -> PackState:
    """State of the pack.

    cells: every field (..., n).
    typical_Ah: (...,) capacity of the typical cell.
    """
    capacity_Ah = np.asarray(typical_Ah)[..., None] * cells.capacity_ratio
    charge_Ah, room_Ah = cells.soc * capacity_Ah, (1.0 - cells.soc) * capacity_Ah
    weakest = np.argmin(charge_Ah, axis=-1)

    def of_weakest(values: np.ndarray) -> np.ndarray:
        return np.take_along_axis(values, weakest[..., None], axis=-1)[..., 0]

    usable_Ah, room = of_weakest(charge_Ah), np.min(room_Ah, axis=-1)
    pack_Ah = usable_Ah + room
    divisor_Ah = np.maximum(pack_Ah, _LEAST_ROOM * np.asarray(typical_Ah))  # one cell empty, another one full
    of_soc_Ah = of_weakest(capacity_Ah * cells.soc_std)
    of_capacity_Ah = of_weakest(charge_Ah * cells.capacity_ratio_std / cells.capacity_ratio)
    usable_std_Ah = np.hypot(of_soc_Ah, of_capacity_Ah)
    return PackState(
        soc=usable_Ah / divisor_Ah,
        soc_std=np.minimum(of_soc_Ah / divisor_Ah, 1.0),
        usable_Ah=usable_Ah,
        usable_std_Ah=usable_std_Ah,
        capacity_Ah=pack_Ah,
        weakest=weakest,
        weakest_soc=of_weakest(cells.soc),
        weakest_soc_std=of_weakest(cells.soc_std),
        soc_spread=np.max(cells.soc, axis=-1) - np.min(cells.soc, axis=-1),
    )


def expected_weakest(soc: Any, soc_std: Any, n_series: int, spread: CellSpread | None = None) -> Normal:
    """State of charge of the weakest of n cells in series, mean and standard deviation, numbers or (T,).

    soc, soc_std: of the typical cell.
    """
    spread = spread or CellSpread()
    mean, std = largest_of(n_series)
    each = np.hypot(spread.soc_std, spread.capacity_std * (1.0 - soc))
    return Normal(np.maximum(soc - mean * each, 0.0), np.hypot(soc_std, std * each))


@cache
def largest_of(count: int) -> tuple[float, float]:
    """Mean and standard deviation of the largest of `count` standard normal variables, 0 and 1 for one."""
    below = np.array([0.5 * (1.0 + math.erf(x / math.sqrt(2.0))) for x in _GRID])
    mass = np.diff(below**count)
    middle = 0.5 * (_GRID[1:] + _GRID[:-1])
    mean = float(middle @ mass)
    return mean, float(math.sqrt((middle - mean) ** 2 @ mass))


#: Differences from the typical cell that a healthy pack may have: three standard deviations of packs in use, 1 point of
#: charge where a monitor balances them, 2 % of capacity, 5 % of resistance and 5 % more at the cold end of the row.
SOC_TOLERANCE, CAPACITY_TOLERANCE, RESISTANCE_TOLERANCE = 0.03, 0.06, 0.2
#: A warning is given once the difference lies beyond its tolerance by this many standard deviations: three quantities
#: of up to a hundred cells are checked at every sample.
CERTAIN = 3.0


class CellWarning(NamedTuple):
    """Warning about a cell that differs from the typical one of its pack by more than cells of a healthy pack do."""

    cell: int  #: its index
    quantity: str  #: "state of charge", "capacity" or "resistance"
    #: difference from the typical cell, as a share for capacity and resistance, and its standard deviation
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
        unit = "points" if quantity == "state of charge" else "%"
        for k in np.flatnonzero(conditions).tolist():
            d, s = float(difference[k]), float(std[k])
            size = f"{100 * abs(d):.1f} ± {100 * BAND_95 * s:.1f} {unit}"
            side = "above" if d > 0.0 else "below"
            yield CellWarning(k, quantity, d, s, f"{names[k]}: {quantity} {size} {side} the typical cell's")
