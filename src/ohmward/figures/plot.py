"""The figures of a result, by its kind, and its card: what a notebook shows of it, a few lines and a small picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import singledispatch
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.health.ageing import DAYS_PER_YEAR
from ohmward.battery.health.health import BatteryHealth
from ohmward.battery.learning.fold import known
from ohmward.battery.soc.comparison import Comparison
from ohmward.battery.soc.estimator import SocRun
from ohmward.checks import as_numbers
from ohmward.energy.range_estimator import RangeRun
from ohmward.errors import InputError
from ohmward.figures import battery, slip
from ohmward.figures.health import trend_figures
from ohmward.figures.numbers import flagged, lognormal, normal, percent, percent_band, quantity, ratio
from ohmward.figures.parts import arriving_figure
from ohmward.filters.consistency import BAND_95
from ohmward.filters.run import Run
from ohmward.logs.drive_log import DriveLog
from ohmward.logs.log import Log
from ohmward.quantities import QUANTITIES, SECONDS_PER_HOUR
from ohmward.report import TIME, Band, Figure, Map, Plot, Series
from ohmward.report.card import card as html_card
from ohmward.runs import duration
from ohmward.traction.odometry.estimator import OdometryRun
from ohmward.traction.robot.robot import Robot
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
    given = None if truth is None else as_numbers("truth", truth)
    lengths = {len(run.time_s) for run in runs if isinstance(run, Run)}
    if given is not None:
        lengths.add(given.size)
    if others and (len({type(run) for run in runs}) > 1 or not isinstance(result, Run)):
        raise InputError(f"plot draws runs of one kind together, got {', '.join(type(run).__name__ for run in runs)}")
    if len(lengths) > 1:
        raise InputError(f"plot draws runs over one log, and its truth: got {sorted(lengths)} samples")
    return _plot(result) if given is None and not others else _beside(result, runs, given)


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


#: Largest number of warnings that the card of a log shows.
_MOST_WARNINGS = 3


@singledispatch
def card(result: Any) -> str:
    """HTML of a log, a battery, a robot or a run.

    Raises:
        InputError: any other object.
    """
    raise InputError(f"a card shows a log, a battery, a robot or a run, got {type(result).__name__}")


@card.register
def _(log: Log) -> str:
    charge = log.charge_Ah()
    facts = {
        **_extent(log),
        "current": _range(log.current_A, "A", "> 0 charges"),
        "voltage": _range(log.voltage_V, "V"),
        "temperature": "" if log.temperature_degC is None else _range(log.temperature_degC, "°C"),
        "charge": f"{charge[-1]:+.3g} Ah at the end, {log.throughput_Ah():.3g} Ah in and out",
        **_also(log),
    }
    return html_card(log.name, facts, battery.voltage_figure(log))


@card.register
def _(log: DriveLog) -> str:
    wheels, driven = log.wheel_speed_rad_s.shape[1], log.motor_current_A.shape[1]
    facts = {
        **_extent(log),
        "wheels": f"{wheels}, {driven} of them driven",
        "wheel speed": _range(log.wheel_speed_rad_s, "rad/s"),
        "motor current": _range(log.motor_current_A, "A"),
        "body": ", ".join(QUANTITIES[name].label.lower() for name in log.channels) or "nothing measured",
        **_also(log),
    }
    return html_card(log.name, facts, slip.wheels_figure(log))


@card.register
def _(found: Battery) -> str:
    sure = known(found)
    facts = {
        "cells": f"{found.n_series:g} in series" + (f", {found.chemistry}" if found.chemistry else ""),
        "capacity": f"{normal(sure.capacity_Ah._asdict(), 'Ah')} (95 %)",
        "voltage": f"{found.voltage_min_V:.4g} to {found.voltage_max_V:.4g} V",
        "resistance": f"{normal(sure.resistance_ohm._asdict(), 'mΩ', 1e3)} (95 %), ten seconds of 1 C at half charge",
        "curve": f"± {quantity(BAND_95 * float(np.median(sure.ocv_std_V)), 'mV', 1e3, 2)} (95 %), the median over SoC",
        "learnt from": f"{sure.logs} logs, {duration(sure.hours * SECONDS_PER_HOUR)}" if sure.logs else "",
        "not known": "; ".join(found.not_identified[:1]),
    }
    return html_card(found.name, facts, battery.ocv_figure(found.thevenin.ocv))


@card.register
def _(robot: Robot) -> str:
    facts = {
        "chassis": type(robot.chassis).__name__,
        "wheels": f"{len(robot.places)}, driven: {', '.join(name.replace('_', ' ') for name in robot.driven_wheels)}",
        "radius": quantity(robot.wheel.radius_m, "m"),
        "mass": quantity(robot.mass_kg, "kg"),
        "idle power": quantity(robot.idle_W, "W") if robot.idle_W else "",
    }
    return html_card(robot.name, facts)


@card.register
def _(run: SocRun) -> str:
    e = run.estimates
    facts = {
        **_steps(run),
        "SoC at the end": f"{percent_band(e.soc[-1], e.soc_std[-1])} (95 %)",
        "SoC range": f"{percent(float(np.nanmin(e.soc)), 1)} to {percent(float(np.nanmax(e.soc)), 1)}",
        "in words": run.explain().sentence,
    }
    return html_card("State of charge", facts, battery.soc_figure(run, e))


@card.register
def _(compared: Comparison) -> str:
    facts = {"log": compared.log.name}
    for name, figures in compared.figures().items():
        error, coverage = figures["soc_rmse"], figures["coverage_95"]
        end = f"{percent_band(figures['soc_final'], figures['soc_std_final'])} at the end"
        judged = f"RMSE {percent(error, 2)}, truth in the 95 % band {percent(coverage, 1)}; "
        facts[name] = f"{judged if error is not None else ''}{end}"
    return html_card("Estimators compared", facts, battery.comparison_figures(compared.log, compared.runs)[0])


@card.register
def _(found: BatteryHealth) -> str:
    ahead, by_logs = found.health.ahead, found.capacity_by == "logs"
    facts = {
        "logs": f"{len(found.updates)}, {sum(update.verdict == 'learnt' for update in found.updates)} of them learnt",
        "capacity": f"{lognormal(ratio(found.capacity), '%', 100)} of that when new (95 %)" if found.capacity else "",
        "resistance": f"{lognormal(ratio(found.health.resistance_now), '%', 100)} of that when new (95 %)",
        f"down to {ahead.share:.0%} within a year": percent(ahead.within(DAYS_PER_YEAR), 0) if by_logs else "",
        "sudden changes": f"{len(found.health.changes)}" if found.health.changes else "",
    }
    return html_card(f"Health of {found.battery.name}", facts, trend_figures(found)[0])


@card.register
def _(run: PackRun) -> str:
    pack = run.figures()
    facts = {
        **_steps(run),
        "pack at the end": f"{percent_band(pack['soc'], pack['soc_std'])} (95 %)",
        "weakest": str(pack["weakest"]),
        "warnings": "; ".join(warning.text for warning in run.warnings()),
    }
    return html_card("Cells of the pack", facts, battery.cells_soc_figure(run))


@card.register
def _(run: SlipRun) -> str:
    e = run.estimates
    slipping = np.asarray(e.slipping).max(axis=1) > 0.5
    facts = {
        **_steps(run),
        "speed at the end": f"{e.speed_m_s[-1]:z.3f} ± {BAND_95 * e.speed_std_m_s[-1]:.2g} m/s (95 %)",
        "greatest speed": quantity(float(np.nanmax(np.abs(e.speed_m_s))), "m/s"),
        "a wheel slips": f"{percent(float(slipping.mean()), 1)} of the samples",
    }
    return html_card("Speed and slip", facts, slip.speed_figure(run))


@card.register
def _(run: OdometryRun) -> str:
    e = run.estimates
    facts = {
        **_steps(run),
        "pose at the end": f"{e.x_m[-1]:z.2f} m forward, {e.y_m[-1]:z.2f} m to the left, turned by "
        f"{np.degrees(e.yaw_rad[-1]):.1f}°",
        "position": f"± {BAND_95 * e.position_std_m[-1]:.2g} m (95 %)",
        "distance": quantity(float(e.distance_m[-1]), "m"),
    }
    return html_card("Path", facts, slip.path_map(run))


@card.register
def _(run: FloorRun) -> str:
    crossings = f"{len(run.crossings)}" if run.crossings else "none"
    return html_card("Slip on floors", {**_steps(run), "floor changes": crossings}, slip.floor_plots(run)[0])


@card.register
def _(run: RangeRun) -> str:
    p10, p50, p90 = (np.asarray(values)[-1] for values in run.distance_m)
    facts = {**_steps(run), "range at the end": f"{p50:.0f} m, {p10:.0f} to {p90:.0f} (P10 to P90)"}
    return html_card("Range", facts, range_figures(run)[0])


def _steps(run: Run[Any]) -> dict[str, str]:
    hours = duration(float(run.time_s[-1] - run.time_s[0])) if len(run.time_s) else "0 s"
    return {"samples": f"{len(run.time_s):,} in {hours}", "flags": flagged(run.counts())}


def _extent(log: Log | DriveLog) -> dict[str, str]:
    interval = f", every {np.median(log.dt_s):.3g} s" if len(log) > 1 else ""
    return {"begins": _date(log), "samples": f"{len(log):,} in {duration(log.duration_s)}{interval}"}


def _date(log: Log | DriveLog) -> str:
    if log.start_unix_s is None:
        return ""
    zone = ZoneInfo(log.time_zone) if log.time_zone else UTC
    start = datetime.fromtimestamp(log.start_unix_s + float(log.time_s[0]), zone)
    return f"{start:%Y-%m-%d %H:%M:%S} {log.time_zone}".strip()


def _also(log: Log | DriveLog) -> dict[str, str]:
    warnings = [note.text for note in log.notes if note.level == "warning"]
    others = f"; {len(warnings) - _MOST_WARNINGS} more" if len(warnings) > _MOST_WARNINGS else ""
    return {
        "also": ", ".join(list(log.extra)[:6]) + (" ..." if len(log.extra) > 6 else ""),
        "warnings": "; ".join(warnings[:_MOST_WARNINGS]) + others,
    }


def _range(values: np.ndarray, unit: str, remark: str = "") -> str:
    known_values = values[np.isfinite(values)]
    if not known_values.size:
        return "not measured"
    missing = 1.0 - known_values.size / values.size
    text = f"{known_values.min():.4g} to {known_values.max():.4g} {unit}"
    remarks: Sequence[str] = [remark, f"{percent(missing, 1)} missing" if missing > 0.0 else ""]
    return text + "".join(f", {r}" for r in remarks if r)
