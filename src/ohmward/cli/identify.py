"""`ohmward identify`: from logs of tests to a battery file."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery, ConfidenceInterval, LogFit
from ohmward.battery.file import replace_battery
from ohmward.battery.identification import IdentificationSettings, Identified, LogDetails, identify_in_detail
from ohmward.cli.battery_inputs import read_battery_log, read_options, with_sensor
from ohmward.cli.outcome import Outcome, check_output, progress
from ohmward.cli.wording import bullets, paragraphs, sentence, table, written_battery
from ohmward.figures import battery as pictures
from ohmward.figures.numbers import quantity
from ohmward.figures.parts import wall_clock
from ohmward.lab import lab
from ohmward.logs.selection import split_selection
from ohmward.report import Page

PARAMETERS = ["parameter", "value", "95 % interval"]
MISFIT = "The model does not fit these tests, do not use the file: see the warnings below."
FITS = ["log", "test", "SoC", "voltage error, RMS", "largest"]

#: Rows of the table of the RC model: name, key of `rc_summary`, unit and its scale.
_ROWS = (
    ("C_b", "c_bulk_F", "F", 1.0),
    ("C_s", "c_surface_F", "F", 1.0),
    ("R_b", "r_bulk_ohm", "mohm", 1e3),
    ("R_s", "r_surface_ohm", "mohm", 1e3),
    ("R_t", "r_terminal_ohm", "mohm", 1e3),
    ("R_0, at once", "r0_ohm", "mohm", 1e3),
    ("R_0 + R_1, steady", "dc_ohm", "mohm", 1e3),
    ("time constant", "tau_s", "s", 1.0),
)
_MOST_RELAXATIONS = 6


def run(args: argparse.Namespace) -> Outcome:
    """Identify the battery, write its file; the exit status is 1 if the model does not fit its tests."""
    check_output("--output", args.output, (".toml",), [str(split_selection(text)[0]) for text in args.logs])
    logs = [read_battery_log(text, read_options(args)) for text in args.logs]
    began = time.perf_counter()
    named = {name: soc for name, soc in args.initial_soc if name}
    # a value without a name holds for all logs that are not named
    for_all = [soc for name, soc in args.initial_soc if not name]
    starts = dict.fromkeys([log.name for log in logs], for_all[-1]) if for_all else {}
    settings = IdentificationSettings(
        args.capacity_ah,
        args.model,
        args.chemistry,
        args.n_series,
        args.name,
        starts | named,
        args.idle_current,
        args.ocv,
    )
    with progress() as report:
        found = identify_in_detail(logs, settings, report)
    as_rc = args.model == "rc"
    battery, _ = with_sensor(found.battery, args)
    found = found._replace(battery=battery)
    seconds = time.perf_counter() - began
    backup = replace_battery(battery, args.output) if args.output else None
    several = len(logs) > 1
    notes = []
    for log in logs:
        notes += [f"{note.level}: {log.name}: {note.text}" if several else str(note) for note in log.notes]
    assert battery.identification is not None
    notes += battery.identification.notes
    written = {"output": args.output, "backup": str(backup) if backup else None, "report": args.report}
    figures = summary(found, seconds, as_rc) | {"notes": notes} | written
    page = partial(make_page, found, figures)
    return Outcome(figures, describe(figures), notes, page, status=int(not found.fits))


def summary(found: Identified, seconds: float, as_rc: bool = False) -> dict[str, Any]:
    """The object of --json without the notes and the files; as_rc: with the circuit as an RC model."""
    battery = found.battery
    source = battery.identification
    assert source is not None
    return {
        "command": "identify",
        "name": battery.name,
        "model": "rc" if as_rc else f"thevenin-{battery.thevenin.pairs}rc",
        "chemistry": battery.chemistry or None,
        "n_series": battery.n_series,
        "capacity_Ah": battery.capacity_Ah,
        "sensor": battery.sensor,
        "capacity_measured_Ah": source.capacity_measured_Ah or None,
        "parameters": source.confidence,
        "fits": found.fits,
        "rc": rc_summary(battery) if as_rc else None,
        "logs": source.logs,
        "not_identified": battery.not_identified,
        "seconds": seconds,
    }


def describe(figures: Mapping[str, Any]) -> str:
    """Text for people."""
    measured = quantity(figures["capacity_measured_Ah"], "Ah", digits=4)
    capacity = f"{figures['capacity_Ah']:g} Ah given" + ("" if measured == "-" else f", {measured} measured")
    title = f"battery {figures['name']!r}: {figures['model']}, {capacity}; identified in {figures['seconds']:.2g} s"
    written = written_battery(figures) if figures["output"] else "No battery file written; name one with -o."
    return paragraphs(
        title,
        "" if figures["fits"] else MISFIT,
        table(PARAMETERS, rows) if (rows := parameter_rows(figures["parameters"], at_soc="0.5")) else "",
        table(["RC model", "value"], rc_rows(figures["rc"])) if figures["rc"] else "",
        table(FITS, fit_rows(figures["logs"])),
        bullets("Not identified", figures["not_identified"]),
        written,
    )


def parameter_rows(confidence: Sequence[ConfidenceInterval], at_soc: str = "") -> list[list[str]]:
    """Each parameter with its confidence interval, in the unit of its name.

    at_soc: the only state of charge whose resistances are listed; "" lists those of every one.
    """
    wanted = [
        c for c in confidence if " at soc " not in c.name or c.name.endswith(f"at soc {at_soc}" if at_soc else "")
    ]
    return [[c.name, f"{c.value:.4g}", f"{c.low:.4g} to {c.high:.4g}"] for c in wanted]


def fit_rows(fits: Sequence[LogFit]) -> list[list[str]]:
    """Test, SoC range and errors of the simulated voltage of each log."""
    return [
        [
            fit.log,
            fit.test,
            f"{max(100 * fit.soc_min, 0.0):.0f} to {100 * fit.soc_max:.0f} %",
            quantity(fit.residual_rms_V or None, "mV", 1e3),
            quantity(fit.residual_max_V or None, "mV", 1e3),
        ]
        for fit in fits
    ]


def rc_summary(battery: Battery) -> dict[str, Any]:
    """The circuit as the RC model that is closest to it: its elements, resistances and time constant."""
    rc = lab("published.rc")
    model = rc.rc_of_thevenin(battery.thevenin)
    _, r0, r1, tau_s = rc.four_numbers(model)
    return model.circuit._asdict() | {"r0_ohm": r0, "dc_ohm": r0 + r1, "tau_s": tau_s}


def rc_rows(figures: dict[str, Any]) -> list[list[str]]:
    """Rows of the table of the RC model."""
    return [[name, quantity(figures[key], unit, scale)] for name, key, unit, scale in _ROWS]


def make_page(found: Identified, figures: Mapping[str, Any]) -> Page:
    """Report from top to bottom: result, open-circuit voltage, resistances, each log with its rests."""
    battery, model = found.battery, found.battery.thevenin
    cells = f"{battery.n_series} cells in series" if battery.n_series > 1 else "one cell"
    what = ", ".join(part for part in (battery.chemistry, cells, f"{battery.capacity_Ah:g} Ah") if part)
    page = Page(f"Battery {battery.name!r}", what).numbers(_numbers(battery, figures["logs"]))
    if not found.fits:
        page = page.callout("warning", MISFIT)
    rests = list(chain.from_iterable(log.rests for log in found.logs))
    page = page.heading("Open-circuit voltage").plot(pictures.ocv_figure(model.ocv, found.branches, rests, found.fit))
    if any(model.r0_discharge_ohm):
        page = page.heading("Resistances").plot(pictures.resistance_figure(model, found.fit))
    if edges := list(chain.from_iterable(log.edges for log in found.logs)):
        page = page.plot(pictures.edge_figure(edges))
    if battery.not_identified:
        page = page.heading("Not identified")
    for text in battery.not_identified:
        page = page.callout("warning", sentence(text))
    for details in found.logs:
        page = _log(page, details)
    if figures["rc"]:
        page = page.heading("RC model").table(["RC model", "value"], rc_rows(figures["rc"]))
    page = page.heading("Parameters").table(FITS, fit_rows(figures["logs"]), "How well each log is reproduced")
    if rows := parameter_rows(figures["parameters"]):
        page = page.table(PARAMETERS, rows, "Parameters with 95 % confidence intervals")
    return page


def _numbers(battery: Battery, fits: Sequence[LogFit]) -> dict[str, str]:
    p = battery.thevenin
    middle = len(p.r0_discharge_ohm) // 2
    numbers = {"Capacity": f"{battery.capacity_Ah:.4g} Ah", "R0 at 50 %": f"{1e3 * p.r0_discharge_ohm[middle]:.3g} mΩ"}
    for j, (row, tau_s) in enumerate(zip(p.r_ohm, p.tau_s, strict=True), start=1):
        numbers[f"R{j} at 50 %"] = f"{1e3 * row[middle]:.3g} mΩ"
        numbers[f"Time constant {j}"] = pictures.seconds_text(tau_s)
    if worst_V := max((fit.residual_rms_V for fit in fits), default=0.0):
        numbers["Voltage error, RMS"] = f"{1e3 * worst_V:.3g} mV"
    return numbers


def _log(page: Page, details: LogDetails) -> Page:
    """One log: fit and residuals, then how the voltage relaxes in some of its rests."""
    page = page.heading(f"Fit of {details.record.log.name}").plot(
        *pictures.fit_figures(details), clock=wall_clock(details.record.log)
    )
    residual_mV = 1e3 * np.concatenate(details.residual_V)
    if np.isfinite(residual_mV).any():
        page = page.plot(pictures.residuals_figure(residual_mV))
    rests = list(details.relaxations)
    if len(rests) > _MOST_RELAXATIONS:  # from the first to the last
        rests = [rests[k] for k in np.linspace(0, len(rests) - 1, _MOST_RELAXATIONS).round().astype(int)]
    if rests:
        page = page.heading(f"Relaxation in {details.record.log.name}")
        page = page.text("Each rest fitted with one and with two time constants; the circuit is fitted to all at once.")
    for rest in rests:
        page = page.plot(pictures.relaxation_figure(rest))
    return page
