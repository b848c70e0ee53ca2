"""Encoder of the momentum observer: the angle of a wheel as one row of a linear measurement.

count   y = ahead                                   0, to within a count
edge    y = ahead(t - age),  x(t - age) = exp(-A age) x(t) + added(-age)     half a count from the middle, to within the
                                                                             uncertainty of edges
none    |ahead| <= half a count                     informative only where more is believed

`ahead` is the angle beyond the middle of the count that is shown. An edge that lies within 0.02 of a count tells the
angle 14 times as well as the count does, but only when it comes: in between, a slow wheel is within its count.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.sanitize import between
from ohmward.trace import clip, sign, where
from ohmward.trace.expression import Scalar
from ohmward_lab.traction.momentum_observer.estimate import AngleSample
from ohmward_lab.traction.momentum_observer.model import MomentumModel


class Angle(NamedTuple):
    """y = row @ x + v, v ~ N(0, variance)."""

    row: np.ndarray  #: (n,)
    angle_rad: Scalar  #: y; nan where there is nothing to learn
    variance: Scalar  #: rad^2


def count_angle(model: MomentumModel, k: int) -> Angle:
    """Measurement by the count of wheel k alone: its middle, give or take."""
    std = model.noise.encoder_std_rad if k < model.scene.robot.driven else model.noise.passive_std_rad or 0.0
    row = np.zeros(len(model.names))
    row[model.ahead(k)] = 1.0
    return Angle(row, 0.0, std**2)


def edge_angle(model: MomentumModel, k: int, belief: Belief, sample: AngleSample, b: np.ndarray) -> Angle:
    """Measurement by the time of the last edge of wheel k; by the count where it moved and no time was captured.

    Args:
        model: of the robot, with `noise.edge_std_counts`.
        k: number of the wheel.
        belief: at the time of the sample, its angle beyond the middle of the new count.
        sample: with `turned_rad` and `edge_age_s`.
        b: (n,) drive of the model over the step.
    """
    count, ahead = count_angle(model, k), belief.mean[model.ahead(k)]
    turned, age_s = sample.turned_rad[k], sample.edge_age_s[k]
    half = math.sqrt(3.0 * count.variance)
    moved = turned != 0.0
    timed = moved & between(age_s, 0.0, sample.dt_s)
    back_s = where(timed, -age_s, 0.0)
    at_edge = -half * sign(turned) - model.added(belief.mean, b, back_s)[model.ahead(k)]
    nearest_in_count = where(abs(ahead) > half, clip(ahead, -half, half), math.nan)
    edge_variance = (2.0 * half * (model.noise.edge_std_counts or 0.0)) ** 2
    return Angle(
        row=model.transition(belief.mean, back_s)[model.ahead(k)],
        angle_rad=where(timed, at_edge, where(moved, 0.0, nearest_in_count)),
        variance=where(timed, edge_variance, count.variance),
    )
