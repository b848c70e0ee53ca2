"""Hypothesis test: gross wheel slip against an unmodelled disturbance, where only the driven wheels show the speed.

Wheels that turn faster than their forces explain either slide, or something else accelerates the robot, as a slope
would. A filter whose wheels grip can only learn the second, a little in every step, and is ever surer of it. So the two
are compared by their squared Mahalanobis distance from what is usual (-2 log of their likelihood):

    grip    d^2 = sum ((x_i - x_i0) / sigma_i0)^2      over the states of ground and grade as learnt
    slide   d^2 = (ln a / sigma_a0)^2                  friction ratio a at which these wheels slide with their force

Where grip is unusual, slide about as likely, and the wheels turn the way in which motors and ground drive them, the
filter starts again: from wheels that slide under a body that is as fast as the forces say, and as uncertain as both
differ. That holds at first only: a slope that has been learnt has also been seen to hold while the forces changed.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.sanitize import every
from ohmward.trace import exp, log, maximum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.slip_step import step_without_traction, traction

#: Time constant [s] with which an unexplained change of the speed is forgotten.
MEMORY_S = 1.0

#: Squared distance from which on grip is unusual, and by which slide may be farther off than grip.
UNUSUAL, MARGIN = 5.0, 2.0

#: A slope counts as learnt once its standard deviation is below this share of its first one.
LEARNT_SHARE = 0.5

#: States of ground and grade; the test needs all of them.
LEARNT = ("log_friction", "log_stiffness", "grade_rad", "rolling_excess")

#: Slip [m/s] at which any ground gives what it can; relative sigma of a sliding wheel's friction; least friction ratio.
SLIDING_M_S, FRICTION_STD, LEAST_RATIO = 1.0, 0.1, 1e-3

#: Keeps a ground that gives no force from dividing by zero [N^2].
_TINY_N2 = 1e-12


class SlipTest(NamedTuple):
    """Outcome of the test."""

    belief: Belief  #: after it
    gross_slip: Scalar  #: the condition that the wheels slide and the filter started again
    unexplained_m_s: Scalar  #: change of the speed of late that no force explains


def is_ambiguous(model: Model) -> bool:
    """True where grip and slide look alike: all that they differ in is learnt, and no other sensor tells them apart."""
    others = model.noise.pitch_std_rad, model.noise.speed_std_m_s, model.noise.passive_std_rad_s
    return set(LEARNT) <= set(model.layout.names) and all(std is None for std in others)


def unexplained_change(last_m_s: Scalar, before: Belief, posterior: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Change [m/s] of the speed of late that no force explains; 0 after a step whose forces are not known.

    Neither a slope nor a rolling resistance other than believed is a force here: what the model has made of the change
    by them is part of what has to be explained.

    last_m_s: the same before the step.
    before, posterior: beliefs before the step, and after its measurements.
    """
    forced_m_s = change_by_momentum(before, posterior, clean, model)
    change_m_s = exp(-clean.dt_s / MEMORY_S) * last_m_s + posterior.mean[0] - before.mean[0] - forced_m_s
    forces_known = every(clean.current_measured) & (clean.unmodelled_s <= 0.0) & (clean.modelled_s > 0.0)
    return where(forces_known, change_m_s, 0.0)


def change_by_momentum(before: Belief, after: Belief, clean: CleanSample, model: Model) -> Scalar:
    """Change [m/s] of the speed by what the motors give and the wheels do not keep, whatever the ground is.

    F dt = J_w (omega* - omega+) / r with the end omega* of a step on level ground without traction.
    """
    robot, layout = model.scene.robot, model.layout
    parts = layout.split(before.mean)._replace(rolling_ratio=1.0)
    level = model.input(before.mean, clean)._replace(grade_rad=0.0)
    v, omega = step_without_traction(parts, level, model.scene, clean.modelled_s, model.static_load_N)
    end = after.mean[layout.wheel(0) : layout.robot_states]
    impulse_Ns = robot.inertia[robot.freedoms :] * (omega - end) / robot.wheel.radius_m
    return v[0] - before.mean[0] + robot.rolling[: model.driven, 0] @ impulse_Ns / robot.inertia[0]


def compare_hypotheses(
    belief: Belief, unexplained_m_s: Scalar, clean: CleanSample, model: Model, gate: float
) -> SlipTest:
    """Start the belief again from sliding wheels where that is the better hypothesis.

    gate: squared distance from which on a friction is out of question.
    """
    log_friction = log_friction_of_sliding(belief, unexplained_m_s, model)
    grip = squared_mahalanobis(belief, model)
    slide = (log_friction / model.noise.friction_std) ** 2
    likelier = (grip > UNUSUAL) & (grip + MARGIN > slide) & (slide < gate)
    driven = is_driven(belief, unexplained_m_s, clean, model)
    gross_slip = every([likelier, slope_unlearnt(belief, model), driven])
    restarted = sliding(belief, log_friction, unexplained_m_s, model)
    return SlipTest(choose(gross_slip, restarted, belief), gross_slip, where(gross_slip, 0.0, unexplained_m_s))


def squared_mahalanobis(belief: Belief, model: Model) -> Scalar:
    """Squared distance of ground and grade from what is usual, in standard deviations before the first sample."""
    return sum((belief.mean[model.layout.index(name)] / model.initial_std(name)) ** 2 for name in LEARNT)


def slope_unlearnt(belief: Belief, model: Model) -> Scalar:
    """True where the slope is still about as unknown as at first."""
    i = model.layout.index("grade_rad")
    return belief.cov[i, i] > (LEARNT_SHARE * model.noise.grade_std_rad) ** 2


def is_driven(belief: Belief, unexplained_m_s: Scalar, clean: CleanSample, model: Model) -> Scalar:
    """True where traction and motor currents act in the direction of the unexplained change."""
    along = model.scene.robot.rolling[: model.driven, 0]
    by_ground = along @ model.traction_N(belief.mean) * unexplained_m_s > 0.0
    by_motors = along @ clean.current_A * unexplained_m_s > 0.0
    return every([by_ground, by_motors])


def log_friction_of_sliding(belief: Belief, unexplained_m_s: Scalar, model: Model) -> Scalar:
    """State `log_friction` at which the ground gives no more than the traction that the wheels have."""
    parts, force_N = model.layout.split(belief.mean), model.traction_N(belief.mean)
    away = where(unexplained_m_s > 0.0, SLIDING_M_S, -SLIDING_M_S)
    slip = model.slip(belief.mean) + model.scene.robot.rolling[: model.driven, 0] * away
    most_N = traction(slip, parts, model.static_load_N, model.scene)
    ratios = force_N * most_N / maximum(most_N * most_N, _TINY_N2)
    return belief.mean[model.layout.index("log_friction")] + log(maximum(reduce(maximum, ratios), LEAST_RATIO))


def sliding(belief: Belief, log_friction: Scalar, unexplained_m_s: Scalar, model: Model) -> Belief:
    """Belief in wheels that slide under a body as fast as its forces say; ground and grade are unknown as at first."""
    layout, own = model.layout, model.layout.robot_states
    first = model.first_belief(belief.mean[layout.wheel(0) : own])
    mean = np.array([*belief.mean[:own], *first.mean[own:]])
    variances = np.array([*np.diag(belief.cov)[:own], *np.diag(first.cov)[own:]])
    friction = layout.index("log_friction")
    mean[0] = mean[0] - unexplained_m_s
    mean[friction] = log_friction
    variances[0] = variances[0] + (0.5 * unexplained_m_s) ** 2
    variances[friction] = FRICTION_STD**2
    return Belief(mean, np.diag(variances))
