"""Figures of the range left."""

from __future__ import annotations

import numpy as np

from ohmward.energy.range_estimator import RangeRun
from ohmward.report import TIME, Band, Figure, Series


def run_figures(run: RangeRun) -> list[Figure]:
    """Range left with its band from P10 to P90, and the probability of coming home where it was asked for."""
    figures = [range_figure(run)]
    if np.isfinite(run.home_probability).any():
        line = [Series(run.time_s, 100 * run.home_probability, "probability", role="estimate")]
        figures.append(
            Figure("Coming home with the reserve left", TIME, "Probability [%]", line, y_limits=(-2.0, 102.0))
        )
    return figures


def range_figure(run: RangeRun) -> Figure:
    """Range left, P50 and the band from P10 to P90."""
    p10, p50, p90 = (1e-3 * np.asarray(values) for values in run.distance_m)
    line = [Series(run.time_s, p50, "P50", role="estimate")]
    return Figure("Range left", TIME, "Range [km]", line, [Band(run.time_s, p10, p90, "P10 to P90")], height_px=300)
