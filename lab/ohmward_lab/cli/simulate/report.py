"""Report of `ohmward simulate`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ohmward.cli.report_parts import FOOTER
from ohmward.cli.wording import duration, quantity
from ohmward.filters.consistency import BAND_95
from ohmward.report import TIME, Band, Figure, Page, Series
from ohmward_lab.cli.simulate.result import ENERGY, result, summary
from ohmward_lab.simulate.closed_loop import ClosedLoopRun
from ohmward_lab.simulate.closed_loop.figures import true_slip

#: Seconds over which the power split is averaged.
_POWER_S = 0.25


def make_page(run: ClosedLoopRun) -> Page:
    """Key figures, plots above each other on one clock, where the energy went, warnings."""
    found = summary(run)
    what = f"{found['robot']}, plant {found['plant']!r}, simulated for {duration(found['duration_s'])}"
    values = result(found)
    chosen = ("drive", "energy per metre", "slip reached after", "slip error, RMS", "speed error, RMS")
    page = Page(found["scenario"], what, FOOTER).numbers({k: values[k] for k in chosen if k in values})
    for warning in run.warnings:
        page = page.callout("warning", warning)
    page = page.plot(*plots(run))
    page = page.heading("Result").table(["Quantity", "Value"], [list(row) for row in values.items()])
    split = [
        [ENERGY[name], quantity(value, "J", digits=4), quantity(value, "Wh", 1 / 3600)]
        for name, value in found["energy_split_J"].items()
    ]
    return page.heading("Energy").table(["Where the energy went", "Energy", "the same"], split)


def plots(run: ClosedLoopRun) -> list[Figure]:
    """Speed, slip of each driven wheel, torque, friction, power split, battery."""
    return [_speed(run), *_slips(run), _torque(run), _friction(run), _power(run), _battery(run)]


def _speed(run: ClosedLoopRun) -> Figure:
    truth, rows = run.history.truth, run.rows
    series = [Series(truth.time_s, truth.speed_m_s, "true", role="reference")]
    asked = run.scenario.commands
    speeds = [np.nan if c.speed_m_s is None else c.speed_m_s for c in asked]
    if np.isfinite(speeds).any():
        edges = np.array([*(c.from_s for c in asked), truth.time_s[-1]])
        wanted = np.array([*speeds, speeds[-1]])
        keep = edges <= truth.time_s[-1]
        series.append(Series(edges[keep], wanted[keep], "asked for", "step", "background"))
    if rows.estimate is None:
        return Figure("Speed", TIME, "Speed [m/s]", series)
    v, half = rows.estimate.speed_m_s, BAND_95 * rows.estimate.speed_std_m_s
    series.append(Series(rows.time_s, v, "estimated", role="estimate"))
    return Figure("Speed", TIME, "Speed [m/s]", series, [Band(rows.time_s, v - half, v + half, "95 %")])


def _slips(run: ClosedLoopRun) -> Iterator[Figure]:
    truth, rows, robot = run.history.truth, run.rows, run.scenario.model
    true = true_slip(run.history, robot)
    forward = np.where(rows.truth.speed_m_s >= 0, 1.0, -1.0)
    for k, place in enumerate(robot.places[: robot.driven]):
        series = [Series(truth.time_s, true[:, k], "true", role="reference")]
        if rows.estimate is not None:
            series.append(Series(rows.time_s, forward * rows.estimate.slip_ratio[:, k], "estimated", role="estimate"))
        target = run.history.report.slip_target[:, k]
        if all(run.scenario.controller.mode_of(command) == "speed" for command in run.scenario.commands):
            series.append(Series(truth.time_s, target, "bound", "dashed", "background"))
            series.append(Series(truth.time_s, -target, "bound, braking", "dashed", "background"))
        elif np.isfinite(target).any():
            series.append(Series(truth.time_s, target, "set-point", "dashed", "background"))
        yield Figure(f"Slip, {_words(place.name)}", TIME, "Slip ratio [-]", series, y_limits=(-1.0, 1.0))


def _torque(run: ClosedLoopRun) -> Figure:
    truth, robot = run.history.truth, run.scenario.model
    series = [
        Series(truth.time_s, truth.torque_N_m[:, k], _words(place.name))
        for k, place in enumerate(robot.places[: robot.driven])
    ]
    return Figure("Torque of the motors", TIME, "Torque [N m]", series)


def _friction(run: ClosedLoopRun) -> Figure:
    truth, robot = run.history.truth, run.scenario.model
    used = np.abs(truth.traction_N) / np.maximum(truth.normal_N, 1e-9)
    series = []
    for k, place in enumerate(robot.places[: robot.driven]):
        series.append(Series(truth.time_s, truth.friction[:, k], f"{_words(place.name)}, there is", "step"))
        series.append(Series(truth.time_s, used[:, k], f"{_words(place.name)}, used"))
    return Figure("Friction under the wheels", TIME, "Force over load [-]", series)


def _power(run: ClosedLoopRun) -> Figure:
    """Mean power of each part over short stretches."""
    truth, energy_J = run.history.truth, run.history.energy_J
    every = max(1, round(_POWER_S / float(np.median(np.diff(truth.time_s))))) if truth.time_s.size > 1 else 1
    time_s = truth.time_s[::every]
    largest = {name: float(np.abs(getattr(energy_J, name)[-1])) for name in ENERGY}
    names = [name for name in ENERGY if largest[name] > 1e-3 * max(largest.values())]
    series = [_mean_power(time_s, energy_J.battery[::every], "battery")]
    series += [_mean_power(time_s, getattr(energy_J, name)[::every], ENERGY[name]) for name in names]
    return Figure("Where the power goes", TIME, "Power [W]", series)


def _mean_power(time_s: np.ndarray, energy_J: np.ndarray, label: str) -> Series:
    return Series(time_s[1:], np.diff(energy_J) / np.diff(time_s), label, "step")


def _battery(run: ClosedLoopRun) -> Figure:
    history = run.history
    series = [
        Series(history.truth.time_s, 100 * history.soc, "state of charge"),
        Series(history.truth.time_s, history.voltage_V, "voltage", axis="right"),
    ]
    return Figure("Battery", TIME, "State of charge [%]", series, right_label="Voltage [V]")


def _words(name: str) -> str:
    return name.replace("_", " ")
