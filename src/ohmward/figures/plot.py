"""The figures of a result, by its kind."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.soc.estimator import SocRun
from ohmward.energy.range_estimator import RangeRun
from ohmward.errors import InputError
from ohmward.figures import battery, slip
from ohmward.report import TIME, Band, Figure, Map, Plot, Series
from ohmward.traction.odometry.estimator import OdometryRun
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.slip_on_floors import FloorRun


@singledispatch
def plot(result: Any) -> Plot | Map:
    """Figures of a result: what the `run` of an estimator returned.

    A notebook shows it, `plot(result).save("figure.html")` writes it as a page that needs no network.

    Raises:
        InputError: something else.
    """
    raise InputError(f"plot needs what the run of an estimator returned, got {type(result).__name__}")


@plot.register
def _(result: SocRun) -> Plot:
    return Plot("State of charge", battery.run_figures(result))


@plot.register
def _(result: PackRun) -> Plot:
    return Plot("Cells of the pack", [battery.cells_soc_figure(result), battery.cells_difference_figure(result)])


@plot.register
def _(result: SlipRun) -> Plot:
    return Plot("Speed and slip", slip.run_figures(result))


@plot.register
def _(result: FloorRun) -> Plot:
    return Plot("Slip on floors", slip.floor_plots(result))


@plot.register
def _(result: OdometryRun) -> Map:
    return slip.path_map(result)


@plot.register
def _(result: RangeRun) -> Plot:
    return Plot("Range", range_figures(result))


def range_figures(run: RangeRun) -> list[Figure]:
    """Range left with its band from P10 to P90, and the probability of coming home where it was asked for."""
    p10, p50, p90 = (1e-3 * np.asarray(values) for values in run.distance_m)
    line, band = [Series(run.time_s, p50, "P50", role="estimate")], [Band(run.time_s, p10, p90, "P10 to P90")]
    figures = [Figure("Range left", TIME, "Range [km]", line, band, height_px=300)]
    if np.isfinite(run.home_probability).any():
        line = [Series(run.time_s, 100 * run.home_probability, "probability", role="estimate")]
        figures.append(
            Figure("Coming home with the reserve left", TIME, "Probability [%]", line, y_limits=(-2.0, 102.0))
        )
    return figures
