"""Sensors of the body, each an update of its own: gyro, pitch, accelerometer, standstill.

Each function takes the correction so far and returns it with one more. A sensor that `ObserverNoise` does not have
costs nothing; a measurement that is missing or outside its gate changes nothing. Speeds from outside and passive wheels
have files of their own, `external_speed` and `passive_wheels`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, Correction, Function
from ohmward.filters.gate import choose, correct_gated, inflate, time_rejected
from ohmward.filters.sanitize import some
from ohmward.trace import isfinite, logical_not, maximum, minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.held import ROCKS_M_S
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.speed_observer.model import Model

#: Standard deviation of the zero speed and yaw rate of a robot that stands [m/s, rad/s].
STANDSTILL_STD = 0.003

#: A pitch outside its gate for longer [s] is no glitch.
GLITCH_S = 0.05


class BodyTimers(NamedTuple):
    """Time [s] for which a sensor of the body has been outside its gate, and by how much."""

    speed_s: Any  #: external speed
    disputed_m_s: Any  #: innovation of the last external speed where it was outside; 0 where it was used
    innovation_sum: Any  #: of external speeds that were used, over their standard deviations, and fading
    gyro_s: Any  #: gyro
    pitch_s: Any  #: pitch
    passive_s: np.ndarray  #: (wheels - driven,) encoders of the wheels that are not driven
    passive_sum: Any  #: of the innovations that these have in common, over their standard deviations, and fading


class BodyCorrection(NamedTuple):
    """Belief after measurements of the body, and conditions on them."""

    belief: Belief  #: after them
    rejected: BodyTimers  #: after the step, of the sensors that have been used
    observable: Scalar = False  #: one of them shows the speed of the body
    #: outside its gate
    gyro_rejected: Scalar = False
    speed_rejected: Scalar = False
    passive_rejected: Scalar = False
    passive_doubted: Scalar = False  #: one of the passive wheels has been so for too long
    speed_reset: Scalar = False  #: the estimate was opened for an external speed that contradicted it again


class SensorGate(NamedTuple):
    """Settings of the gates: NIS beyond which a measurement is not used, and time [s] outside it that is too long."""

    nis: float
    reset_after_s: float


def use_gyro(body: BodyCorrection, clean: CleanSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the yaw rate; one that has been outside its gate for too long is right, and the estimate opened."""
    i = model.layout.index("yaw_rate_rad_s")
    if model.noise.gyro_std_rad_s is None:
        return body
    y = clean.yaw_rate_rad_s
    nu = where(isfinite(y), y - body.belief.mean[i], 0.0)
    opened = inflate(body.belief, i, nu * nu)
    prior = choose(body.rejected.gyro_s > gate.reset_after_s, opened, body.belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[i : i + 1], model.stds(clean).gyro_rad_s[0] ** 2, gate.nis)
    rejected = isfinite(y) & logical_not(accepted)
    gyro_s = time_rejected(body.rejected.gyro_s, clean.dt_s, rejected, isfinite(y))
    return body._replace(belief=belief, gyro_rejected=rejected, rejected=body.rejected._replace(gyro_s=gyro_s))


def use_pitch(body: BodyCorrection, clean: CleanSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the pitch, which is the grade under a stiff robot.

    One that is off for longer than a glitch shows the edge of a slope, and the grade is opened for it: what the wheels
    have made of it may be their slip.
    """
    std = model.noise.pitch_std_rad
    if std is None or not model.states.grade:
        return body
    i = model.layout.index("grade_rad")
    y = clean.pitch_rad
    nu = where(isfinite(y), y - body.belief.mean[i], 0.0)
    opened = inflate(body.belief, i, nu * nu)
    prior = choose(body.rejected.pitch_s > minimum(GLITCH_S, gate.reset_after_s), opened, body.belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[i : i + 1], std**2, gate.nis)
    rejected = isfinite(y) & logical_not(accepted)
    pitch_s = time_rejected(body.rejected.pitch_s, clean.dt_s, rejected, isfinite(y))
    return body._replace(belief=belief, rejected=body.rejected._replace(pitch_s=pitch_s))


def use_accelerometer(body: BodyCorrection, clean: CleanSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the specific force along x."""
    std, y = model.noise.accelerometer_std_m_s2, clean.acceleration_m_s2
    if std is None:
        return body
    belief, _ = correct_sensor(body.belief, y, lambda x: model.specific_force(x, clean), std**2, gate.nis)
    return body._replace(belief=belief)


def use_standstill(body: BodyCorrection, resting: Scalar, model: Model) -> BodyCorrection:
    """Correct with the zero speed and yaw rate of a robot at rest."""
    belief = body.belief
    for i in range(model.scene.robot.freedoms):
        belief = kalman.correct_state(belief, i, 0.0, STANDSTILL_STD**2, resting)
    return body._replace(belief=belief, observable=some([body.observable, resting]))


def use_held(body: BodyCorrection, held: Scalar, model: Model) -> BodyCorrection:
    """Correct with the zero speed of a robot that is held while its wheels turn, however fast they have taken it."""
    if model.noise.speed_std_m_s is None:
        return body
    nu = body.belief.mean[0]
    opened = inflate(body.belief, 0, nu * nu - body.belief.cov[0, 0])
    belief = kalman.correct_state(choose(held, opened, body.belief), 0, 0.0, ROCKS_M_S**2, held)
    return body._replace(belief=belief, observable=some([body.observable, held]))


def correct_sensor(belief: Belief, y: Scalar, h: Function, variance: Scalar, gate: float) -> tuple[Belief, Scalar]:
    """The belief after y = h(x) (1,) with noise of this variance, and the condition that the measurement was used."""

    def correct(measured: np.ndarray) -> Correction:
        return extended.correct(belief, measured, h, np.array([[variance]]))

    return correct_gated(belief, y, correct, gate)


def disturbance_unknown(belief: Belief, model: Model, least_rad: Scalar = 0.0) -> Belief:
    """The belief with the grade, which stands for every unmodelled disturbance, as unknown as at first or as this."""
    if not model.states.grade:
        return belief
    i = model.layout.index("grade_rad")
    return inflate(belief, i, maximum(model.noise.grade_std_rad**2, least_rad**2) - belief.cov[i, i])
