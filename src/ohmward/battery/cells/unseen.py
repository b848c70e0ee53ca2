"""The weakest cell of a pack whose cells are not measured: what the spread of cells says about it.

Nothing balances or compares the cells then. The one with the least charge of n lies below the typical one by the
expected minimum of n draws from their spread, which grows with the charge that is gone, because they differ in
capacity:

    std(s) = sqrt(soc_std^2 + (capacity_std (1 - s))^2),    s_min = s - e_n std(s) +- k_n std(s)

e_n and k_n are mean and standard deviation of the largest of n normal variables (Tippett 1925, Biometrika 17, 364).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from ohmward.battery.cells.spread import CellSpread
from ohmward.battery.chemistries import Normal

#: The grid of the integral over the largest of n normal variables.
_GRID = np.linspace(-8.0, 8.0, 3201)


def unseen_weakest(soc: Any, soc_std: Any, n_series: int, spread: CellSpread | None = None) -> Normal:
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
