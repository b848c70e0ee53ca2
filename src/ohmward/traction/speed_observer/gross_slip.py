"""Wheels that have let go and pass for a robot that is pushed, where nothing but the driven wheels shows the speed.

Wheels that turn faster than their forces explain either slide, or something else pushes the robot, as a slope would. A
filter whose wheels grip can only learn the second, a little in every step, and is ever surer of it. So the two are
weighed by how far they lie from what is usual, in squares of standard deviations (-2 log of their likelihood):

    grip   the ground and the slope that the filter has learnt
    slide  the friction at which these wheels slide with the force that they have, all else as usual

Where grip is unusual, slide about as likely, and the wheels turn the way in which motors and ground drive them, the
filter starts again: from wheels that slide under a body that is as fast as the forces say, and as uncertain as both
differ. That holds at first only: a slope that has been learnt has also been seen to hold while the forces changed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.trace import exp, log, maximum, sin, where
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample, largest, some
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.fusion import Fused
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.slip_step import traction

#: So long [s] it is remembered what the forces have not explained.
MEMORY_S = 1.0

#: Grip is unusual from here on; slide may be less likely than grip by so much (a factor of e).
UNUSUAL, DOUBT = 5.0, 2.0

#: A slope counts as learnt once its standard deviation is below this share of its first one.
LEARNT_SHARE = 0.5

#: What has been learnt of the ground before it is weighed; it must be there to learn.
LEARNT = ("log_friction", "log_stiffness", "grade_rad", "rolling_excess")

#: A slip [m/s] at which any ground gives what it can, the share of it that is known of a sliding wheel's friction, and
#: the least share of friction.
SLIDING_M_S, FRICTION_STD, LEAST_SHARE = 1.0, 0.1, 1e-3

_TINY_N2 = 1e-12


def is_ambiguous(model: Model) -> bool:
    """Whether grip and slide look alike: all that they differ in is learnt, and no other sensor tells them apart."""
    others = model.noise.pitch_std_rad, model.noise.speed_std_m_s, model.noise.passive_std_rad_s
    return set(LEARNT) <= set(model.layout.names) and all(std is None for std in others)


def unexplained_change(
    before_m_s: Any, old: Belief, prior: Belief, fused: Belief, reading: CleanSlipSample, model: Model
) -> Any:
    """Change [m/s] of the speed of late that no force explains, after a step from `old`; a slope is no force here.

    before_m_s: the same before the step.
    """
    slope_m_s = GRAVITY * sin(old.mean[model.layout.index("grade_rad")]) * reading.moving_s
    forced_m_s = prior.mean[0] - old.mean[0] + slope_m_s
    after_m_s = exp(-reading.dt_s / MEMORY_S) * before_m_s + fused.mean[0] - old.mean[0] - forced_m_s
    forces_unknown = some([g > 0.5 for g in reading.guessed]) | (reading.unknown_s > 0.0)
    return where(forces_unknown | (reading.moving_s <= 0.0), 0.0, after_m_s)


def test_hypotheses(
    fused: Fused, unexplained_m_s: Any, reading: CleanSlipSample, model: Model, gate: float
) -> tuple[Fused, Any]:
    """The belief, started again where wheels have let go; and the unexplained change after that.

    gate: the square of a friction, in its standard deviations, that is out of question.
    """
    belief, std, i = fused.belief, model.noise.friction_std, model.layout.index("grade_rad")
    log_friction = log_friction_of_sliding(belief, unexplained_m_s, model)
    grip, slide = squared_mahalanobis(belief, model), (log_friction / std) ** 2
    along = model.scene.robot.rolling[: model.driven, 0]
    driven = (along @ model.traction_N(belief.mean) * unexplained_m_s > 0.0) & (
        along @ reading.current_A * unexplained_m_s > 0.0
    )
    learning = belief.cov[i, i] > (LEARNT_SHARE * model.noise.grade_std_rad) ** 2
    likely = (grip > UNUSUAL) & (grip + DOUBT > slide) & (slide < gate)
    let_go = likely & learning & driven
    after = choose(let_go, sliding(belief, log_friction, unexplained_m_s, model), belief)
    flags = fused.flags + where(let_go, float(SlipFlag.GROUND_CHANGED), 0.0)
    return Fused(after, fused.shown, flags), where(let_go, 0.0, unexplained_m_s)


def squared_mahalanobis(belief: Belief, model: Model) -> Any:
    """Sum of squares of what has been learnt, each in its standard deviations before the first sample."""
    return sum((belief.mean[model.layout.index(name)] / model.initial_std(name)) ** 2 for name in LEARNT)


def log_friction_of_sliding(belief: Belief, unexplained_m_s: Any, model: Model) -> Any:
    """The state `log_friction` at which the ground gives no more than the force that the wheels have."""
    parts, force_N = model.layout.split(belief.mean), model.traction_N(belief.mean)
    away = where(unexplained_m_s > 0.0, SLIDING_M_S, -SLIDING_M_S)
    slip = model.slip(belief.mean) + model.scene.robot.rolling[: model.driven, 0] * away
    most_N = traction(slip, parts, model.static_load_N, model.scene)
    shares = [f * m / maximum(m * m, _TINY_N2) for f, m in zip(force_N, most_N, strict=True)]
    return belief.mean[model.layout.index("log_friction")] + log(maximum(largest(shares), LEAST_SHARE))


def sliding(belief: Belief, log_friction: Any, unexplained_m_s: Any, model: Model) -> Belief:
    """Wheels that slide under a body that is as fast as its forces say; all that lasts is as at first."""
    layout, own = model.layout, model.scene.robot.freedoms + model.driven
    first = model.first_belief(belief.mean[layout.wheel(0) : own])
    mean = np.array([*belief.mean[:own], *first.mean[own:]])
    variances = np.array([*np.diag(belief.cov)[:own], *np.diag(first.cov)[own:]])
    i = layout.index("log_friction")
    mean[0], mean[i] = mean[0] - unexplained_m_s, log_friction
    variances[0], variances[i] = variances[0] + (0.5 * unexplained_m_s) ** 2, FRICTION_STD**2
    return Belief(mean, np.diag(variances))
