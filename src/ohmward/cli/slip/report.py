"""Report of `ohmward slip`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.cli.drive_inputs import driven_wheels
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.slip.result import SlipTask, errors, result
from ohmward.cli.wording import duration, percent, quantity
from ohmward.figures.odometry import path_map
from ohmward.figures.parts import wall_clock
from ohmward.figures.slip import ground_figures, speed_figure
from ohmward.figures.terrain import run_figures as floor_figures
from ohmward.report import Figure, Page
from ohmward.traction.observed_drive import ObservedDrive
from ohmward.traction.score import true_slip


def make_page(task: SlipTask, observed: ObservedDrive, figures: Mapping[str, Any]) -> Page:
    """Key figures, plots above each other on one clock, episodes, assumptions.

    figures: summary of the drive.
    """
    what = f"Speed and slip by {figures['filter']}, robot {task.robot.name!r}, {duration(task.log.duration_s)}"
    page = Page(task.log.name, what, FOOTER).numbers(_numbers(figures))
    page = page.plot(*_plots(task, observed), clock=wall_clock(task.log))
    page = page.map(path_map(observed.path))
    page = page.heading("Result").table(["Quantity", "Value"], list(result(figures).items()))
    if task.reference:
        page = page.heading("Against the truth").table(["Quantity", "Value"], list(errors(figures).items()))
    return with_assumptions(_with_episodes(page, figures), figures["notes"])


def _numbers(figures: Mapping[str, Any]) -> dict[str, str]:
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


def _plots(task: SlipTask, observed: ObservedDrive) -> list[Figure]:
    robot = task.robot
    run = observed.track
    e = run.estimates
    truth = task.reference.truth if task.reference else None
    wheels = driven_wheels(robot)
    rolled_m_s = robot.wheel.radius_m * e.wheel_speed_rad_s @ np.linalg.pinv(robot.rolling[: robot.driven])[0]
    plots = [speed_figure(run, rolled_m_s, truth.speed_m_s if truth else None)]
    if observed.on_floors:
        plots += floor_figures(observed.on_floors.track, observed.on_floors.floors, wheels)
    return plots + ground_figures(run, wheels, true_slip(robot, e, truth).speed_m_s if truth else None)


def _with_episodes(page: Page, figures: Mapping[str, Any]) -> Page:
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
