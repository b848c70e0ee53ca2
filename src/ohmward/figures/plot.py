"""The figures of a result, by its kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.health.health import BatteryHealth
from ohmward.battery.soc.comparison import Comparison
from ohmward.battery.soc.estimator import SocRun
from ohmward.checks import as_numbers
from ohmward.energy.range_estimator import RangeRun
from ohmward.errors import InputError
from ohmward.figures import battery, slip
from ohmward.figures.health import trend_figures
from ohmward.figures.parts import arriving_figure
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Log
from ohmward.report import TIME, Band, Figure, Map, Plot, Series
from ohmward.traction.odometry.estimator import OdometryRun
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.slip_on_floors import FloorRun


def plot(result: Any, *others: Any, truth: Any = None) -> Plot | Map:
    """Figures of a log, a battery, or of what the `run` of an estimator returned.

    >>> battery, log = ow.load_battery("battery.toml"), ow.read_log("day.csv")
    >>> runs = [ow.SocEstimator(battery, filter=name).run(log) for name in ("gsf", "coulomb")]
    >>> ow.plot(*runs, truth=log.column("soc_true")).save("soc.svg")

    A notebook shows them, `plot(result).save("figure.html")` writes them: as a zoomable page (.html) or as a picture
    (.svg, .pdf, .png).

    result: a log, a battery or a run.
    others: further runs over the same log, by the same kind of estimator, drawn beside the first.
    truth: (T,) true values of the estimated quantity, in its unit: SoC in [0, 1], speed in m/s.

    Raises:
        InputError: any other object, runs of different kinds or lengths, or a truth of another length.
    """
    runs = [result, *others]
    known = None if truth is None else as_numbers("truth", truth)
    lengths = {len(run.time_s) for run in runs if isinstance(run, Run)}
    if known is not None:
        lengths.add(known.size)
    if others and (len({type(run) for run in runs}) > 1 or not isinstance(result, Run)):
        raise InputError(f"plot draws runs of one kind together, got {', '.join(type(run).__name__ for run in runs)}")
    if len(lengths) > 1:
        raise InputError(f"plot draws runs over one log, and its truth: got {sorted(lengths)} samples")
    return _plot(result) if known is None and not others else _beside(result, runs, known)


def _plot(result: Any) -> Plot | Map:
    match result:
        case Log():
            return Plot(result.name, battery.log_figures(result))
        case DriveLog():
            return Plot(result.name, slip.drive_figures(result))
        case Battery(thevenin=model):
            return Plot(result.name, [battery.ocv_figure(model.ocv), battery.resistance_figure(model)])
        case SocRun():
            return Plot("State of charge", battery.run_figures(result))
        case Comparison():
            return Plot("Estimators compared", battery.comparison_figures(result.log, result.runs, result.truth))
        case BatteryHealth():
            return Plot(f"Health of {result.battery.name}", trend_figures(result))
        case PackRun():
            cells = [battery.cells_soc_figure(result), battery.cells_difference_figure(result)]
            return Plot("Cells of the pack", cells)
        case SlipRun():
            return Plot("Speed and slip", [slip.speed_figure(result), *slip.ground_figures(result)])
        case FloorRun():
            return Plot("Slip on floors", slip.floor_plots(result))
        case OdometryRun():
            return slip.path_map(result)
        case RangeRun():
            return Plot("Range", range_figures(result))
    raise InputError(
        f"plot needs a log, a battery or what the run of an estimator returned, got {type(result).__name__}"
    )


def _beside(result: Any, runs: Sequence[Any], truth: np.ndarray | None) -> Plot:
    """Runs of one kind over one log, and the truth."""
    if isinstance(result, SocRun):
        if len(runs) == 1:
            return Plot("State of charge", battery.run_figures(result, truth))
        return Plot("State of charge", battery.comparison_figures(result, _named(runs), truth))
    if isinstance(result, SlipRun):
        figure = slip.speed_figure(result, truth_m_s=truth)
        _, *beside = _named(runs).items()
        more = [Series(run.time_s, run.speed_m_s, name) for name, run in beside]
        return Plot("Speed and slip", [replace(figure, series=[*figure.series, *more]), *slip.ground_figures(result)])
    raise InputError(f"plot draws runs of charge and of slip beside others or a truth, not {type(result).__name__}")


def _named(runs: Sequence[Any]) -> dict[str, Any]:
    """The runs by the names of their estimators, with a number where two have one name."""
    names = [getattr(run, "label", "estimate") for run in runs]
    return {
        name if names.count(name) == 1 else f"{name} {names[:k].count(name) + 1}": run
        for k, (name, run) in enumerate(zip(names, runs, strict=True))
    }


def range_figures(run: RangeRun) -> list[Figure]:
    """Range left with its band from P10 to P90, and the probability of getting home where it was estimated."""
    p10, p50, p90 = (1e-3 * np.asarray(values) for values in run.distance_m)
    line = Series(run.time_s, p50, "P50", role="estimate")
    band = Band(run.time_s, p10, p90, "P10 to P90")
    figures = [Figure("Range left", TIME, "Range [km]", [line], [band], height_px=300)]
    if np.isfinite(run.home_probability).any():
        figures.append(arriving_figure(TIME, run.time_s, run.home_probability))
    return figures
