"""Report of `ohmward doctor`."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward.cli.doctor.battery import BatteryFindings, add_battery
from ohmward.cli.doctor.result import contents
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import duration, grouped, sentence
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.logs import Log
from ohmward.logs.doctor import Findings
from ohmward.report import Figure, Page


def make_page(logs: Sequence[Log], found: Sequence[Findings], batteries: Sequence[BatteryFindings]) -> Page:
    """One section for each log and battery file: figures, findings, plots, assumptions."""
    names = [log.name for log in logs] + [one.battery.name for one in batteries]
    title = names[0] if len(names) == 1 else f"{len(names)} {'files' if batteries else 'logs'}"
    page = Page(title, "What is in it, what is wrong, what was assumed", FOOTER)
    for log, findings in zip(logs, found, strict=True):
        page = _section(page if len(names) == 1 else page.heading(log.name), log, findings)
    for one in batteries:
        page = add_battery(page if len(names) == 1 else page.heading(one.battery.name), one)
    return page


def _section(page: Page, log: Log, found: Findings) -> Page:
    s = found.survey
    figures = {
        "Samples": grouped(len(log)),
        "Duration": duration(log.duration_s),
        "Interval": f"{s.sampling.median_s:.3g} s",
        "Charge in": f"{s.activity.charge_in_Ah:.4g} Ah",
        "Charge out": f"{s.activity.charge_out_Ah:.4g} Ah",
        "Rests": str(s.activity.rests),
        "Pulses": str(s.activity.pulses),
    }
    page = page.numbers(figures)
    for finding in found.findings:
        page = page.callout(finding.severity, f"{sentence(finding.text)}\n\n{sentence(finding.advice)}")
    page = page.plot(*_plots(log), clock=wall_clock(log)).table(
        ["Quantity", "Found"], list(contents(log, found).items())
    )
    return with_assumptions(page, found.notes)


def _plots(log: Log) -> list[Figure]:
    plots = [pictures.current_figure(log), pictures.voltage_figure(log)]
    if log.temperature_degC is not None:
        plots.append(pictures.temperature_figure(log))
    return [*plots, pictures.interval_figure(log)] if len(log) > 1 else plots
