"""Figures of a fleet: capacity against resistance of its batteries, and what they were over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.report import Figure, Series

_PERCENT = 100.0
_DAY_S = 86400.0
#: So many robots have a name of their own.
_MOST_NAMED = 6


def battery_map(batteries: Mapping[str, tuple[float, float]], marked: Sequence[str]) -> Figure:
    """Resistance over capacity of each robot's battery, as shares of the battery file's; marked: drawn by their names.

    batteries: robot -> capacity and resistance.
    """
    named = [robot for robot in marked if robot in batteries][:_MOST_NAMED]
    groups = {"the others" if named else "robots": [robot for robot in batteries if robot not in named]}
    groups |= {robot: [robot] for robot in named}
    series = []
    for label, robots in groups.items():
        points = _PERCENT * np.array([batteries[robot] for robot in robots]).reshape(-1, 2)
        if len(points):
            series.append(Series(points[:, 0], points[:, 1], label, "points"))
    title = "Capacity and resistance over the battery file's"
    return Figure(title, "Capacity [%]", "Resistance [%]", series, height_px=320)


def trend_figure(title: str, label: str, trends: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """A share of the battery file's at the end of each log, a line for each of the first robots.

    trends: robot -> Unix times (n,) [s] and shares (n,).
    """
    start_s = min((float(times[0]) for times, _ in trends.values()), default=0.0)
    drawn = list(trends.items())[:_MOST_NAMED]
    series = [Series((times - start_s) / _DAY_S, _PERCENT * values, robot) for robot, (times, values) in drawn]
    return Figure(title, "Days since the first log", label, series, height_px=320)
