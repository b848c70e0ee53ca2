"""Report of `ohmward tune`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.tune.result import HEADER, NOT_TOLD, TuneTask, ending, factor_rows, innovations, title
from ohmward.figures.parts import wall_clock
from ohmward.filters.consistency import BAND_95
from ohmward.report import TIME, Band, Figure, Page, Series


def make_page(task: TuneTask, figures: Mapping[str, Any]) -> Page:
    """The noise before and after, and the innovations of each log with both."""
    page = Page(f"Noise of battery {task.battery.name!r}", title(task), FOOTER)
    page = page.callout("info" if figures["explains"] else "warning", innovations(figures))
    page = page.table(HEADER, factor_rows(figures), "With 95 % intervals")
    page = page.callout("info", f"{NOT_TOLD}\n\n{ending(figures)}")
    for log, found in zip(task.logs, task.tuning.innovations, strict=True):
        page = page.heading(log.name).plot(
            _innovations(log.time_s, found[:, 0], "With the noise of the file"),
            _innovations(log.time_s, found[:, 1], "With the tuned noise"),
            clock=wall_clock(log),
        )
    return with_assumptions(page, task.notes) if task.notes else page


def _innovations(time_s: np.ndarray, innovation: np.ndarray, name: str) -> Figure:
    """Innovations in their standard deviations, and the band in which 95 % of them should lie."""
    ends = time_s[[0, -1]]
    limit = np.full(2, BAND_95)
    return Figure(
        name,
        TIME,
        "Innovation [σ]",
        [Series(time_s, innovation, "innovation", "points", "estimate")],
        [Band(ends, -limit, limit, "95 % of them", "reference")],
        y_limits=(-6.0, 6.0),
        height_px=200,
    )
