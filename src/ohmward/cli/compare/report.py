"""Report of `ohmward compare`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ohmward.battery.soc.estimator import SocRun
from ohmward.battery.soc.registry import title_of
from ohmward.cli.battery_inputs import SocTask
from ohmward.cli.compare.result import tables_of
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import duration
from ohmward.figures import battery as pictures
from ohmward.figures.parts import wall_clock
from ohmward.report import Page


def make_page(task: SocTask, answers: Mapping[str, SocRun], figures: Mapping[str, Any]) -> Page:
    """Tables, the state of charge of all on one clock, their errors."""
    log = task.log
    what = f"{len(answers)} estimators, battery {task.battery.name!r}, {duration(log.duration_s)}"
    page = Page(f"{log.name}: estimators compared", what, FOOTER)
    for header, rows in tables_of(task, figures):
        page = page.table(header, [[None if cell == "-" else cell for cell in row] for row in rows])
    estimates = {name: answer.estimates for name, answer in answers.items()}
    plots = [pictures.soc_comparison_figure(log, estimates, task.truth.soc if task.truth else None)]
    if task.truth:
        plots.append(pictures.soc_errors_figure(log, estimates, task.truth.soc))
    page = page.plot(*plots, pictures.current_figure(log), pictures.voltage_figure(log), clock=wall_clock(log))
    page = page.heading("Estimators").table(["Name", "What it is"], [[n, title_of(n)] for n in answers])
    return with_assumptions(page, task.notes)
