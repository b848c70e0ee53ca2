"""Figures of `ohmward learn`, for programs and for people."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.learning.known import known
from ohmward.cli import wording
from ohmward.cli.learn.files import BatteryFiles
from ohmward.cli.learn.journal import Row
from ohmward.cli.outcome import plain
from ohmward.cli.wording import lognormal, normal
from ohmward.filters.consistency import BAND_95
from ohmward.logs.note import counted

#: Columns of the logs.
LOGS = ["log", "verdict", "hours", "SoC", "capacity", "resistance", "error", "taught"]
#: Columns of a battery file.
CHANGES = ["", "before", "after"]
_VERDICTS = ("learnt", "seen", "set aside")


def summary(
    args: argparse.Namespace, files: BatteryFiles, rows: Sequence[Row], written: Mapping[str, str | None]
) -> dict[str, Any]:
    """The object of --json."""
    counts = {verdict.replace(" ", "_"): sum(row["verdict"] == verdict for row in rows) for verdict in _VERDICTS}
    return {
        "command": "learn",
        "battery": args.battery,
        "dry_run": args.dry_run,
        "output": args.output,
        "report": args.report,
        **counts,
        "hours": sum(row["hours"] for row in rows if row["verdict"] == "learnt"),
        "files": [
            {
                "output": key or None,
                "written": key in written,
                "backup": written.get(key),
                "name": after.name,
                "serial_number": after.serial_number or None,
                "before": state(files.before[key]),
                "after": state(after),
            }
            for key, after in files.after.items()
        ],
        "logs": list(rows),
    }


def state(battery: Battery) -> dict[str, Any]:
    """Knowledge of a battery file, each quantity with its standard deviation."""
    found = known(battery)
    return plain(
        {
            "capacity_Ah": found.capacity_Ah._asdict(),
            "resistance_ohm": found.resistance_ohm._asdict(),
            "current_offset_A": found.offset_A._asdict(),
            "ocv_std_V": float(np.median(found.ocv_std_V)),
            "logs": found.logs,
            "hours": found.hours,
        }
    )


def describe(figures: Mapping[str, Any]) -> str:
    """Text for people."""
    return wording.paragraphs(
        title(figures),
        *(f"{headline(file)}\n{wording.table(CHANGES, change_rows(file))}" for file in figures["files"]),
        wording.table(LOGS[:-1], [row[:-1] for row in log_rows(figures["logs"])]) if figures["logs"] else "",
        wording.bullets("Taught", [f"{row['log']}: {row['reason']}" for row in learnt(figures["logs"])]),
        wording.bullets("Not learnt from", not_learnt(figures["logs"])),
        wording.assumptions(figures["notes"]),
        ending(figures),
    )


def title(figures: Mapping[str, Any]) -> str:
    """Number of logs by their verdict, in a line."""
    parts = [f"{figures[verdict.replace(' ', '_')]} {verdict}" for verdict in _VERDICTS]
    before = f", {figures['resumed']} of them before the interruption" if figures["resumed"] else ""
    return f"{counted(len(figures['logs']), 'log')}: {', '.join(parts)}{before}; {figures['hours']:.1f} h learnt from"


def headline(file: Mapping[str, Any]) -> str:
    """Name of a battery, with its serial number and its file."""
    number = f", serial number {file['serial_number']}" if file["serial_number"] else ""
    return f"battery {file['name']!r}{number}"


def ending(figures: Mapping[str, Any]) -> str:
    """Files that were written, or the reason why none was."""
    if figures["dry_run"]:
        return "No battery file written: --dry-run."
    if figures["output"] is None:
        return "No battery file written; name one with -o."
    lines = []
    for file in figures["files"]:
        if file["written"]:
            lines.append(wording.written_battery(file))
        else:
            lines.append(f"battery file: {file['output']}, nothing new")
    return "\n".join(lines) or "No battery file written: no log was of any use."


def change_rows(file: Mapping[str, Any]) -> list[list[str]]:
    """The quantities of a battery file before and after."""
    old, new = file["before"], file["after"]
    table = [
        ["capacity", *(normal(one["capacity_Ah"], "Ah") for one in (old, new))],
        ["resistance, 10 s", *(lognormal(one["resistance_ohm"], "mΩ", 1e3) for one in (old, new))],
        ["current offset", *(normal(one["current_offset_A"], "mA", 1e3) for one in (old, new))],
    ]
    curve = [wording.quantity(one["ocv_std_V"], "mV", BAND_95 * 1e3, 2) for one in (old, new)]
    learnt_from = [f"{counted(one['logs'], 'log')}, {one['hours']:.1f} h" for one in (old, new)]
    return [*table, ["open-circuit curve", *(f"± {text}" for text in curve)], ["learnt from", *learnt_from]]


def log_rows(rows: Sequence[Row]) -> list[list[str]]:
    """A row for each log: its verdict, its range, and what is known after it."""
    return [
        [
            row["log"],
            row["verdict"],
            f"{row['hours']:.1f}" if row.get("hours") is not None else "-",
            _range(row),
            normal(row["capacity_Ah"], "Ah") if row["verdict"] == "learnt" else "-",
            lognormal(row["resistance_ohm"], "mΩ", 1e3) if row["verdict"] == "learnt" else "-",
            wording.quantity(row.get("residual_rms_V"), "mV", 1e3),
            row["reason"],
        ]
        for row in rows
    ]


def learnt(rows: Sequence[Row]) -> list[Row]:
    """The rows of the logs that taught something."""
    return [row for row in rows if row["verdict"] == "learnt"]


def not_learnt(rows: Sequence[Row]) -> list[str]:
    """The other logs, each with its reason."""
    return [f"{row['log']}, {row['verdict']}: {row['reason']}" for row in rows if row["verdict"] != "learnt"]


def _range(row: Row) -> str:
    low, high = row.get("soc_min"), row.get("soc_max")
    if low is None or high is None:
        return "-"
    return f"{100 * low:.0f} to {100 * high:.0f} %"
