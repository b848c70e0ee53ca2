"""Figures of `ohmward twin`, for programs and for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmward.cli import wording
from ohmward.export.twin import Twin, output_columns
from ohmward.logs import DriveLog, Log


def summary(
    twin: Twin, log: Log | DriveLog, outputs: Any, seconds: float, compared: Mapping[str, Any]
) -> dict[str, Any]:
    """The object of --json.

    compared: `compared_with` and `differences`.
    """
    return {
        "command": "twin",
        "name": twin.name,
        "log": log.name,
        "steps": len(log),
        "seconds": seconds,
        "final": {name: float(column[-1]) for name, column in output_columns(outputs).items()},
        "flags": twin.flag_counts(outputs),
        **compared,
        "notes": [str(note) for note in log.notes],
    }


def describe(figures: dict[str, Any]) -> str:
    """Text for people."""
    rows = {name: f"{value:.6g}" for name, value in figures["final"].items()}
    step_s = figures["seconds"] / max(figures["steps"], 1)
    rows |= {
        "flagged samples": wording.flagged(figures["flags"]),
        "steps": f"{figures['steps']:,}, {1e9 * step_s:.0f} ns each",
    }
    differences = figures["differences"] or {}
    table = [[name, f"{value:.2g}"] for name, value in differences.items()]
    return wording.paragraphs(
        f"{figures['log']} through {figures['name']!r} of {figures['library']}, after the last sample",
        wording.fields(rows),
        f"Compared with double precision. {figures['compared_with']}:" if table else "",
        wording.table(["", "largest difference"], table) if table else "",
        wording.assumptions(figures["notes"]),
    )
