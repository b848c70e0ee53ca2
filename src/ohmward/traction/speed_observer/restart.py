"""Restart of a belief that this robot cannot have: no number, faster than its wheels, or against every encoder.

A robot on wheels is as fast as its wheels have turned of late, or faster by what a slope adds while they slide:

    |v| <= SHARE p + s + REST,   p+ = max(r |omega|, |v| where a sensor of the body shows it, e^(-dt/T) p)

with s the speed that sliding can have added since something last showed the speed. A belief beyond that is a filter's
fault, whatever its covariance says, and so is one that no encoder has agreed with for long.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.sanitize import every, some, within
from ohmward.trace import exp, isfinite, logical_not, maximum, minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.speed_observer.model import UNKNOWN_M_S, UNKNOWN_M_S2, Model

#: Time constant [s] with which the greatest speed of the wheels is forgotten: sliding lasts for less.
FASTEST_MEMORY_S = 10.0

#: A body on omni wheels is faster than their rims by 2/sqrt(3), a tyre larger than its data sheet by some percent; a
#: robot that rolls back on its own has no more than REST_M_S before its wheels show it.
SHARE, REST_M_S = 1.25, 0.25

#: Acceleration [m/s^2] that sliding down a slope of 0.2 rad gives.
SLIDING_M_S2 = 2.0

#: No belief of a robot reaches this speed [m/s], and none is so uncertain: twice the fastest robot, as an estimate may
#: err where a sensor may not.
LOST_M_S = 100.0

#: Yaw rate and wheel speed that no belief of a robot reaches [rad/s]; none is so uncertain either.
LOST_YAW_RAD_S, LOST_WHEEL_RAD_S = 50.0, 1e3

#: Standard deviation of the speed after a restart, as a share of the rims' speed: wheels may be spinning then.
RESTART_SHARE = 0.5


class Reach(NamedTuple):
    """Speeds that the body can have reached [m/s]."""

    wheels_m_s: Scalar  #: greatest speed that wheels or sensors of the body have shown of late
    sliding_m_s: Scalar  #: speed that sliding can have added since something last showed the speed


def advance_reach(
    reach: Reach, belief: Belief, body_observable: Scalar, unobserved_s: Scalar, clean: CleanSample, model: Model
) -> Reach:
    """The reach after a step.

    body_observable: the condition that a sensor of the body shows its speed in this step.
    unobserved_s: time for which nothing had shown the speed before the step.
    """
    parts, robot = model.layout.split(belief.mean), model.scene.robot
    rims = robot.wheel.radius_m * parts.radius_ratio * abs(parts.omega)
    body = where(body_observable, abs(belief.mean[0]), 0.0)
    gap = minimum(UNKNOWN_M_S2 * clean.unmodelled_s, UNKNOWN_M_S)
    slid = reach.sliding_m_s + SLIDING_M_S2 * clean.dt_s
    return Reach(
        wheels_m_s=maximum(reduce(maximum, [*rims, body]), exp(-clean.dt_s / FASTEST_MEMORY_S) * reach.wheels_m_s),
        sliding_m_s=minimum(gap + where(unobserved_s > 0.0, slid, 0.0), UNKNOWN_M_S),
    )


def fastest_m_s(reach: Reach) -> Scalar:
    """Greatest speed [m/s] that the body can have."""
    return SHARE * reach.wheels_m_s + reach.sliding_m_s + REST_M_S


def is_lost(belief: Belief, reach: Reach, rejected_s: np.ndarray, locked_out_s: float, model: Model) -> Scalar:
    """True where the belief is none that this robot can have.

    rejected_s: (driven,) time for which each encoder has been outside its gate.
    locked_out_s: where all have been for longer, it is the belief that is wrong.
    """
    x, P = belief
    layout = model.layout
    yaw, own = layout.index("yaw_rate_rad_s"), layout.robot_states
    fastest = minimum(fastest_m_s(reach), LOST_M_S)
    sane = [
        isfinite(sum(x) + sum(P[i, j] for i in range(len(x)) for j in range(i + 1))),
        *[abs(x[i]) <= fastest for i in range(model.scene.robot.freedoms - 1)],
        P[0, 0] <= LOST_M_S**2,
        within(x[yaw], LOST_YAW_RAD_S),
        *[within(x[i], LOST_WHEEL_RAD_S) & (P[i, i] <= LOST_WHEEL_RAD_S**2) for i in range(layout.wheel(0), own)],
        some(time <= locked_out_s for time in rejected_s),
    ]
    return logical_not(every(sane))


def restarted(before: Belief, clean: CleanSample, model: Model) -> Belief:
    """A new belief from this sample: a body that moves as its wheels say, or not at all as they do.

    before: belief before the step, for wheels that are not measured.
    """
    layout, n = model.layout, model.driven
    usable = [where(within(value, LOST_WHEEL_RAD_S), value, 0.0) for value in before.mean[layout.wheel(0) :][:n]]
    omega = where(clean.wheel_measured[:n], clean.wheel_speed_rad_s[:n], np.array(usable))
    rim_m_s = reduce(maximum, model.scene.robot.wheel.radius_m * abs(omega))
    mean, cov = model.first_belief(omega)
    speed, *others = np.diag(cov)
    return Belief(mean, np.diag(np.array([speed + (RESTART_SHARE * rim_m_s) ** 2, *others])))
