"""Figures of the cells of a pack."""

from __future__ import annotations

import numpy as np

from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.figures.battery import SOC_AXIS
from ohmward.figures.parts import band_95
from ohmward.report import TIME, Band, Figure, Series

#: More lines than this cannot be told apart: then the weakest and the fullest are drawn.
_MOST_CELLS = 6


def cells_soc_figure(run: PackRun) -> Figure:
    """State of charge of the cells, and of the pack; the 95 % band of the cell that is weakest at the end."""
    weakest = int(run.pack.weakest[-1])
    soc, std = 100 * run.cells.soc[:, weakest], 100 * run.cells.soc_std[:, weakest]
    series = [Series(run.time_s, soc, f"weakest: {run.names[weakest]}", role="alert")]
    series += [Series(run.time_s, 100 * run.cells.soc[:, k], run.names[k]) for k in _shown(run) if k != weakest]
    series.append(Series(run.time_s, 100 * run.pack.soc, "pack", "dashed", "reference"))
    band = band_95(run.time_s, soc, std, (0.0, 100.0), role="alert")
    return Figure("State of charge of the cells", TIME, SOC_AXIS, series, [band], height_px=300)


def cells_difference_figure(run: PackRun) -> Figure:
    """State of charge of each cell minus that of the typical one, with the range of all cells."""
    difference = 100 * run.cells.soc_difference
    series = [Series(run.time_s, difference[:, k], run.names[k]) for k in _shown(run)]
    band = Band(run.time_s, difference.min(axis=1), difference.max(axis=1), "all cells", "background")
    return Figure("Cells beside the typical one", TIME, "Difference of SoC [points]", series, [band], height_px=200)


def _shown(run: PackRun) -> list[int]:
    """Indices of the cells that are drawn: all where they are few, else the emptiest and the fullest at the end."""
    order = np.argsort(run.cells.soc[-1]).tolist()
    return sorted(order) if len(order) <= _MOST_CELLS else sorted([*order[: _MOST_CELLS // 2], *order[-1:]])
