"""The report of `ohmward slip`."""

from __future__ import annotations

import numpy as np

from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.slip.command import SlipAnswer, SlipTask, driven_wheels, errors, result, summary
from ohmward.cli.wording import duration, percent, quantity
from ohmward.figures.slip import ground_figures, speed_figure
from ohmward.figures.terrain import run_figures as floor_figures
from ohmward.report import Figure, Page
from ohmward.traction.score import true_slip


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
    robot, run, on = task.robot, answer.track, answer.on_floors
    e = run.estimates
    rolled_m_s = robot.wheel.radius_m * e.wheel_speed_rad_s @ np.linalg.pinv(robot.rolling[: robot.driven])[0]
    truth = task.truth.values.speed_m_s if task.truth else None
    slips = true_slip(robot, e, task.truth.values).speed_m_s if task.truth else None
    of_floors = floor_figures(on.track, on.floors, on.wheels) if on else []
    return [speed_figure(run, rolled_m_s, truth), *of_floors, *ground_figures(run, driven_wheels(robot), slips)]


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
