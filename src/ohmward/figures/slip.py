"""Figures of speed and slip, of floors, and of the path from above with the 95 % ellipses of its position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ohmward.figures.parts import band_95, estimated, flag_spans, lognormal_band_95, spans_where
from ohmward.filters.consistency import ELLIPSE_95
from ohmward.filters.flags import SampleFlag
from ohmward.logs.drive_log import DriveLog
from ohmward.quantities import QUANTITIES
from ohmward.report import TIME, Figure, Line, Map, Marker, Series
from ohmward.report.figure import Meaning
from ohmward.traction.calibration import Calibration
from ohmward.traction.calibration.floor import points
from ohmward.traction.calibration.stretches import cut, travel_speed
from ohmward.traction.odometry.estimator import OdometryRun
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.estimator import SlipRun
from ohmward.traction.terrain.floor import Floor, slip_scale
from ohmward.traction.terrain.slip_on_floors import FloorRun, SlipCurves

#: Flags that are drawn over the speed, and the meaning of their colours.
FLAG_MEANINGS: Mapping[SampleFlag, Meaning] = {
    SlipFlag.STANDSTILL: "background",
    SlipFlag.SPEED_UNOBSERVED: "comparison",
    SlipFlag.GROUND_CHANGED: "alert",
    SlipFlag.ENCODER_REJECTED: "alert",
    SlipFlag.SPEED_REJECTED: "alert",
    SlipFlag.GAP: "alert",
}


def ground_figures(run: SlipRun, wheels: Sequence[str] = (), true_slip_m_s: np.ndarray | None = None) -> list[Figure]:
    """Slip of each driven wheel, and friction and grade where they are estimated.

    wheels: names of the driven ones; without them they are numbered.  true_slip_m_s: (T, driven).
    """
    e = run.estimates
    names = wheels or _wheel_names(e.slip_speed_m_s.shape[1])
    figures = [
        slip_figure(run, k, name, None if true_slip_m_s is None else true_slip_m_s[:, k])
        for k, name in enumerate(names)
    ]
    if (e.friction_std > 0).any():
        share, std = 100 * run.friction_ratio[:, 0], run.friction_std[:, 0]  # both relative
        line = Series(run.time_s, share, "estimate", role="estimate")
        band = lognormal_band_95(run.time_s, share, std)
        title = "Friction over the assumed"
        figures.append(Figure(title, TIME, "Share [%]", [line], [band], log_y=True, height_px=200))
    if (e.grade_std_rad > 0).any():
        curves = estimated(run.time_s, np.degrees(run.grade_rad), np.degrees(run.grade_std_rad))
        figures.append(Figure("Grade", TIME, "Grade [degrees]", *curves, height_px=180))
    return figures


def drive_figures(log: DriveLog) -> list[Figure]:
    """Wheels, motors and body as they were logged; a quantity that was never measured has no figure."""
    figures = [wheels_figure(log)]
    currents = log.motor_current_A.T
    names = zip(_wheel_names(len(currents)), currents, strict=True)
    series = [Series(log.time_s, values, name) for name, values in names if np.isfinite(values).any()]
    figures += [Figure("Motors", TIME, "Current [A]", series, height_px=200)] if series else []
    for name in log.channels:
        quantity = QUANTITIES[name]
        line = [Series(log.time_s, getattr(log, name), "measured", role="background")]
        figures.append(Figure(quantity.label, TIME, quantity.axis, line, height_px=160))
    return figures


def _wheel_names(count: int) -> list[str]:
    """Names of wheels that have none, in the order of their columns."""
    return [f"wheel {k}" for k in range(1, count + 1)]


def wheels_figure(log: DriveLog, wheels: Sequence[str] = ()) -> Figure:
    """Speed of each wheel as it was logged; wheels: their names, in the order of the columns, or they are numbered."""
    columns = log.wheel_speed_rad_s.T
    names = zip(wheels or _wheel_names(len(columns)), columns, strict=False)
    known = [(name, np.flatnonzero(np.isfinite(values)), values) for name, values in names]
    series = [Series(log.time_s[rows], values[rows], name) for name, rows, values in known]
    return Figure("Wheels", TIME, "Speed [rad/s]", series)


def speed_figure(run: SlipRun, rolled_m_s: np.ndarray | None = None, truth_m_s: np.ndarray | None = None) -> Figure:
    """Speed of the body with its band and its flags.

    rolled_m_s: (T,) speed that the wheels alone would show.  truth_m_s: (T,).
    """
    time_s, e = run.time_s, run.estimates
    series, bands = estimated(time_s, e.speed_m_s, e.speed_std_m_s, truth_m_s)
    known = np.concatenate([s.y[np.isfinite(s.y)] for s in series])  # wheels that spin may leave the picture
    margin = 0.2 * float(np.ptp(known)) + 0.05
    limits = float(known.min()) - margin, float(known.max()) + margin
    if rolled_m_s is not None:
        series.insert(0, Series(time_s, rolled_m_s, "wheels, as if none slipped", role="background"))
    spans = flag_spans(time_s, e.flags, FLAG_MEANINGS)
    return Figure("Speed", TIME, "Speed [m/s]", series, bands, spans=spans, y_limits=limits, height_px=300)


def slip_figure(run: SlipRun, k: int, wheel: str, truth_m_s: np.ndarray | None = None) -> Figure:
    """Slip speed of driven wheel k with its band and its alarms."""
    time_s, e = run.time_s, run.estimates
    curves = estimated(time_s, e.slip_speed_m_s[:, k], e.slip_speed_std_m_s[:, k], truth_m_s)
    alarms = spans_where(time_s, e.slipping[:, k] > 0.5, "slips", "alert")
    alarms += spans_where(time_s, e.immobilised > 0.5, "immobilised", "comparison")
    title = f"Slip, {wheel.replace('_', ' ')}"
    return Figure(title, TIME, "Slip speed [m/s]", *curves, spans=alarms, height_px=220)


#: Ellipses along the path, and points on each.
ELLIPSES, OUTLINE_POINTS = 8, 120


def path_map(run: OdometryRun) -> Map:
    """The path from above, with ellipses of 95 % at even times."""
    e = run.estimates
    even = np.linspace(0, len(run.time_s) - 1, ELLIPSES + 1).astype(int)
    outlines = [ellipse(e.pose_cov[k], e.x_m[k], e.y_m[k]) for k in np.unique(even)[1:]]
    lines = [Line(x, y, "95 % of the position", "background") for x, y in outlines]
    path = Line(np.asarray(e.x_m), np.asarray(e.y_m), "path", "estimate")
    return Map("Path", "Forward of the start [m]", "To its left [m]", [*lines, path])


def ellipse(cov: np.ndarray, x_m: float, y_m: float) -> np.ndarray:
    """Outline (2, points) that holds 95 % of a position; cov: its covariance, or of a state that begins with it."""
    angle = np.linspace(0.0, 2 * np.pi, OUTLINE_POINTS)
    values, vectors = np.linalg.eigh(cov[:2, :2])
    axes = vectors * np.sqrt(np.maximum(values, 0.0)) * ELLIPSE_95
    circle = np.array([np.cos(angle), np.sin(angle)])
    centre = np.array([[x_m], [y_m]])
    return centre + axes @ circle


def floor_plots(run: FloorRun, floors: Sequence[str] = (), wheels: Sequence[str] = ()) -> list[Figure]:
    """Slip of the robot with its band and the crossings, and the floor under each wheel.

    floors, wheels: their names; without them they are numbered.
    """
    _, wheel_count, floor_count = run.floor_probability.shape
    floors = floors or [f"floor {k}" for k in range(floor_count)]
    wheels = wheels or _wheel_names(wheel_count)
    curves = estimated(run.time_s, 100 * run.travel_slip, 100 * run.travel_slip_std)
    crossings = [Marker(crossing.time_s, "other floor", "alert") for crossing in run.crossings]
    robot = Figure("Slip of the robot", TIME, "Slip [%]", *curves, markers=crossings)
    figures = [robot]
    for k, wheel in enumerate(wheels):
        share = 100 * run.floor_probability[:, k]
        series = [Series(run.time_s, share[:, j], name) for j, name in enumerate(floors)]
        title = f"Floor under {wheel.replace('_', ' ')}"
        figures.append(Figure(title, TIME, "Probability [%]", series, y_limits=(0.0, 100.0), height_px=140))
    return figures


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
    """Slip against force of the wheels, scaled to the middle speed in rolling direction, and the law with its band."""
    p = points(cut(found.drives, found.robot), found.robot)
    slip = p.slip_ratio / slip_scale(floor, p.along, p.across, p.travel_m_s).factor
    measured_force, measured_slip = np.abs(p.force_share), np.sign(p.force_share) * slip
    force = np.linspace(0.0, float(measured_force.max()), 60)
    mean, cov = SlipCurves(floor).belief(force, np.zeros(60))
    std = np.sqrt(np.diag(cov))
    return Figure(
        "Slip of the wheels under their force",
        "Traction over load [-]",
        "Slip [-]",
        series=[
            Series(measured_force.ravel(), measured_slip.ravel(), "stretches", "points"),
            Series(force, mean, "learnt", role="estimate"),
        ],
        bands=[band_95(force, mean, std, label="95 %")],
    )
