"""The report of `ohmward calibrate`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.cli.calibrate.command import PARAMETERS, Result, floor_fields, parameter_rows
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import duration
from ohmward.filters.consistency import BAND_95
from ohmward.report import Band, Figure, Page, Series
from ohmward.traction.calibration.floor import points
from ohmward.traction.calibration.stretches import cut, travel_speed
from ohmward.traction.terrain.floor import Floor, slip_belief


def make_page(result: Result, figures: dict[str, Any]) -> Page:
    """What was calibrated, the speeds it rests on, and the floor's law among the stretches it was learnt from."""
    what = f"{figures['drives']} drives, {duration(figures['duration_s'])}"
    page = Page(f"Robot {result.robot.name!r}", what, FOOTER)
    for p in result.parameters:
        if not p.identified:
            page = page.callout("warning", f"{p.name} was not identified: {p.reason}. The robot's own value is kept.")
    if result.parameters:
        page = page.heading("Parameters").table(PARAMETERS, parameter_rows(result)).plot(_speeds(result))
    if result.floor:
        rows = list(floor_fields(result.floor).items())
        page = (
            page.heading(f"Floor {result.floor.name!r}").plot(_law(result, result.floor)).table(["What", "Value"], rows)
        )
    return with_assumptions(page, figures["notes"])


def _speeds(result: Result) -> Figure:
    """Speed of the body over that of the rims, which a good radius puts on the diagonal."""
    stretches = cut(result.drives, result.robot)
    rim, body = travel_speed(stretches.rim), travel_speed(stretches.motion)
    ends = np.array([0.0, float(max(rim.max(), body.max()))])
    return Figure(
        "Speed of the body and of the rims",
        "Rims [m/s]",
        "Body [m/s]",
        series=[Series(rim, body, "stretches of 1 s", "points"), Series(ends, ends, "no slip", "dashed", "reference")],
    )


def _law(result: Result, floor: Floor) -> Figure:
    """Slip over force of the wheels, and the law with its band."""
    p = points(cut(result.drives, result.robot), result.robot)
    most = float(np.abs(p.force_share).max())
    force = np.linspace(0.0, most, 60)
    law = slip_belief(floor, force[:, None], np.zeros((60, 1)))
    mean, std = law.mean[:, 0], np.sqrt(law.cov[:, 0, 0])
    return Figure(
        "Slip of the wheels under their force",
        "Traction over load [-]",
        "Slip [-]",
        series=[
            Series(
                np.abs(p.force_share).ravel(), (np.sign(p.force_share) * p.slip_ratio).ravel(), "stretches", "points"
            ),
            Series(force, mean, "learnt", role="estimate"),
        ],
        bands=[Band(force, mean - BAND_95 * std, mean + BAND_95 * std, "95 %")],
    )
