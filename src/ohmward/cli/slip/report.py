"""The report of `ohmward slip`."""

from __future__ import annotations

import numpy as np

from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.slip.command import SlipAnswer, SlipTask, driven_wheels, errors, result, summary
from ohmward.cli.slip.on_floors_report import floor_figures
from ohmward.cli.wording import duration, percent, quantity
from ohmward.filters.consistency import BAND_95
from ohmward.report import TIME, Band, Figure, Page, Series, Span
from ohmward.report.palette import Meaning
from ohmward.runs import runs
from ohmward.traction.score import true_slip
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag

#: Flags that are drawn over the speed, and what they mean for the eye.
_SHOWN: dict[SlipFlag, Meaning] = {
    SlipFlag.STANDSTILL: "background",
    SlipFlag.SPEED_UNOBSERVED: "comparison",
    SlipFlag.GROUND_CHANGED: "alert",
    SlipFlag.ENCODER_DOUBTED: "alert",
    SlipFlag.SPEED_REJECTED: "alert",
    SlipFlag.GAP: "alert",
}
_MOST_SPANS = 300


def make_page(task: SlipTask, name: str, answer: SlipAnswer) -> Page:
    """Key figures, plots above each other on one clock, episodes, assumptions."""
    figures = summary(task, name, answer)
    what = f"Speed and slip by {name}, robot {task.robot.name!r}, {duration(task.log.duration_s)}"
    page = Page(task.log.name, what, FOOTER).numbers(_numbers(figures)).plot(*_plots(task, answer))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    if task.truth:
        page = page.heading("Against the truth").table(["Quantity", "Value"], list(errors(figures).items()))
    return with_assumptions(_with_episodes(page, figures), answer.notes)


def _numbers(figures: dict) -> dict[str, str]:
    numbers = {
        "Distance": quantity(figures["distance_m"], "m"),
        "Greatest speed": quantity(max(-figures["speed_min_m_s"], figures["speed_max_m_s"]), "m/s"),
        "Slip episodes": str(len(figures["slip_episodes"])),
        "Speed unobserved": percent(figures["unobserved_share"], 1),
        "Speed error, RMS": quantity(figures["speed_rmse_m_s"], "mm/s", 1e3),
        "Slip error, RMS": quantity(figures["slip_rmse"], ""),
        "True slip in 95 % band": percent(figures["coverage_95"], 1),
    }
    return {label: value for label, value in numbers.items() if value != "-"}


def _plots(task: SlipTask, answer: SlipAnswer) -> list[Figure]:
    e, time_s = answer.track.estimates, answer.track.time_s
    plots = [speed_figure(task, time_s, e)]
    if answer.on_floors:
        plots += floor_figures(answer.on_floors)
    truth = true_slip(task.robot, e, task.truth.values).speed_m_s if task.truth else None
    for k, wheel in enumerate(driven_wheels(task.robot)):
        plots.append(slip_figure(time_s, e, k, wheel, None if truth is None else truth[:, k]))
    if (e.friction_std > 0).any():
        plots.append(friction_figure(time_s, e))
    if (e.grade_std_rad > 0).any():
        plots.append(grade_figure(time_s, e))
    return plots


def speed_figure(task: SlipTask, time_s: np.ndarray, e: SlipEstimate) -> Figure:
    """Speed of the body with its band and what happened, beside what the wheels alone would say."""
    wheels = task.robot.wheel.radius_m * e.wheel_speed_rad_s @ np.linalg.pinv(task.robot.rolling[: task.robot.driven]).T
    series = [
        Series(time_s, wheels[:, 0], "wheels, as if none slipped", role="background"),
        Series(time_s, e.speed_m_s, "estimate", role="estimate"),
    ]
    if task.truth:
        series.append(Series(time_s, task.truth.values.speed_m_s, "reference", "dashed", "reference"))
    band, spans = _band(time_s, e.speed_m_s, e.speed_std_m_s), _flag_spans(time_s, e.flags)
    limits = _around(*(s.y for s in series[1:]))
    return Figure("Speed", TIME, "Speed [m/s]", series, [band], spans=spans, y_limits=limits, height_px=300)


