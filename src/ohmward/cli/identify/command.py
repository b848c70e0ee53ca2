"""`ohmward identify`: from logs of tests to a battery file."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.file import replace_battery
from ohmward.battery.identification import IdentificationSettings, Identified, LogDetails, identify_in_detail
from ohmward.battery.identification.rc_identification import RcIdentification
from ohmward.battery.models import rc
from ohmward.cli import wording
from ohmward.cli.battery_inputs import read_battery_log, read_options, with_sensor
from ohmward.cli.outcome import Outcome, check_output
from ohmward.cli.progress import progress
from ohmward.cli.wording import FOOTER, with_assumptions
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.logs import Log
from ohmward.logs.selection import split_selection
from ohmward.report import Page


def run(args: argparse.Namespace) -> Outcome:
    """Identify the battery, write its file; the exit status is 1 if the model does not fit its tests."""
    check_output("--output", args.output, (".toml",), [str(split_selection(text)[0]) for text in args.logs])
    logs = [read_battery_log(text, read_options(args)) for text in args.logs]
    began = time.perf_counter()
    found = _identify(logs, args)
    seconds = time.perf_counter() - began
    backup = replace_battery(found.battery, args.output) if args.output else None
    figures = summary(found, seconds)
    notes = _notes(logs) + figures["notes"]
    figures |= {"notes": notes, "output": args.output, "backup": str(backup) if backup else None, "report": args.report}
    page = partial(make_page, found, notes)
    return Outcome(figures, describe(found.battery, figures), notes, page, status=int(not found.fits))


def _identify(logs: Sequence[Log], args: argparse.Namespace) -> Identified:
    settings = IdentificationSettings(
        args.capacity_ah,
        args.model,
        args.chemistry,
        args.n_series,
        args.name,
        _starts(logs, args.initial_soc),
        args.idle_current,
        args.ocv,
    )
    with progress() as report:
        found = identify_in_detail(logs, settings, report)
    battery, _ = with_sensor(found.battery, args)
    return found._replace(battery=battery)


def _notes(logs: Sequence[Log]) -> list[str]:
    """Assumptions about the logs, with their names where there are several."""
    if len(logs) == 1:
        return [str(note) for note in logs[0].notes]
    return [f"{note.level}: {log.name}: {note.text}" for log in logs for note in log.notes]


def _starts(logs: Sequence[Log], given: Sequence[tuple[str, float]]) -> dict[str, float]:
    """Initial SoC by the log's name; a value without a name holds for all that are not named."""
    starts: dict[str, float] = {}
    for soc in (soc for name, soc in given if not name):
        starts |= dict.fromkeys((log.name for log in logs), soc)
    return starts | {name: soc for name, soc in given if name}


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


HEADER = ["RC model", "75 % rule", "least squares"]

#: Rows of the table: name, key of `rc_summary`, unit and its scale.
_ROWS = (
    ("C_b", "c_bulk_F", "F", 1.0),
    ("C_s", "c_surface_F", "F", 1.0),
    ("R_b", "r_bulk_ohm", "mohm", 1e3),
    ("R_s", "r_surface_ohm", "mohm", 1e3),
    ("R_t", "r_terminal_ohm", "mohm", 1e3),
    ("R_0, at once", "r0_ohm", "mohm", 1e3),
    ("R_0 + R_1, steady", "dc_ohm", "mohm", 1e3),
    ("time constant", "tau_s", "s", 1.0),
    ("voltage error, RMS", "residual_rms_V", "mV", 1e3),
)


def rc_summary(found: RcIdentification) -> dict[str, Any]:
    """Object of --json: elements, resistances, time constant and error of the voltage by the rule and by the fit.

    used: the one that the battery file holds.  fit: null where least squares were not possible.
    """
    response, fit = found.response, found.fit
    rule = _circuit(found.rule, found.tau.found, found.rule_rms_V)
    return {
        "used": "rule" if fit is None else "fit",
        "rule": rule | {"edges": response.edges, "delay_s": response.delay_s, "window_s": response.window_s},
        "fit": None if fit is None else _circuit(found.model, fit.r1_ohm > 0, fit.rms_V),
    }


def rc_rows(summary: dict[str, Any]) -> list[list[str]]:
    """Rows of a table under `HEADER`; "-" for what the log does not show."""
    sides = summary["rule"], summary["fit"] or {}
    return [
        [name, *(wording.quantity(side.get(key), unit, scale) for side in sides)] for name, key, unit, scale in _ROWS
    ]


