"""Report of `ohmward soc`."""

from __future__ import annotations

from typing import Any

from ohmward.battery.cells.pack_estimator import PackRun
from ohmward.battery.soc.estimator import SocRun
from ohmward.cli.battery_inputs import SocTask
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.soc.anchors import HEADER as HEADER_OF_ANCHORS
from ohmward.cli.soc.anchors import TITLE, anchor_rows
from ohmward.cli.soc.cells import HEADER, cell_rows, cells_result
from ohmward.cli.soc.result import CAUSE_HEADER, SQUARES, cause_rows, headline, learnt, result
from ohmward.cli.wording import duration, normal, percent, quantity, sentence
from ohmward.figures import battery as pictures
from ohmward.figures.cells import cells_difference_figure, cells_soc_figure
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.report import Figure, Page, WallClock


def make_page(task: SocTask, name: str, answers: tuple[SocRun, PackRun | None], figures: dict[str, Any]) -> Page:
    """Key figures, plots above each other on one clock, assumptions.

    answers: of the battery, and of its cells where the log has them.
    figures: the summary of the run.
    """
    answer, cells = answers
    what = f"State of charge by {name}, battery {task.battery.name!r}, {duration(task.log.duration_s)}"
    explanation = figures["explanation"]
    page = Page(task.log.name, what, FOOTER)
    page = page.callout("info" if explanation["known"] and figures["fits"] else "warning", headline(figures))
    page = page.numbers(_numbers(figures)).plot(*_plots(task, answer), clock=wall_clock(task.log))
    if figures["anchors"]:
        page = page.heading(TITLE).table(HEADER_OF_ANCHORS, anchor_rows(figures))
    if cells:
        page = _cells(page, cells, figures, wall_clock(task.log))
    if explanation["causes"]:
        page = page.heading("What makes the band wide").table(CAUSE_HEADER, cause_rows(figures), sentence(SQUARES))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    return with_assumptions(page, task.notes)


def _cells(page: Page, cells: PackRun, figures: dict[str, Any], clock: WallClock | None) -> Page:
    """The page with the section on the cells of the pack."""
    page = page.heading("Cells")
    for warning in figures["cells"]["warnings"]:
        page = page.callout("warning", f"{warning['text']}.")
    page = page.table(["Quantity", "Value"], list(cells_result(figures).items()))
    page = page.plot(cells_soc_figure(cells), cells_difference_figure(cells), clock=clock)
    return page.table(HEADER, cell_rows(figures), "Half widths are those of the 95 % bands.")


def _numbers(figures: dict) -> dict[str, str]:
    half_band = BAND_95 * figures["soc_std_final"]
    numbers = {
        "SoC at the end": f"{100 * figures['soc_final']:.1f} ± {percent(half_band, 1)}",
        "RMSE": percent(figures["soc_rmse"]),
        "RMSE after 1 h": percent(figures["soc_rmse_after_1h"]),
        "Largest error": percent(figures["soc_max_error"]),
        "Truth in 95 % band": percent(figures["coverage_95"], 1),
        "Voltage error, RMS": quantity(figures["voltage_rmse_V"], "mV", 1e3),
        "Current offset": normal(learnt(figures, "current_offset_A"), "mA", 1e3),
    }
    return {label: value for label, value in numbers.items() if value != "-"}


def _plots(task: SocTask, answer: SocRun) -> list[Figure]:
    log, estimates = task.log, answer.estimates
    truth = task.truth.soc if task.truth else None
    plots = [pictures.soc_figure(log, estimates, truth)]
    if truth is not None:
        plots.append(pictures.soc_error_figure(log, estimates, truth))
    plots.append(pictures.current_figure(log, pictures.soc_flag_spans(log, estimates.flags)))
    plots.append(pictures.voltage_figure(log, estimates))
    if _any(estimates.voltage_V):
        plots.append(pictures.voltage_error_figure(log, estimates))
    if _any(estimates.current_offset_A):
        plots += [pictures.offset_figure(log, estimates), pictures.health_figure(log, estimates)]
    return plots


def _any(values) -> bool:
    return bool((values == values).any())
