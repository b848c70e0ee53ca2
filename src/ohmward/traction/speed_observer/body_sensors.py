"""Sensors of the body, each an update of its own: passive wheels, gyro, pitch, accelerometer, speed, standstill.

Each function takes the correction so far and returns it with one more. A sensor that `ObserverNoise` does not have
costs nothing; a measurement that is missing or outside its gate changes nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, Correction, Function
from ohmward.filters.gate import choose, correct_gated, inflate, time_rejected
from ohmward.filters.sanitize import between, some, within
from ohmward.trace import isfinite, logical_not, where
from ohmward.trace.expression import Scalar
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample
from ohmward.traction.speed_observer.estimate import SlipSample
from ohmward.traction.speed_observer.late import History, change_since
from ohmward.traction.speed_observer.model import Model

#: Standard deviation of the zero speed and yaw rate of a robot that stands [m/s, rad/s].
STANDSTILL_STD = 0.003

#: An external speed beyond these limits is a source's fault: the speed [m/s] and its age [s] make it no measurement, a
#: standard deviation [m/s] outside of its own is replaced by the one of `ObserverNoise`.
FASTEST_M_S, OLDEST_S = 100.0, 60.0
SPEED_STD_M_S = (1e-4, 10.0)


class BodyCorrection(NamedTuple):
    """Belief after measurements of the body, and conditions on them.

    belief: after them.
    observable: one of them shows the speed of the body.
    gyro_rejected, speed_rejected: outside its gate.
    speed_reset: the estimate was opened for an external speed that contradicted it for too long.
    speed_rejected_s: time for which the external speed has been outside its gate.
    """

    belief: Belief
    observable: Scalar = False
    gyro_rejected: Scalar = False
    speed_rejected: Scalar = False
    speed_reset: Scalar = False
    speed_rejected_s: Scalar = 0.0


def use_passive_wheels(
    body: BodyCorrection, lag: np.ndarray, clean: CleanSlipSample, model: Model, gate: float
) -> BodyCorrection:
    """Correct with the speeds of the wheels that are not driven; lag: (wheels,) as of `Model.encoder_lag`."""
    std = model.noise.passive_std_rad_s
    if std is None:
        return body
    for k in range(model.driven, len(model.scene.robot.places)):
        y = where(clean.wheel_measured[k], clean.wheel_speed_rad_s[k] + lag[k], np.nan)
        belief, accepted = correct_sensor(body.belief, y, model.passive_speed(k), std**2, gate)
        body = body._replace(belief=belief, observable=some([body.observable, accepted]))
    return body


def use_gyro(body: BodyCorrection, sample: SlipSample, model: Model, gate: float) -> BodyCorrection:
    """Correct with the yaw rate."""
    std, i = model.noise.gyro_std_rad_s, model.layout.index("yaw_rate_rad_s")
    if std is None:
        return body
    y = sample.yaw_rate_rad_s
    belief, accepted = correct_sensor(body.belief, y, lambda x: x[i : i + 1], std**2, gate)
    return body._replace(belief=belief, gyro_rejected=isfinite(y) & logical_not(accepted))


def use_pitch(body: BodyCorrection, sample: SlipSample, model: Model, gate: float) -> BodyCorrection:
    """Correct with the pitch, which is the grade under a stiff robot."""
    std = model.noise.pitch_std_rad
    if std is None or not model.states.grade:
        return body
    i = model.layout.index("grade_rad")
    belief, _ = correct_sensor(body.belief, sample.pitch_rad, lambda x: x[i : i + 1], std**2, gate)
    return body._replace(belief=belief)


def use_accelerometer(
    body: BodyCorrection, sample: SlipSample, clean: CleanSlipSample, model: Model, gate: float
) -> BodyCorrection:
    """Correct with the specific force along x."""
    std, y = model.noise.accelerometer_std_m_s2, sample.acceleration_m_s2
    if std is None:
        return body
    belief, _ = correct_sensor(body.belief, y, lambda x: model.specific_force(x, clean), std**2, gate)
    return body._replace(belief=belief)


def use_speed(
    body: BodyCorrection,
    sample: SlipSample,
    clean: CleanSlipSample,
    history: History,
    model: Model,
    gate: float,
    reset_after_s: float,
) -> BodyCorrection:
    """Correct with the external speed, which may be late: y = v - (predicted change since) + noise.

    A disturbance of the grade's sigma may have acted over its age. Where the speed has been outside its gate for longer
    than `reset_after_s` the estimate is opened for it: as uncertain as the innovation, and the disturbance as uncertain
    as at first.
    """
    std = model.noise.speed_std_m_s
    if std is None:
        return body
    own_std = where(between(sample.speed_std_m_s, *SPEED_STD_M_S), sample.speed_std_m_s, std)
    age_s = where(between(sample.speed_age_s, 0.0, OLDEST_S), sample.speed_age_s, 0.0)
    drift = GRAVITY * model.noise.grade_std_rad * age_s
    credible = within(sample.speed_m_s, FASTEST_M_S) & logical_not(sample.speed_age_s > OLDEST_S)
    y = where(credible, sample.speed_m_s + change_since(history, age_s), np.nan)

    nu = where(credible, y, body.belief.mean[0]) - body.belief.mean[0]
    since_s = time_rejected(body.speed_rejected_s, clean.dt_s, True, False, sparse=True)
    reset = credible & (since_s > reset_after_s)
    opened = disturbance_unknown(inflate(body.belief, 0, nu * nu), model)
    prior = choose(reset, opened, body.belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[:1], own_std * own_std + drift * drift, gate)
    rejected = isfinite(y) & logical_not(accepted)
    return body._replace(
        belief=belief,
        observable=some([body.observable, accepted]),
        speed_rejected=rejected,
        speed_reset=reset,
        speed_rejected_s=time_rejected(body.speed_rejected_s, clean.dt_s, rejected, credible, sparse=True),
    )


def use_standstill(body: BodyCorrection, resting: Scalar, model: Model) -> BodyCorrection:
    """Correct with the zero speed and yaw rate of a robot at rest."""
    belief = body.belief
    for i in range(model.scene.robot.freedoms):
        belief = kalman.correct_state(belief, i, 0.0, STANDSTILL_STD**2, resting)
    return body._replace(belief=belief, observable=some([body.observable, resting]))


def correct_sensor(belief: Belief, y: Scalar, h: Function, variance: Scalar, gate: float) -> tuple[Belief, Scalar]:
    """The belief after y = h(x) (1,) with noise of this variance, and the condition that the measurement was used."""

    def correct(measured: np.ndarray) -> Correction:
        return extended.correct(belief, measured, h, np.array([[variance]]))

    return correct_gated(belief, y, correct, gate)


def disturbance_unknown(belief: Belief, model: Model) -> Belief:
    """The belief with the grade, which stands for every unmodelled disturbance, as unknown as at first."""
    if not model.states.grade:
        return belief
    i = model.layout.index("grade_rad")
    return inflate(belief, i, model.noise.grade_std_rad**2 - belief.cov[i, i])
