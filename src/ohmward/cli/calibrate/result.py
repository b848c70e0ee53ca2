"""Figures of `ohmward calibrate`, for programs and for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ohmward.cli import wording
from ohmward.filters.consistency import BAND_95
from ohmward.traction.calibration import Calibration
from ohmward.traction.terrain.floor import Floor

PARAMETERS = ["parameter", "value", "95 % interval", ""]


def summary(found: Calibration) -> dict[str, Any]:
    """The object of --json, but for the files."""
    notes = [str(note) for drive in found.drives for note in drive.log.notes if note.level != "info"]
    notes += [str(note) for note in found.notes]
    return {
        "command": "calibrate",
        "robot": found.robot.name,
        "drives": len(found.drives),
        "duration_s": sum(drive.log.duration_s for drive in found.drives),
        "parameters": [{**p._asdict(), "identified": p.identified} for p in found.parameters],
        "floor": asdict(found.floor) if found.floor else None,
        "notes": list(dict.fromkeys(notes)),
    }


def describe(found: Calibration, figures: Mapping[str, Any]) -> str:
    """Text for people."""
    title = (
        f"robot {found.robot.name!r}: {figures['drives']} drive{'s' if figures['drives'] > 1 else ''}, "
        f"{wording.duration(figures['duration_s'])}"
    )
    files = {"robot file": figures["output"], "floors": figures["floors"] if found.floor else None}
    written = [f"{name}: {path}" for name, path in files.items() if path]
    return wording.paragraphs(
        title,
        wording.table(PARAMETERS, parameter_rows(found)) if found.parameters else "",
        wording.fields(floor_fields(found.floor)) if found.floor else "",
        wording.bullets("Not identified", [f"{p.name}: {p.reason}" for p in found.parameters if not p.identified]),
        wording.assumptions(figures["notes"]),
        "\n".join(written) or "No robot file written; name one with -o.",
    )


def parameter_rows(found: Calibration) -> list[list[str]]:
    """Each parameter with its interval."""
    return [
        [
            p.name,
            f"{p.value:.4g}",
            f"{p.value - BAND_95 * p.std:.4g} to {p.value + BAND_95 * p.std:.4g}" if p.identified else "-",
            "" if p.identified else "kept",
        ]
        for p in found.parameters
    ]


def floor_fields(floor: Floor) -> dict[str, str]:
    """A learnt floor with its 95 % bands, by name."""
    return {
        "floor": floor.name,
        "stiffness": f"{floor.stiffness:.3g} ± {wording.percent(BAND_95 * floor.stiffness_std, 0)} (95 %)",
        "friction": f"{floor.friction:.3g} ± {wording.percent(BAND_95 * floor.friction_std, 0)} (95 %)",
        "across, side, speed power": f"{floor.across:.2f}, {floor.side:.2f}, {floor.speed_power:.2f}",
        "slip left unexplained": f"{floor.slip_std:.3f} of each wheel from drive to drive",
        "rolling, rollers": f"{floor.rolling:.3f}, {floor.roller:.3f} of the load",
    }
