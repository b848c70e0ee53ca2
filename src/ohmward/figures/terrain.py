"""Figures of slip on learnt floors."""

from __future__ import annotations

from collections.abc import Sequence

from ohmward.figures.parts import band_95
from ohmward.report import TIME, Figure, Marker, Series
from ohmward.traction.terrain.slip_on_floors import FloorRun


def run_figures(run: FloorRun, floors: Sequence[str] = (), wheels: Sequence[str] = ()) -> list[Figure]:
    """Slip of the robot with its band and the crossings, and the floor under each wheel.

    floors, wheels: their names; without them they are numbered.
    """
    t, slip, std = run.time_s, 100 * run.travel_slip, 100 * run.travel_slip_std
    _, wheel_count, floor_count = run.floor_probability.shape
    floors = floors or [f"floor {k}" for k in range(floor_count)]
    wheels = wheels or [f"wheel {k}" for k in range(wheel_count)]
    robot = Figure(
        "Slip of the robot",
        TIME,
        "Slip [%]",
        series=[Series(t, slip, "estimate", role="estimate")],
        bands=[band_95(t, slip, std)],
        markers=[Marker(c.time_s, "other floor", "alert") for c in run.crossings],
    )
    return [robot, *(floor_figure(run, k, wheel, floors) for k, wheel in enumerate(wheels))]


def floor_figure(run: FloorRun, k: int, wheel: str, floors: Sequence[str]) -> Figure:
    """Probability of each floor under one wheel."""
    share = 100 * run.floor_probability[:, k]
    series = [Series(run.time_s, share[:, j], name) for j, name in enumerate(floors)]
    title = f"Floor under {wheel.replace('_', ' ')}"
    return Figure(title, TIME, "Probability [%]", series=series, y_limits=(0.0, 100.0), height_px=140)
