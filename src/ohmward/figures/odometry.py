"""Figures of odometry: the path from above with the 95 % ellipses of its position."""

from __future__ import annotations

import numpy as np

from ohmward.report import Line, Map
from ohmward.traction.odometry.estimator import OdometryRun

#: Ellipses along the path, and points on each.
ELLIPSES, POINTS = 8, 120

#: Scale of the ellipse that holds 95 % of a Gaussian in the plane: root of the chi-square quantile of two freedoms.
ELLIPSE_95 = np.sqrt(-2.0 * np.log(0.05))


def path_map(run: OdometryRun) -> Map:
    """The path from above, with ellipses of 95 % at even times."""
    e = run.estimates
    rows = np.unique(np.linspace(0, len(run.time_s) - 1, ELLIPSES + 1).astype(int))[1:]
    outlines = [ellipse(e.pose_cov[k], e.x_m[k], e.y_m[k]) for k in rows]
    lines = [Line(x, y, "95 % of the position", "background") for x, y in outlines]
    path = Line(np.asarray(e.x_m), np.asarray(e.y_m), "path", "estimate")
    return Map("Path", "Forward of the start [m]", "To its left [m]", [*lines, path])


def ellipse(cov: np.ndarray, x_m: float, y_m: float) -> np.ndarray:
    """Outline (2, POINTS) that holds 95 % of a position; cov: its covariance, and whatever follows."""
    angle = np.linspace(0.0, 2 * np.pi, POINTS)
    values, vectors = np.linalg.eigh(cov[:2, :2])
    axes = vectors * np.sqrt(np.maximum(values, 0.0)) * ELLIPSE_95
    return np.array([[x_m], [y_m]]) + axes @ np.array([np.cos(angle), np.sin(angle)])
