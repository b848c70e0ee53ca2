"""Figures of battery health: capacity and resistance over months, the time to wear-out, and a fleet's batteries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.battery.health.ageing import DAYS_PER_YEAR, UNINFORMATIVE_STD, AgeingFit, LifeAhead
from ohmward.battery.health.health import BatteryHealth, Health
from ohmward.filters.consistency import BAND_95
from ohmward.quantities import DAY_S
from ohmward.report import Band, Figure, Marker, Series
from ohmward.report.figure import Role

#: Points of the trend between the first and the last log.
_TREND_POINTS = 200
_PERCENT = 100.0
#: Shortest time ahead that is drawn; it is as long as the time behind where that is longer.
_LEAST_AHEAD_DAYS = 30.0
#: Units of a span of time and their days; the first that is shorter than a quarter of the span is taken.
_UNITS = {"Years": DAYS_PER_YEAR, "Months": DAYS_PER_YEAR / 12, "Days": 1.0}


def capacity_figure(health: Health) -> Figure:
    """Capacity relative to new: each log by itself, the trend, and the forecast."""
    now_days, _ = health.now
    ahead = health.ahead
    drawn = ahead.days <= max(now_days, _LEAST_AHEAD_DAYS)
    span_days = now_days + ahead.days[drawn][-1]
    _, unit = _unit(span_days)
    low, middle, high = (_PERCENT * row[drawn] for row in np.exp(ahead.log_capacity))
    x = (now_days + ahead.days[drawn]) / unit
    trend, band = _trend(health.capacity, health, unit)
    whole, worn_out = np.array([0.0, x[-1]]), np.full(2, _PERCENT * ahead.share)
    series = [
        trend,
        *_points(health, "log_capacity", unit),
        Series(x, middle, "ahead", "dashed", "comparison"),
        Series(whole, worn_out, "worn out", "dashed", "alert"),
    ]
    bands = [band, Band(x, low, high, "95 % of what may come", "comparison")]
    return _figure("Capacity over that when new", "Capacity [%]", series, bands, health, span_days)


def resistance_figure(health: Health) -> Figure:
    """Resistance relative to new: each log by itself, and the trend."""
    now_days, _ = health.now
    span_days = now_days + max(now_days, _LEAST_AHEAD_DAYS)  # as for the capacity above it, so that both have one unit
    _, unit = _unit(span_days)
    trend, band = _trend(health.resistance, health, unit)
    series = [trend, *_points(health, "log_resistance", unit)]
    return _figure("Resistance over that when new", "Resistance [%]", series, [band], health, span_days)


def trend_figures(found: BatteryHealth) -> list[Figure]:
    """Capacity over time, if the logs show it, and resistance over time."""
    capacity = [capacity_figure(found.health)] if found.capacity_by == "logs" else []
    return [*capacity, resistance_figure(found.health)]


def life_figure(ahead: LifeAhead) -> Figure:
    """Probability over time that the battery will be worn out."""
    title = f"Probability that {ahead.share:.0%} of the capacity or less are left"
    late = ahead.quantile(0.99)
    drawn = ahead.days <= (1.2 * late if np.isfinite(late) else ahead.days[-1])
    name, unit = _unit(float(ahead.days[drawn][-1]))
    series = [Series(ahead.days[drawn] / unit, _PERCENT * ahead.probability[drawn], "worn out", "line", "estimate")]
    return Figure(title, f"{name} from now", "Probability [%]", series, y_limits=(0.0, 100.0))


def _unit(span_days: float) -> tuple[str, float]:
    """Unit of a span of time and its days."""
    return next((name, days) for name, days in _UNITS.items() if span_days > 4 * days or days == 1.0)


def _figure(
    title: str, label: str, series: Sequence[Series], bands: Sequence[Band], health: Health, span_days: float
) -> Figure:
    name, unit = _unit(span_days)
    markers = [Marker(step.days / unit, f"sudden: {step.cause}", "alert") for step in health.changes]
    return Figure(title, f"{name} since the first log", label, series, bands, markers=markers, height_px=320)


def _trend(fit: AgeingFit, health: Health, unit: float) -> tuple[Series, Band]:
    """The trend of a fit of logarithms from the first log to the last, and its 95 % band."""
    days, cycles = (last * np.linspace(0.0, 1.0, _TREND_POINTS) for last in health.now)
    mean, std = fit.band(days, cycles)
    low, middle, high = (_PERCENT * np.exp(mean + z * std) for z in (-BAND_95, 0.0, BAND_95))
    x = days / unit
    return Series(x, middle, "trend", "line", "estimate"), Band(x, low, high, "95 % band")


def _points(health: Health, quantity: str, unit: float) -> list[Series]:
    first_s = health.points[0].time_s
    known = [point for point in health.points if getattr(point, quantity).std < UNINFORMATIVE_STD]
    if not known:
        return []
    days = np.array([(point.time_s - first_s) / DAY_S / unit for point in known])
    value = np.exp([getattr(point, quantity).mean for point in known])
    return [Series(days, _PERCENT * value, "one log by itself", "points", "background")]


#: Largest number of robots shown by name.
_MOST_NAMED = 6


def battery_map(batteries: Mapping[str, tuple[float, float]], marked: Sequence[str]) -> Figure:
    """Resistance over capacity of each robot's battery, relative to the battery file's; marked: shown by name.

    batteries: robot -> capacity and resistance.
    """
    named = [robot for robot in marked if robot in batteries][:_MOST_NAMED]
    groups = {"the others" if named else "robots": [robot for robot in batteries if robot not in named]}
    groups |= {robot: [robot] for robot in named}
    series = []
    for label, robots in groups.items():
        points = _PERCENT * np.array([batteries[robot] for robot in robots]).reshape(-1, 2)
        if len(points):
            role: Role = "background" if label == "the others" else "auto"
            series.append(Series(points[:, 0], points[:, 1], label, "points", role))
    title = "Capacity and resistance over the battery file's"
    return Figure(title, "Capacity [%]", "Resistance [%]", series, height_px=320)


def trend_figure(title: str, label: str, trends: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """A value relative to the battery file's at the end of each log, a line for each of the first robots.

    trends: robot -> Unix times (n,) [s] and shares (n,).
    """
    start_s = min((float(times[0]) for times, _ in trends.values()), default=0.0)
    drawn = list(trends.items())[:_MOST_NAMED]
    series = [Series((times - start_s) / DAY_S, _PERCENT * values, robot) for robot, (times, values) in drawn]
    return Figure(title, "Days since the first log", label, series, height_px=320)
