"""Measurements of the body, each an update of its own: passive wheels, gyro, pitch, accelerometer, speed, standstill.

Each function takes what has been fused so far and returns it with one more. A sensor that `Noise` does not have costs
nothing; a measurement that is no number or that the gate refuses changes nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, Function
from ohmward.filters.gate import choose, passes
from ohmward.trace import isfinite, logical_not, maximum, where
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample, within
from ohmward.traction.speed_observer.estimate import SlipFlag, SlipSample
from ohmward.traction.speed_observer.late import History, change_since
from ohmward.traction.speed_observer.model import Model

#: Standard deviation of "it stands" [m/s, rad/s].
STANDSTILL_STD = 0.003

#: An external speed beyond these limits is a source's fault: the speed [m/s] and its age [s] make it no measurement, a
#: standard deviation [m/s] outside of its own is replaced by the one of `Noise`.
FASTEST_M_S, OLDEST_S = 100.0, 60.0
SPEED_STD_M_S = (1e-4, 10.0)


class Fused(NamedTuple):
    """A belief with what its measurements did.

    belief: after them.
    shown: 1 where one of them shows the speed of the body, else 0.
    flags: sum of `SlipFlag`.
    """

    belief: Belief
    shown: Any
    flags: Any


def use_passive_wheels(fused: Fused, lag: np.ndarray, reading: CleanSlipSample, model: Model, gate: float) -> Fused:
    """With the speeds of the wheels that are not driven; lag: (wheels,) as of `Model.encoder_lag`."""
    std = model.noise.passive_std_rad_s
    if std is None:
        return fused
    for k in range(model.driven, len(model.scene.robot.places)):
        y = where(reading.measured[k], reading.wheel_speed_rad_s[k] + lag[k], np.nan)
        accepted, belief = gated(fused.belief, y, model.passive_speed(k), std**2, gate)
        fused = fused._replace(belief=belief, shown=where(accepted, 1.0, fused.shown))
    return fused


def use_gyro(fused: Fused, sample: SlipSample, model: Model, gate: float) -> Fused:
    """With the yaw rate."""
    std, i = model.noise.gyro_std_rad_s, model.layout.index("yaw_rate_rad_s")
    if std is None:
        return fused
    y = sample.yaw_rate_rad_s
    accepted, belief = gated(fused.belief, y, lambda x: x[i : i + 1], std**2, gate)
    return fused._replace(belief=belief, flags=fused.flags + refused(y, accepted, SlipFlag.GYRO_REJECTED))


def use_pitch(fused: Fused, sample: SlipSample, model: Model, gate: float) -> Fused:
    """With the pitch, which is the grade under a stiff robot."""
    std = model.noise.pitch_std_rad
    if std is None or not model.states.grade:
        return fused
    i = model.layout.index("grade_rad")
    _, belief = gated(fused.belief, sample.pitch_rad, lambda x: x[i : i + 1], std**2, gate)
    return fused._replace(belief=belief)


def use_accelerometer(fused: Fused, sample: SlipSample, reading: CleanSlipSample, model: Model, gate: float) -> Fused:
    """With the specific force along x."""
    std = model.noise.accelerometer_std_m_s2
    if std is None:
        return fused
    _, belief = gated(fused.belief, sample.acceleration_m_s2, lambda x: model.specific_force(x, reading), std**2, gate)
    return fused._replace(belief=belief)


def use_speed(
    fused: Fused, sample: SlipSample, history: History, doubtful: Any, model: Model, gate: float
) -> tuple[Fused, Any]:
    """With the external speed, which may be late; and 1 where the gate refused it, else 0.

    y = v - (what the model has added since) + noise; over the age the model's push is as wrong as the grade's sigma.

    doubtful: whether it has contradicted the estimate for too long: then the speed is opened for it.
    """
    std = model.noise.speed_std_m_s
    if std is None:
        return fused, 0.0 * fused.flags
    credible = (sample.speed_std_m_s >= SPEED_STD_M_S[0]) & (sample.speed_std_m_s <= SPEED_STD_M_S[1])
    own = where(credible, sample.speed_std_m_s, std)
    age_s = where((sample.speed_age_s > 0) & (sample.speed_age_s <= OLDEST_S), sample.speed_age_s, 0.0)
    there = within(sample.speed_m_s, FASTEST_M_S) & logical_not(sample.speed_age_s > OLDEST_S)
    y = where(there, sample.speed_m_s + change_since(history, age_s), np.nan)
    drift = GRAVITY * model.noise.grade_std_rad * age_s
    nu = where(there, y, fused.belief.mean[0]) - fused.belief.mean[0]
    anew = there & doubtful
    belief = choose(anew, push_unknown(widened(fused.belief, 0, nu * nu), model), fused.belief)
    accepted, belief = gated(belief, y, lambda x: x[:1], own * own + drift * drift, gate)
    flags = refused(y, accepted, SlipFlag.SPEED_REJECTED) + where(anew, float(SlipFlag.SPEED_TAKEN_ANEW), 0.0)
    return Fused(belief, where(accepted, 1.0, fused.shown), fused.flags + flags), refused(y, accepted, 1.0)


def use_standstill(fused: Fused, resting: Any, model: Model) -> Fused:
    """With the zero speed and yaw rate of a robot at rest."""
    belief = fused.belief
    for i in range(model.scene.robot.freedoms):
        belief = kalman.correct_state(belief, i, 0.0, STANDSTILL_STD**2, resting)
    flags = fused.flags + where(resting, float(SlipFlag.STANDSTILL), 0.0)
    return Fused(belief, where(resting, 1.0, fused.shown), flags)


def gated(belief: Belief, y: Any, h: Function, variance: Any, gate: float) -> tuple[Any, Belief]:
    """Whether the measurement y = h(x) (1,) is used, and the belief after it."""
    there = isfinite(y)
    correction = extended.correct(belief, np.array([where(there, y, 0.0)]), h, np.array([[variance]]))
    accepted = there & passes(correction.innovation, gate)
    return accepted, choose(accepted, correction.belief, belief)


def push_unknown(belief: Belief, model: Model) -> Belief:
    """The belief with the grade, which stands for every push that the model does not know, as unknown as at first."""
    if not model.states.grade:
        return belief
    i = model.layout.index("grade_rad")
    return widened(belief, i, model.noise.grade_std_rad**2 - belief.cov[i, i])


def widened(belief: Belief, i: int, variance: Any) -> Belief:
    """The belief with so much more variance of element i."""
    extra = np.zeros_like(belief.cov)
    extra[i, i] = maximum(variance, 0.0)
    return Belief(belief.mean, belief.cov + extra)


def refused(y: Any, accepted: Any, value: float) -> Any:
    """`value` where there was a measurement and it was not used, else 0."""
    return where(accepted, 0.0, where(isfinite(y), float(value), 0.0))
