"""`ohmward simulate`: a robot, its battery, its observer and its controller in closed loop; or a battery alone."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ohmward.cli.outcome import Outcome, check_output, counting, progress
from ohmward.cli.wording import bullets, fields, known_rows, paragraphs, table
from ohmward.errors import InputError
from ohmward.figures.numbers import percent, quantity
from ohmward.filters.consistency import BAND_95
from ohmward.logs import write_table
from ohmward.logs.write import TABLES
from ohmward.quantities import SECONDS_PER_HOUR
from ohmward.report import TIME, Band, Figure, Page, Series
from ohmward.runs import duration
from ohmward.traction.score import score_figures
from ohmward_lab.cli import simulate_cell as cell
from ohmward_lab.cli.arguments import OF_CELLS
from ohmward_lab.simulate import closed_loop
from ohmward_lab.simulate.closed_loop import ClosedLoopRun
from ohmward_lab.simulate.closed_loop.run import figures, true_slip
from ohmward_lab.simulate.closed_loop.scenario import EXAMPLE, packaged_text


def run(args: argparse.Namespace) -> Outcome:
    """Print an example or the list, or simulate, write the log and report."""
    if args.example:
        text = packaged_text(EXAMPLE).rstrip()
        return Outcome({"command": "simulate", "example": text}, text)
    if args.list:
        scenarios = dict(closed_loop.packaged())
        text = f"ohmward simulate NAME\n\n{fields(scenarios)}"
        return Outcome({"command": "simulate", "scenarios": scenarios}, text)
    if args.cell is not None:
        return cell.run(args)
    if given := [name for name in OF_CELLS if getattr(args, name) is not None]:
        raise InputError(f"--{given[0].replace('_', '-')} is of a battery alone: name it with --cell")
    if args.scenario is None:
        raise InputError(
            "name a scenario file, or one of `ohmward simulate --list`; --example prints one to start from"
        )
    scenario = closed_loop.find_scenario(args.scenario)
    if args.seed is not None:
        scenario = replace(scenario, seed=args.seed)
    check_output("--output", args.output, TABLES, [args.scenario])
    with progress() as report:
        answer = closed_loop.run(scenario, counting(report, scenario.name))
    if args.output:
        write_table(closed_loop.columns(answer), args.output)
    found = summary(answer) | {"output": args.output, "report": args.report}
    return Outcome(found, describe(found), answer.warnings, partial(make_page, answer, found), has_notes=True)


#: Terms of the energy balance in words.
ENERGY = {
    "copper": "heat of the motors' windings",
    "drive": "gears and bearings",
    "slip": "slip between wheels and ground",
    "rolling": "rolling resistance",
    "climb": "climbing",
    "drawbar": "drag",
    "kinetic": "motion",
    "idle": "electronics",
    "resistor": "braking resistor",
    "numerical": "numerical",
}


def summary(answer: ClosedLoopRun) -> dict[str, Any]:
    """Object printed by --json."""
    f = figures(answer)
    history = answer.history
    scenario = answer.scenario
    return {
        "command": "simulate",
        "scenario": scenario.name,
        "robot": scenario.model.name,
        "plant": scenario.plant,
        "observer": scenario.observer.method,
        "controller": scenario.controller.mode,
        "duration_s": f.duration_s,
        "distance_m": f.distance_m,
        "seconds": answer.seconds,
        "slip_settle_s": f.slip_settle_s,
        "slip_rms_error": f.slip_rms_error,
        "slip_commands": f.slip,
        "energy_J": f.energy_J.battery,
        "energy_J_per_m": f.energy_J_per_m,
        "energy_split_J": {name: getattr(f.energy_J, name) for name in ENERGY},
        **score_figures(f.score),
        "soc_initial": scenario.battery.start_soc,
        "soc_final": float(history.soc[-1]),
        "voltage_min_V": float(history.voltage_V.min()),
        "voltage_max_V": float(history.voltage_V.max()),
        "steps": len(answer.rows.time_s),
        "warnings": answer.warnings,
    }


def describe(found: Mapping[str, Any]) -> str:
    """Text for people; found: the summary, as in the functions below."""
    observer = "the true speed" if found["observer"] == "true" else f"observer {found['observer']!r}"
    return paragraphs(
        f"{found['scenario']}\n{found['robot']} on plant {found['plant']!r}, controller {found['controller']!r}, "
        f"{observer}",
        fields(result(found)),
        energy_table(found),
        bullets("Warnings", found["warnings"]),
    )


def result(found: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "drive": f"{found['distance_m']:.2f} m in {duration(found['duration_s'])}",
        "state of charge": f"{percent(found['soc_initial'])} to {percent(found['soc_final'])}",
        "battery voltage": f"{found['voltage_min_V']:.2f} to {found['voltage_max_V']:.2f} V",
        "energy": quantity(found["energy_J"], "J"),
        "energy per metre": quantity(found["energy_J_per_m"], "J/m"),
        "slip reached after": quantity(found["slip_settle_s"], "s"),
        "slip error, RMS": quantity(found["slip_rms_error"], "(slip ratio)", digits=2),
        "speed error, RMS": quantity(found["speed_rmse_m_s"], "mm/s", 1e3),
        "speed in 95 % band": percent(found["speed_coverage_95"], 1),
        "slip in 95 % band": percent(found["coverage_95"], 1),
        "false slip alarms": percent(found["false_alarm_rate"]),
        "computed in": duration(found["seconds"]),
    }
    return known_rows(rows)


def energy_table(found: Mapping[str, Any]) -> str:
    """Terms of the energy balance as a table; those below a millionth of the whole are left out."""
    whole = found["energy_J"]
    parts = {name: value for name, value in found["energy_split_J"].items() if abs(value) > 1e-6 * abs(whole)}
    rows = [[ENERGY[name], f"{value:.4g} J", percent(value / whole, 1)] for name, value in parts.items()]
    return table(["where the energy went", "", "share"], rows)


#: Seconds over which the power split is averaged.
_POWER_S = 0.25


def make_page(run: ClosedLoopRun, found: Mapping[str, Any]) -> Page:
    """Key figures, warnings, stacked plots on a common time axis, energy table."""
    what = f"{found['robot']}, plant {found['plant']!r}, simulated for {duration(found['duration_s'])}"
    values = result(found)
    chosen = ("drive", "energy per metre", "slip reached after", "slip error, RMS", "speed error, RMS")
    page = Page(found["scenario"], what).numbers({k: values[k] for k in chosen if k in values})
    for warning in run.warnings:
        page = page.callout("warning", warning)
    page = page.plot(_speed(run), *_slips(run), _torque(run), _friction(run), _power(run), _battery(run))
    page = page.heading("Result").table(["Quantity", "Value"], [list(row) for row in values.items()])
    split = [
        [ENERGY[name], quantity(value, "J", digits=4), quantity(value, "Wh", 1 / SECONDS_PER_HOUR)]
        for name, value in found["energy_split_J"].items()
    ]
    return page.heading("Energy").table(["Where the energy went", "Energy", "the same"], split)


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
    for k, wheel in enumerate(_wheels(run)):
        series = [Series(truth.time_s, true[:, k], "true", role="reference")]
        if rows.estimate is not None:
            series.append(Series(rows.time_s, forward * rows.estimate.slip_ratio[:, k], "estimated", role="estimate"))
        target = run.history.report.slip_target[:, k]
        if all(run.scenario.controller.mode_of(command) == "speed" for command in run.scenario.commands):
            series.append(Series(truth.time_s, target, "bound", "dashed", "background"))
            series.append(Series(truth.time_s, -target, "bound, braking", "dashed", "background"))
        elif np.isfinite(target).any():
            series.append(Series(truth.time_s, target, "set-point", "dashed", "background"))
        yield Figure(f"Slip, {wheel}", TIME, "Slip ratio [-]", series, y_limits=(-1.0, 1.0))


def _torque(run: ClosedLoopRun) -> Figure:
    truth = run.history.truth
    series = [Series(truth.time_s, truth.torque_N_m[:, k], wheel) for k, wheel in enumerate(_wheels(run))]
    return Figure("Torque of the motors", TIME, "Torque [N m]", series)


def _friction(run: ClosedLoopRun) -> Figure:
    truth = run.history.truth
    used = np.abs(truth.traction_N) / np.maximum(truth.normal_N, 1e-9)
    series = []
    for k, wheel in enumerate(_wheels(run)):
        series.append(Series(truth.time_s, truth.friction[:, k], f"{wheel}, there is", "step"))
        series.append(Series(truth.time_s, used[:, k], f"{wheel}, used"))
    return Figure("Friction under the wheels", TIME, "Force over load [-]", series)


def _power(run: ClosedLoopRun) -> Figure:
    """Mean power of each part over short intervals."""
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


def _wheels(run: ClosedLoopRun) -> list[str]:
    """Names of the driven wheels in words."""
    return [name.replace("_", " ") for name in run.scenario.model.driven_wheels]
