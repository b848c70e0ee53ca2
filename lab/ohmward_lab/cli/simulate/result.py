"""Figures of `ohmward simulate`, for programs and for people."""

from __future__ import annotations

from typing import Any

from ohmward.cli import wording
from ohmward_lab.simulate.closed_loop import ClosedLoopRun
from ohmward_lab.simulate.closed_loop.figures import Figures, figures

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
    """The object of --json."""
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
        "slip_commands": [held._asdict() for held in f.slip],
        "energy_J": f.energy_J.battery,
        "energy_J_per_m": f.energy_J_per_m,
        "energy_split_J": {name: getattr(f.energy_J, name) for name in ENERGY},
        **_scores(f),
        "soc_initial": scenario.battery.start_soc,
        "soc_final": float(history.soc[-1]),
        "voltage_min_V": float(history.voltage_V.min()),
        "voltage_max_V": float(history.voltage_V.max()),
        "steps": len(answer.rows.time_s),
        "warnings": list(answer.warnings),
    }


def _scores(f: Figures) -> dict[str, float | None]:
    """Of the observer, None without one."""
    names = (
        "speed_rmse_m_s",
        "speed_max_error_m_s",
        "speed_coverage_95",
        "slip_rmse",
        "coverage_95",
        "false_alarm_rate",
        "detection_rate",
    )
    return {name: getattr(f.score, name) if f.score else None for name in names}


def describe(answer: ClosedLoopRun, found: dict[str, Any]) -> str:
    """Text for people."""
    title = f"{found['scenario']}\n{found['robot']} on plant {found['plant']!r}, controller {found['controller']!r}"
    observer = "the true speed" if found["observer"] == "true" else f"observer {found['observer']!r}"
    return wording.paragraphs(
        f"{title}, {observer}",
        wording.fields(result(found)),
        energy_table(found),
        wording.bullets("Warnings", answer.warnings),
    )


def result(found: dict[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "drive": f"{found['distance_m']:.2f} m in {wording.duration(found['duration_s'])}",
        "state of charge": f"{wording.percent(found['soc_initial'])} to {wording.percent(found['soc_final'])}",
        "battery voltage": f"{found['voltage_min_V']:.2f} to {found['voltage_max_V']:.2f} V",
        "energy": wording.quantity(found["energy_J"], "J"),
        "energy per metre": wording.quantity(found["energy_J_per_m"], "J/m"),
        "slip reached after": wording.quantity(found["slip_settle_s"], "s"),
        "slip error, RMS": wording.quantity(found["slip_rms_error"], "(slip ratio)", digits=2),
        "speed error, RMS": wording.quantity(found["speed_rmse_m_s"], "mm/s", 1e3),
        "speed in 95 % band": wording.percent(found["speed_coverage_95"], 1),
        "slip in 95 % band": wording.percent(found["coverage_95"], 1),
        "false slip alarms": wording.percent(found["false_alarm_rate"]),
        "computed in": wording.duration(found["seconds"]),
    }
    return {name: value for name, value in rows.items() if value != "-"}


def energy_table(found: dict[str, Any]) -> str:
    """Terms of the energy balance as a table; those below a millionth of the whole are left out."""
    whole = found["energy_J"]
    parts = {name: value for name, value in found["energy_split_J"].items() if abs(value) > 1e-6 * abs(whole)}
    rows = [[ENERGY[name], f"{value:.4g} J", wording.percent(value / whole, 1)] for name, value in parts.items()]
    return wording.table(["where the energy went", "", "share"], rows)
