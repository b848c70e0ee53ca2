"""Sensors of the body, each an update of its own: passive wheels, gyro, pitch, accelerometer, speed, standstill.

Each function takes the correction so far and returns it with one more. A sensor that `ObserverNoise` does not have
costs nothing; a measurement that is missing or outside its gate changes nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, Correction, Function
from ohmward.filters.gate import choose, correct_gated, inflate, time_rejected
from ohmward.filters.linear_algebra import std as std_of
from ohmward.filters.sanitize import between, every, some, within
from ohmward.trace import isfinite, logical_not, maximum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample
from ohmward.traction.speed_observer.estimate import SlipSample
from ohmward.traction.speed_observer.late import History, change_since
from ohmward.traction.speed_observer.model import Model

#: Standard deviation of the zero speed and yaw rate of a robot that stands [m/s, rad/s].
STANDSTILL_STD = 0.003

#: A disturbance that the model lacks may have made an innovation of the speed within this time [s].
OPENED_S = 0.2

#: A faster turn [rad/s] is a gyro's fault: the range of those that robots carry is 2000 degrees a second.
MOST_YAW_RAD_S = 35.0

#: An external speed beyond these limits is a source's fault: the speed [m/s] and its age [s] make it no measurement, a
#: standard deviation [m/s] outside of its own is replaced by the one of `ObserverNoise`.
FASTEST_M_S, OLDEST_S = 100.0, 60.0
SPEED_STD_M_S = (1e-4, 10.0)


class BodyTimers(NamedTuple):
    """Time [s] for which a sensor of the body has been outside its gate.

    speed_s: external speed.
    gyro_s: gyro.
    passive_s: (wheels - driven,) encoders of the wheels that are not driven.
    """

    speed_s: Any
    gyro_s: Any
    passive_s: np.ndarray


class BodyCorrection(NamedTuple):
    """Belief after measurements of the body, and conditions on them.

    belief: after them.
    rejected: after the step, of the sensors that have been used.
    observable: one of them shows the speed of the body.
    gyro_rejected, speed_rejected, passive_rejected: outside its gate.
    passive_doubted: one of the passive wheels has been so for too long.
    speed_reset: the estimate was opened for an external speed that contradicted it for too long.
    """

    belief: Belief
    rejected: BodyTimers
    observable: Scalar = False
    gyro_rejected: Scalar = False
    speed_rejected: Scalar = False
    passive_rejected: Scalar = False
    passive_doubted: Scalar = False
    speed_reset: Scalar = False


class SensorGate(NamedTuple):
    """Settings of the gates: NIS beyond which a measurement is not used, and time [s] outside it that is too long."""

    nis: float
    reset_after_s: float


def use_passive_wheels(
    body: BodyCorrection, lag: np.ndarray, clean: CleanSlipSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """Correct with the speeds of the wheels that are not driven; lag: (wheels,) as of `Model.encoder_lag`.

    One that contradicts for too long is at fault; where all do, the speed is, and it is opened for them.
    """
    n, times_s = model.driven, body.rejected.passive_s
    if model.noise.passive_std_rad_s is None or not len(times_s):
        return body
    body = body._replace(passive_doubted=some(time_s > gate.reset_after_s for time_s in times_s))
    wrong = every(time_s > gate.reset_after_s for time_s in times_s)
    nu = model.scene.robot.wheel.radius_m * (clean.wheel_speed_rad_s[n] + lag[n]) - body.belief.mean[0]
    opened = disturbance_unknown(inflate(body.belief, 0, nu * nu), model)
    body = body._replace(belief=choose(wrong & clean.wheel_measured[n], opened, body.belief))
    after_s = []
    for k, measured, time_s in zip(range(n, len(lag)), clean.wheel_measured[n:], times_s, strict=True):
        y = where(measured, clean.wheel_speed_rad_s[k] + lag[k], np.nan)
        belief, accepted = correct_sensor(
            body.belief, y, model.passive_speed(k), model.stds(clean).encoder_rad_s[k] ** 2, gate.nis
        )
        rejected = measured & logical_not(accepted)
        after_s.append(time_rejected(time_s, clean.dt_s, rejected, measured))
        body = body._replace(
            belief=belief,
            observable=some([body.observable, accepted]),
            passive_rejected=some([body.passive_rejected, rejected]),
        )
    return body._replace(rejected=body.rejected._replace(passive_s=np.array(after_s)))


def use_gyro(
    body: BodyCorrection, sample: SlipSample, clean: CleanSlipSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """Correct with the yaw rate; one that has been outside its gate for too long is right, and the estimate opened."""
    i = model.layout.index("yaw_rate_rad_s")
    if model.noise.gyro_std_rad_s is None:
        return body
    y = where(within(sample.yaw_rate_rad_s, MOST_YAW_RAD_S), sample.yaw_rate_rad_s, np.nan)
    nu = where(isfinite(y), y - body.belief.mean[i], 0.0)
    opened = inflate(body.belief, i, nu * nu)
    prior = choose(body.rejected.gyro_s > gate.reset_after_s, opened, body.belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[i : i + 1], model.stds(clean).gyro_rad_s[0] ** 2, gate.nis)
    rejected = isfinite(y) & logical_not(accepted)
    gyro_s = time_rejected(body.rejected.gyro_s, clean.dt_s, rejected, isfinite(y))
    return body._replace(belief=belief, gyro_rejected=rejected, rejected=body.rejected._replace(gyro_s=gyro_s))


def use_pitch(body: BodyCorrection, sample: SlipSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the pitch, which is the grade under a stiff robot."""
    std = model.noise.pitch_std_rad
    if std is None or not model.states.grade:
        return body
    i = model.layout.index("grade_rad")
    belief, _ = correct_sensor(body.belief, sample.pitch_rad, lambda x: x[i : i + 1], std**2, gate.nis)
    return body._replace(belief=belief)


