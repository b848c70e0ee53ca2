"""What an encoder says of the angle of a wheel, as one row of a linear measurement: its count, or the time of its edge.

count   y = ahead                                   0, to within a count
edge    y = ahead(t - age),  x(t - age) = exp(-A age) x(t) + added(-age)     half a count from the middle, to within
                                                                             what is known of where edges lie
none    |ahead| <= half a count                     says something only where more is believed

`ahead` is the angle beyond the middle of the count that is shown. An edge that lies within 0.02 of a count tells the
angle 14 times as well as the count does, but only when it comes: in between, a slow wheel is within its count.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.trace import clip, isfinite, sign, where
from ohmward.traction.momentum_observer.estimate import AngleSample
from ohmward.traction.momentum_observer.model import MomentumModel


class Angle(NamedTuple):
    """y = row @ x + v, v ~ N(0, variance).

    row: (n,).
    angle_rad: y; nan where there is nothing to learn.
    variance: rad^2.
    """

    row: np.ndarray
    angle_rad: Any
    variance: Any


def count_angle(model: MomentumModel, k: int) -> Angle:
    """Of wheel k from its count alone: it is in the middle, give or take."""
    std = model.noise.encoder_std_rad if k < model.scene.robot.driven else model.noise.passive_std_rad or 0.0
    row = np.zeros(len(model.names))
    row[model.ahead(k)] = 1.0
    return Angle(row, 0.0, std**2)


def edge_angle(model: MomentumModel, k: int, belief: Belief, sample: AngleSample, b: np.ndarray) -> Angle:
    """Of wheel k from the time of its last edge; from the count where it moved and no time was captured.

    Args:
        model: of the robot, with `noise.edge_std_counts`.
        k: which wheel.
        belief: at the time of the sample, its angle beyond the middle of the new count.
        sample: with `turned_rad` and `edge_age_s`.
        b: (n,) drive of the model over the step.
    """
    count, i = count_angle(model, k), model.ahead(k)
    turned, age_s = sample.turned_rad[k], sample.edge_age_s[k]
    half = math.sqrt(3.0 * count.variance)
    moved = turned != 0.0
    timed = moved & isfinite(age_s) & (age_s >= 0.0) & (age_s <= sample.dt_s)
    back_s = where(timed, -age_s, 0.0)
    at_edge = -half * sign(turned) - model.added(b, back_s)[i]
    nearest = clip(belief.mean[i], -half, half)
    within = where(abs(belief.mean[i]) > half, nearest, math.nan)
    edge_variance = (2.0 * half * (model.noise.edge_std_counts or 0.0)) ** 2
    return Angle(
        model.transition(back_s)[i],
        where(timed, at_edge, where(moved, 0.0, within)),
        where(timed, edge_variance, count.variance),
    )
