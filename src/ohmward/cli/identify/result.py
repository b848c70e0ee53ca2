"""Figures of `ohmward identify`, for programs and for people."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ohmward.battery.battery import Battery
from ohmward.battery.identification import Identified
from ohmward.cli import wording
from ohmward.cli.identify.rc import HEADER, rc_rows, rc_summary

PARAMETERS = ["parameter", "value", "95 % interval"]
MISFIT = "The model does not fit these tests, do not use the file: see the warnings below."
FITS = ["log", "test", "SoC", "voltage error, RMS", "largest"]


def summary(found: Identified, seconds: float) -> dict[str, Any]:
    """The object of --json."""
    battery = found.battery
    source = battery.identification
    return {
        "command": "identify",
        "name": battery.name,
        "model": f"thevenin-{battery.thevenin.pairs}rc" if battery.thevenin else "rc",
        "chemistry": battery.chemistry or None,
        "n_series": battery.n_series,
        "capacity_Ah": battery.capacity_Ah,
        "sensor": asdict(battery.sensor),
        "capacity_measured_Ah": source.capacity_measured_Ah or None if source else None,
        "parameters": [asdict(c) for c in source.confidence] if source else [],
        "fits": found.fits,
        "rc": rc_summary(found.rc) if found.rc else None,
        "logs": [asdict(fit) for fit in source.logs] if source else [],
        "not_identified": list(battery.not_identified),
        "seconds": seconds,
        "notes": list(source.notes) if source else [],
    }


def describe(battery: Battery, figures: dict[str, Any]) -> str:
    """Text for people."""
    measured = wording.quantity(figures["capacity_measured_Ah"], "Ah", digits=4)
    capacity = f"{battery.capacity_Ah:g} Ah given" + ("" if measured == "-" else f", {measured} measured")
    title = f"battery {battery.name!r}: {figures['model']}, {capacity}; identified in {figures['seconds']:.2g} s"
    written = wording.written_battery(figures) if figures["output"] else "No battery file written; name one with -o."
    return wording.paragraphs(
        title,
        "" if figures["fits"] else MISFIT,
        wording.table(PARAMETERS, rows) if (rows := parameter_rows(battery, at_soc="0.5")) else "",
        wording.table(HEADER, rc_rows(figures["rc"])) if figures["rc"] and figures["model"] == "rc" else "",
        wording.table(FITS, fit_rows(battery)),
        wording.bullets("Not identified", battery.not_identified),
        wording.assumptions(figures["notes"]),
        written,
    )


def parameter_rows(battery: Battery, at_soc: str = "") -> list[list[str]]:
    """Each parameter with its confidence interval, in the unit of its name.

    at_soc: of the resistances along SoC only those at this one.
    """
    confidence = battery.identification.confidence if battery.identification else ()
    wanted = [
        c for c in confidence if " at soc " not in c.name or c.name.endswith(f"at soc {at_soc}" if at_soc else "")
    ]
    return [[c.name, f"{c.value:.4g}", f"{c.low:.4g} to {c.high:.4g}"] for c in wanted]


def fit_rows(battery: Battery) -> list[list[str]]:
    """Errors of the voltage of each log as it is reproduced."""
    fits = battery.identification.logs if battery.identification else ()
    return [
        [
            fit.log,
            fit.test,
            f"{max(100 * fit.soc_min, 0.0):.0f} to {100 * fit.soc_max:.0f} %",
            wording.quantity(fit.residual_rms_V or None, "mV", 1e3),
            wording.quantity(fit.residual_max_V or None, "mV", 1e3),
        ]
        for fit in fits
    ]
