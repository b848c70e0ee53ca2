"""Figures of a calibration, and of slip on learnt floors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ohmward.figures.parts import band_95
from ohmward.report import TIME, Figure, Marker, Series
from ohmward.traction.calibration import Calibration
from ohmward.traction.calibration.floor import points
from ohmward.traction.calibration.stretches import cut, travel_speed
from ohmward.traction.terrain.floor import Floor, slip_belief, slip_scale
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


def calibration_figure(found: Calibration) -> Figure:
    """Speed of the body over that of the rims, which a good radius puts on the diagonal."""
    stretches = cut(found.drives, found.robot)
    rim, body = travel_speed(stretches.rim), travel_speed(stretches.motion)
    ends = np.array([0.0, float(max(rim.max(), body.max()))])
    return Figure(
        "Speed of the body and of the rims",
        "Rims [m/s]",
        "Body [m/s]",
        series=[Series(rim, body, "stretches of 1 s", "points"), Series(ends, ends, "no slip", "dashed", "reference")],
    )


def law_figure(found: Calibration, floor: Floor) -> Figure:
    """Slip over force of the wheels, as at the middle speed in their rolling direction, and the law with its band."""
    p = points(cut(found.drives, found.robot), found.robot)
    slip = p.slip_ratio / slip_scale(floor, p.along, p.across, p.travel_m_s).factor
    most = float(np.abs(p.force_share).max())
    force = np.linspace(0.0, most, 60)
    law = slip_belief(floor, force[:, None], np.zeros((60, 1)))
    mean, std = law.mean[:, 0], np.sqrt(law.cov[:, 0, 0])
    return Figure(
        "Slip of the wheels under their force",
        "Traction over load [-]",
        "Slip [-]",
        series=[
            Series(np.abs(p.force_share).ravel(), (np.sign(p.force_share) * slip).ravel(), "stretches", "points"),
            Series(force, mean, "learnt", role="estimate"),
        ],
        bands=[band_95(force, mean, std, label="95 %")],
    )
