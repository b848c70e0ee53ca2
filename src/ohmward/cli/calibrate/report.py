"""Report of `ohmward calibrate`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ohmward.cli.calibrate.result import PARAMETERS, floor_fields, parameter_rows
from ohmward.cli.report_parts import FOOTER, with_assumptions
from ohmward.cli.wording import duration
from ohmward.figures.parts import band_95
from ohmward.report import Figure, Page, Series
from ohmward.traction.calibration import Calibration
from ohmward.traction.calibration.floor import points
from ohmward.traction.calibration.stretches import cut, travel_speed
from ohmward.traction.terrain.floor import Floor, slip_belief, slip_scale


def make_page(found: Calibration, figures: Mapping[str, Any]) -> Page:
    """Calibrated parameters, the speeds behind them, and the floor's law among the stretches it was learnt from."""
    what = f"{figures['drives']} drives, {duration(figures['duration_s'])}"
    page = Page(f"Robot {found.robot.name!r}", what, FOOTER)
    for p in found.parameters:
        if not p.identified:
            page = page.callout("warning", f"{p.name} was not identified: {p.reason}. The robot's own value is kept.")
    if found.parameters:
        page = page.heading("Parameters").table(PARAMETERS, parameter_rows(found)).plot(_speeds(found))
    if found.floor:
        rows = list(floor_fields(found.floor).items())
        page = page.heading(f"Floor {found.floor.name!r}").plot(_law(found, found.floor)).table(["What", "Value"], rows)
    return with_assumptions(page, figures["notes"])


def _speeds(found: Calibration) -> Figure:
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


def _law(found: Calibration, floor: Floor) -> Figure:
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