def use_accelerometer(
    body: BodyCorrection, sample: SlipSample, clean: CleanSlipSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """Correct with the specific force along x."""
    std, y = model.noise.accelerometer_std_m_s2, sample.acceleration_m_s2
    if std is None:
        return body
    belief, _ = correct_sensor(body.belief, y, lambda x: model.specific_force(x, clean), std**2, gate.nis)
    return body._replace(belief=belief)


def use_speed(
    body: BodyCorrection,
    sample: SlipSample,
    clean: CleanSlipSample,
    history: History,
    fastest_m_s: Scalar,
    model: Model,
    gate: SensorGate,
) -> BodyCorrection:
    """Correct with the external speed, which may be late: y = v - (predicted change since) + noise.

    A disturbance of the grade's sigma may have acted over its age. A speed outside its gate is not used, but where a
    robot may have it, |y| <= fastest_m_s, the estimate is opened at once: as uncertain as the innovation, on a ground
    as unknown as at first. Where it has been outside for longer than `reset_after_s`, it is used then, too.
    """
    std = model.noise.speed_std_m_s
    if std is None:
        return body
    own_std = where(between(sample.speed_std_m_s, *SPEED_STD_M_S), sample.speed_std_m_s, std)
    age_s = where(between(sample.speed_age_s, 0.0, OLDEST_S), sample.speed_age_s, 0.0)
    drift = GRAVITY * maximum(model.noise.grade_std_rad, grade_std_rad(body.belief, model)) * age_s
    credible = within(sample.speed_m_s, FASTEST_M_S) & logical_not(sample.speed_age_s > OLDEST_S)
    y = where(credible, sample.speed_m_s + change_since(history, age_s), np.nan)

    nu = where(credible, y, body.belief.mean[0]) - body.belief.mean[0]
    since_s = time_rejected(body.rejected.speed_s, clean.dt_s, True, False, sparse=True)
    reset = credible & (since_s > gate.reset_after_s)
    opened = opened_for(body.belief, nu, model)
    prior = choose(reset, opened, body.belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[:1], own_std * own_std + drift * drift, gate.nis)
    rejected = isfinite(y) & logical_not(accepted)
    return body._replace(
        belief=choose(rejected & (abs(y) <= fastest_m_s), opened, belief),
        observable=some([body.observable, accepted]),
        speed_rejected=rejected,
        speed_reset=reset,
        rejected=body.rejected._replace(
            speed_s=time_rejected(body.rejected.speed_s, clean.dt_s, rejected, credible, sparse=True)
        ),
    )


def opened_for(belief: Belief, nu_m_s: Scalar, model: Model) -> Belief:
    """The belief as uncertain of the speed as this innovation, on a ground as unknown as at first."""
    belief = disturbance_unknown(inflate(belief, 0, nu_m_s * nu_m_s), model, nu_m_s / (GRAVITY * OPENED_S))
    if model.states.friction == "known":
        return belief
    for i in sorted({model.layout.friction(k) for k in range(model.driven)}):
        belief = inflate(belief, i, model.noise.friction_std**2 - belief.cov[i, i])
    return belief


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


def grade_std_rad(belief: Belief, model: Model) -> Scalar:
    """Standard deviation [rad] of the grade; 0 where it is no state."""
    i = model.layout.index("grade_rad") if model.states.grade else None
    return 0.0 if i is None else std_of(belief.cov[i, i])


def disturbance_unknown(belief: Belief, model: Model, least_rad: Scalar = 0.0) -> Belief:
    """The belief with the grade, which stands for every unmodelled disturbance, as unknown as at first or as this."""
    if not model.states.grade:
        return belief
    i = model.layout.index("grade_rad")
    return inflate(belief, i, maximum(model.noise.grade_std_rad**2, least_rad**2) - belief.cov[i, i])
