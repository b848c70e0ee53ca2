"""The figures of a result, by its kind."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from ohmward.battery.soc.estimator import SocRun
from ohmward.energy.range_estimator import RangeRun
from ohmward.errors import InputError
from ohmward.figures import battery, range, slip, terrain
from ohmward.report import Plot
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.slip_on_floors import FloorRun


@singledispatch
def plot(result: Any) -> Plot:
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
def _(result: SlipRun) -> Plot:
    return Plot("Speed and slip", slip.run_figures(result))


@plot.register
def _(result: FloorRun) -> Plot:
    return Plot("Slip on floors", terrain.run_figures(result))


@plot.register
def _(result: RangeRun) -> Plot:
    return Plot("Range", range.run_figures(result))