def _around(*values: np.ndarray) -> tuple[float, float]:
    """Limits that hold these values; wheels that spin may leave the picture."""
    known = np.concatenate([v[np.isfinite(v)] for v in values])
    margin = 0.2 * float(np.ptp(known)) + 0.05
    return float(known.min()) - margin, float(known.max()) + margin


def slip_figure(time_s: np.ndarray, e: SlipEstimate, k: int, wheel: str, truth: np.ndarray | None) -> Figure:
    """Slip speed of one wheel with its band and its alarms."""
    series = [Series(time_s, e.slip_speed_m_s[:, k], "estimate", role="estimate")]
    if truth is not None:
        series.append(Series(time_s, truth, "reference", "dashed", "reference"))
    band = _band(time_s, e.slip_speed_m_s[:, k], e.slip_speed_std_m_s[:, k])
    alarms = _spans(time_s, e.slipping[:, k] > 0.5, "slips", "alert")
    alarms += _spans(time_s, e.immobilised > 0.5, "immobilised", "comparison")
    title = f"Slip, {wheel.replace('_', ' ')}"
    return Figure(title, TIME, "Slip speed [m/s]", series, [band], spans=alarms, height_px=220)


def friction_figure(time_s: np.ndarray, e: SlipEstimate) -> Figure:
    """What the ground gives at most, over the terrain that was believed; its sigma is a relative one."""
    share, std = e.friction_ratio[:, 0], e.friction_std[:, 0]
    band = Band(time_s, 100 * share * np.exp(-BAND_95 * std), 100 * share * np.exp(BAND_95 * std), "95 % band")
    series = [Series(time_s, 100 * share, "estimate", role="estimate")]
    return Figure("Friction over the believed", TIME, "Share [%]", series, [band], log_y=True, height_px=200)


def grade_figure(time_s: np.ndarray, e: SlipEstimate) -> Figure:
    """The grade, and whatever else pushes the body as a grade would."""
    grade, std = np.degrees(e.grade_rad), np.degrees(e.grade_std_rad)
    series = [Series(time_s, grade, "estimate", role="estimate")]
    return Figure("Grade", TIME, "Grade [degrees]", series, [_band(time_s, grade, std)], height_px=180)


def _with_episodes(page: Page, figures: dict) -> Page:
    """The page with a row for each time that a wheel slipped."""
    found = figures["slip_episodes"]
    if not found:
        return page
    rows = [
        [
            e["wheel"].replace("_", " "),
            f"{e['start_s']:.2f} to {e['end_s']:.2f} s",
            quantity(e["greatest_slip_m_s"], "m/s"),
            percent(e["greatest_slip"], 0),
        ]
        for e in found
    ]
    return page.heading("Slip episodes").table(["Wheel", "Time", "Greatest slip speed", "Greatest slip"], rows)


def _flag_spans(time_s: np.ndarray, flags: np.ndarray) -> list[Span]:
    spans = [
        span
        for flag, role in _SHOWN.items()
        for span in _spans(time_s, flags.astype(int) & flag != 0, str(flag.name).lower().replace("_", " "), role)
    ]
    return sorted(sorted(spans, key=lambda s: s.x_from - s.x_to)[:_MOST_SPANS])


def _spans(time_s: np.ndarray, mask: np.ndarray, label: str, role: Meaning) -> list[Span]:
    """A span for every stretch of True in `mask` (T,), the longest where there are many."""
    spans = [Span(float(time_s[a]), float(time_s[b - 1]), label, role) for a, b in runs(mask)]
    return sorted(sorted(spans, key=lambda s: s.x_from - s.x_to)[:_MOST_SPANS])


def _band(time_s: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Band:
    return Band(time_s, mean - BAND_95 * std, mean + BAND_95 * std, "95 % band")
