"""Figures of `ohmward mission`, for programs and for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ohmward.cli import wording
from ohmward.energy import MissionForecast, Range
from ohmward.energy.consumption_figures import TerrainFigures, record_figures, terrain_figures
from ohmward.energy.mission import MissionResult
from ohmward.traction import Robot

TERRAINS = ["terrain", "drives", "driven", "measured", "cost of transport", "level, another day, P10-P90", "resistance"]


def summary(result: MissionResult, robot: Robot | None, notes: Sequence[str]) -> dict[str, Any]:
    """The object of --json.

    notes: everything that was assumed.
    """
    c = result.consumption
    record = result.record
    forecast = result.forecast
    return {
        "command": "mission",
        "log": record.log.name if record else None,
        "battery": result.battery.name,
        "robot": robot.name if robot else None,
        "drive": record_figures(record, c)._asdict() if record else None,
        "terrains": {name: _terrain(terrain_figures(c, name)) for name in c.terrains},
        "idle_W": float(c.mean[0]),
        "idle_std_W": float(c.cov[0, 0] ** 0.5),
        "soc": result.state.soc,
        "soc_std": result.state.soc_std,
        "reserve_soc": result.state.reserve_soc,
        **_range(result.range),
        "probability": forecast.probability if forecast else None,
        "plan": _plan(forecast) if forecast else None,
        "advice": {name: advice._asdict() for name, advice in result.advice.items()},
        "notes": list(notes),
    }


def _terrain(figures: TerrainFigures) -> dict[str, Any]:
    expected = {name: getattr(figures, name)._asdict() for name in ("expected_J_per_m", "expected_cost_of_transport")}
    return figures._asdict() | expected


def _range(left: Range) -> dict[str, Any]:
    return {
        "usable_J": left.usable_J._asdict(),
        "range_m": left.distance_m._asdict(),
        "time_left_s": left.time_s._asdict(),
        "energy_J_per_m": left.energy_J_per_m._asdict(),
        "power_W": left.power_W,
    }


def _plan(forecast: MissionForecast) -> dict[str, Any]:
    milestones = [m._asdict() | {"energy_J": m.energy_J._asdict(), "soc": m.soc._asdict()} for m in forecast.milestones]
    last = milestones[-1]
    return {
        "distance_m": last["distance_m"],
        "time_s": last["time_s"],
        "energy_J": last["energy_J"],
        "probability": forecast.probability,
        "point_of_return_m": forecast.point_of_return_m,
        "milestones": milestones,
    }


def describe(figures: Mapping[str, Any]) -> str:
    """Text for people."""
    return wording.paragraphs(
        _title(figures),
        wording.fields(result(figures)),
        _split_text(figures["drive"]),
        wording.table(TERRAINS, terrain_rows(figures)) if figures["terrains"] else "",
        _plan_text(figures["plan"]),
        wording.bullets("Advice", advice_lines(figures)),
        wording.assumptions(figures["notes"]),
    )


def _title(figures: Mapping[str, Any]) -> str:
    what = figures["log"] or "plan"
    return f"{what} with battery {figures['battery']!r}" + (f", robot {figures['robot']!r}" if figures["robot"] else "")


def result(figures: Mapping[str, Any]) -> dict[str, str]:
    """The key figures with their units, by name."""
    rows = {
        "SoC": f"{wording.percent(figures['soc'], 1)}, std {wording.percent(figures['soc_std'], 1)}; "
        f"{wording.percent(figures['reserve_soc'], 0)} is the reserve",
        "usable energy": band(figures["usable_J"], "Wh", 1 / 3600.0),
        "range left": band(figures["range_m"], "m"),
        "time left": " / ".join(wording.duration(t) for t in figures["time_left_s"].values()) + "  (P10 / P50 / P90)",
        "energy ahead": band(figures["energy_J_per_m"], "J/m"),
        "idle power": f"{figures['idle_W']:.3g} W, std {figures['idle_std_W']:.2g} W",
    }
    if drive := figures["drive"]:
        per_metre = wording.quantity(drive["energy_J_per_m"], "J/m")
        rows = {
            "drive": f"{wording.quantity(drive['distance_m'], 'm', digits=4)} in {wording.duration(drive['used_s'])}, "
            f"{drive['energy_J'] / 3600.0:.3g} Wh, {per_metre}, cost of transport "
            f"{wording.quantity(drive['cost_of_transport'], '')}",
            **rows,
        }
    return rows


def band(values: Mapping[str, float], unit: str, scale: float = 1.0) -> str:
    """P10 / P50 / P90 with their unit."""
    return " / ".join(f"{float(f'{scale * v:.3g}'):g}" for v in values.values()) + f" {unit}  (P10 / P50 / P90)"


def terrain_rows(figures: Mapping[str, Any]) -> list[list[str]]:
    """One row for each ground."""
    return [
        [
            name,
            str(t["drives"]),
            f"{t['distance_m']:.4g} m",
            wording.quantity(t["energy_J_per_m"], "J/m"),
            wording.quantity(t["cost_of_transport"], "").strip(),
            f"{t['expected_J_per_m']['p10']:.3g} to {t['expected_J_per_m']['p90']:.3g} J/m",
            f"{t['force_N']:.3g} N, std {t['force_std_N']:.2g} N",
        ]
        for name, t in figures["terrains"].items()
    ]


def split_rows(drive: Mapping[str, Any]) -> list[list[str]]:
    """Terms of the energy balance of the drive, one row each."""
    parts = drive["split_J"] or {}
    whole = parts.get("battery")
    return [
        [
            name,
            f"{value / 3600.0:.3f} Wh",
            wording.percent(value / whole, 1) if whole else "-",
            f"± {drive['split_std_J'][name] / 3600.0:.2g} Wh" if name in drive["split_std_J"] else "",
        ]
        for name, value in parts.items()
    ]


def _split_text(drive: Mapping[str, Any] | None) -> str:
    if not drive or not drive["split_J"]:
        return ""
    return wording.table(["energy", "", "share", "std, at most"], split_rows(drive))


def _plan_text(plan: Mapping[str, Any] | None) -> str:
    if plan is None:
        return ""
    lines = {
        "plan": f"{plan['distance_m']:.4g} m in {wording.duration(plan['time_s'])}",
        "energy": band(plan["energy_J"], "Wh", 1 / 3600.0),
        "SoC at the end": " / ".join(wording.percent(v, 1) for v in plan["milestones"][-1]["soc"].values()),
        "probability": f"{wording.percent(plan['probability'], 1)} to finish with the reserve left",
        "point of return": f"{plan['point_of_return_m']:.4g} m along the plan, for the way back over the same ground",
    }
    return wording.fields(lines)


def advice_lines(figures: Mapping[str, Any]) -> list[str]:
    """A sentence or two for each ground."""
    lines = []
    for name, a in figures["advice"].items():
        saved = f"{a['saving_J_per_m']:.2g} ± {a['saving_std_J_per_m']:.1g} J/m"
        sure = a["saving_J_per_m"] > 2 * a["saving_std_J_per_m"]
        text = f"{name}: least energy per metre at {a['speed_m_s']:.2g} m/s, saves {saved} against the present speed"
        text += "" if sure else "; that is not certain"
        text += "; faster or slower may save more" if a["at_limit"] else ""
        lines.append(text)
        if a["idle_dominates"]:
            lines.append(f"{name}: idle power dominates, {wording.percent(a['idle_share'], 0)} of the energy per metre")
    return lines