def _circuit(model: rc.RcModel, relaxes: bool, rms_V: float) -> dict[str, Any]:
    """Elements of a circuit and what the voltage shows of them; relaxes: True where the log shows a time constant."""
    _, r0, r1, tau_s = rc.four_numbers(model)
    rest = {"r0_ohm": r0, "dc_ohm": r0 + r1, "tau_s": tau_s if relaxes else None, "residual_rms_V": rms_V}
    return model.circuit._asdict() | rest


_MOST_RELAXATIONS = 6


def make_page(found: Identified, notes: Sequence[str]) -> Page:
    """The chain from top to bottom: result, open-circuit voltage, resistances, each log with its rests."""
    battery = found.battery
    page = Page(f"Battery {battery.name!r}", _subtitle(battery), FOOTER).numbers(_numbers(battery))
    if not found.fits:
        page = page.callout("warning", MISFIT)
    for text in battery.not_identified:
        page = page.callout("warning", f"Not identified: {text}")
    page = _circuit_plots(page, found)
    for details in found.logs:
        page = _log(page, details)
    page = _rc(page, found)
    page = page.heading("Parameters").table(FITS, fit_rows(battery), "How well each log is reproduced")
    if rows := parameter_rows(battery):
        page = page.table(PARAMETERS, rows, "Parameters with 95 % confidence intervals")
    return with_assumptions(page, notes)


def _subtitle(battery: Battery) -> str:
    cells = f"{battery.n_series} cells in series" if battery.n_series > 1 else "one cell"
    return ", ".join(part for part in (battery.chemistry, cells, f"{battery.capacity_Ah:g} Ah") if part)


def _numbers(battery: Battery) -> dict[str, str]:
    numbers = {"Capacity": f"{battery.capacity_Ah:.4g} Ah"}
    if p := battery.thevenin:
        middle = len(p.r0_discharge_ohm) // 2
        numbers["R0 at 50 %"] = f"{1e3 * p.r0_discharge_ohm[middle]:.3g} mΩ"
        for j, (row, tau_s) in enumerate(zip(p.r_ohm, p.tau_s, strict=True), start=1):
            numbers[f"R{j} at 50 %"] = f"{1e3 * row[middle]:.3g} mΩ"
            numbers[f"Time constant {j}"] = pictures.seconds_text(tau_s)
    fits = battery.identification.logs if battery.identification else ()
    if worst_V := max((fit.residual_rms_V for fit in fits), default=0.0):
        numbers["Voltage error, RMS"] = f"{1e3 * worst_V:.3g} mV"
    return numbers


def _circuit_plots(page: Page, found: Identified) -> Page:
    """Open-circuit voltage and resistances."""
    model = found.battery.thevenin
    rests = [rest for log in found.logs for rest in log.rests]
    ocv = model.ocv if model else found.battery.rc.ocv if found.battery.rc else found.first_ocv
    page = page.heading("Open-circuit voltage").plot(pictures.ocv_figure(ocv, found.branches, rests, found.fit))
    if model and any(model.r0_discharge_ohm):
        page = page.heading("Resistances").plot(pictures.resistance_figure(model, found.fit))
    edges = [edge for log in found.logs for edge in log.edges]
    return page.plot(pictures.edge_figure(edges)) if edges else page


def _rc(page: Page, found: Identified) -> Page:
    """The RC model: the rule's values beside those of least squares, and the voltage after the edges."""
    if found.rc is None:
        return page
    circuits = {HEADER[1]: found.rc.rule} | ({HEADER[2]: found.rc.model} if found.rc.fit else {})
    page = page.heading("RC model").table(HEADER, rc_rows(rc_summary(found.rc)))
    return page.plot(pictures.edge_response_figure(found.rc.response, circuits))


def _log(page: Page, details: LogDetails) -> Page:
    """One log: fit and residuals, then how the voltage relaxes in some of its rests."""
    page = page.heading(f"Fit of {details.record.log.name}").plot(
        *pictures.fit_figures(details), clock=wall_clock(details.record.log)
    )
    residual_mV = 1e3 * np.concatenate(details.residual_V)
    if np.isfinite(residual_mV).any():
        page = page.plot(pictures.histogram_figure(residual_mV, "Residuals", "Measured - simulated voltage [mV]"))
    rests = _spread_out(details.relaxations)
    if rests:
        page = page.heading(f"Relaxation in {details.record.log.name}")
        page = page.text("Each rest fitted with one and with two time constants; the circuit is fitted to all at once.")
    for rest in rests:
        page = page.plot(pictures.relaxation_figure(rest))
    return page


def _spread_out(rests: Sequence) -> Sequence:
    """At most six of the rests, from the first to the last."""
    if len(rests) <= _MOST_RELAXATIONS:
        return rests
    return [rests[k] for k in np.linspace(0, len(rests) - 1, _MOST_RELAXATIONS).round().astype(int)]
