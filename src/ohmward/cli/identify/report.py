"""Report of `ohmward identify`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.battery.battery import Battery
from ohmward.battery.identification import Identified, LogDetails
from ohmward.cli.identify.rc import HEADER, rc_rows, rc_summary
from ohmward.cli.identify.result import FITS, MISFIT, PARAMETERS, fit_rows, parameter_rows
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.report import Page

_MOST_RELAXATIONS = 6


def make_page(found: Identified, notes: Sequence[str]) -> Page:
    """The chain from top to bottom: result, open-circuit voltage, resistances, each log with its rests."""
    battery = found.battery
    page = Page(f"Battery {battery.name!r}", _subtitle(battery), FOOTER).numbers(_numbers(battery))
    if not found.fits:
        page = page.callout("warning", MISFIT)
    for text in battery.not_identified:
        page = page.callout("warning", f"Not identified: {text}")
    page = _circuit(page, found)
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


def _circuit(page: Page, found: Identified) -> Page:
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
