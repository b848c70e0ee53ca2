"""Report of `ohmward health`."""

from __future__ import annotations

from typing import Any

from ohmward.cli.health.result import LOGS, HealthTask, change_text, life_text, log_rows, off_text, result, span
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import lognormal, normal, sentence
from ohmward.figures.health import capacity_figure, life_figure, resistance_figure
from ohmward.report import Page


def make_page(task: HealthTask, figures: dict[str, Any]) -> Page:
    """Key figures, trends, the time left, and the logs.

    figures: the summary of the run.
    """
    page = Page(f"Health of battery {figures['battery']!r}", span(figures), FOOTER).numbers(_numbers(figures))
    for step in figures["sudden_changes"]:
        page = page.callout("warning", sentence(f"sudden change {change_text(step)}"))
    for outlier in figures["off_trend"]:
        page = page.callout("info", sentence(off_text(outlier)))
    page = page.heading("Trend").plot(capacity_figure(task.health), resistance_figure(task.health))
    page = page.heading("Time left").text(sentence(f"Down to {figures['worn_share']:.0%}: {life_text(figures)}"))
    page = page.plot(life_figure(task.health.ahead))
    page = page.heading("Result").table(["Quantity", "Value, 95 %"], list(result(figures).items()))
    page = page.heading("Logs").table(LOGS, log_rows(figures, task.health.points), "What each log shows by itself")
    return with_assumptions(page, task.notes)


def _numbers(figures: dict[str, Any]) -> dict[str, str]:
    numbers = {
        "Capacity": normal(figures["soh_capacity"], "%", 100),
        "Resistance": lognormal(figures["resistance_ratio"], "%", 100),
        f"Down to {figures['worn_share']:.0%} within a year": f"{figures['worn_within']['year']:.0%}",
    }
    return {name: value for name, value in numbers.items() if value != "-"}
