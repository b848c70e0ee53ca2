"""What `ohmward mission` found, for people: key figures, tables and sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmward.cli import wording


def describe(figures: Mapping[str, Any]) -> str:
    """The same for people."""
    return wording.paragraphs(
        _title(figures),
        wording.fields(result(figures)),
        _split_text(figures["drive"]),
        wording.table(TERRAINS, terrain_rows(figures)) if figures["terrains"] else "",
        _plan_text(figures["plan"]),
        wording.bullets("Advice", advice_lines(figures)),
        wording.bullets("Assumed", [note.removeprefix("info: ") for note in figures["notes"]]),
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


TERRAINS = ["terrain", "drives", "driven", "measured", "cost of transport", "level, another day, P10-P90", "resistance"]


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
    """Where the energy of the drive went, part by part."""
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
