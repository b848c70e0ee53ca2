"""What learnt floors add to the report of `ohmward slip`."""

from __future__ import annotations

from ohmward.cli.slip.on_floors import OnFloors
from ohmward.report import TIME, Band, Figure, Marker, Series


def floor_figures(on: OnFloors) -> list[Figure]:
    """Slip of the robot with its band and the crossings, and the floor under each wheel."""
    track = on.track
    t, slip, half = track.time_s, 100 * track.travel_slip, 196 * track.travel_slip_std
    crossings = [Marker(c.time_s, "other floor", "alert") for c in track.crossings]
    robot = Figure(
        "Slip of the robot",
        TIME,
        "Slip [%]",
        series=[Series(t, slip, "estimate", role="estimate")],
        bands=[Band(t, slip - half, slip + half, "95 % band")],
        markers=crossings,
    )
    return [robot, *(_floors(on, w) for w in range(len(on.wheels)))]


def _floors(on: OnFloors, wheel: int) -> Figure:
    """Probability of each floor under one wheel."""
    share = on.track.floor_probability[:, wheel]
    series = [Series(on.track.time_s, 100 * share[:, k], name) for k, name in enumerate(on.floors)]
    title = f"Floor under {on.wheels[wheel].replace('_', ' ')}"
    return Figure(title, TIME, "Probability [%]", series=series, y_limits=(0.0, 100.0), height_px=140)
