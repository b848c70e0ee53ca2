"""Sensors of the body, each an update of its own: gyro, pitch, standstill, speeds, passive wheels.

Each function takes the correction so far and returns it with one more. A sensor that `ObserverNoise` does not have
costs nothing; a measurement that is missing or outside its gate changes nothing.

External speed: from GNSS, visual or lidar odometry, optical flow; late, and sometimes in conflict with the wheels.

Wheels that slide steadily look like gripping wheels of a robot with their speed, and the filter is confident of that. A
speed from outside that contradicts it is outside its gate. A single one may be a glitch, so it is not used, but the
estimate stays wide until the next one, for `reset_after_s` at most: otherwise the wheels, whose grip is in dispute,
would narrow it at once. A second one in a row that agrees is used, and so is one after others that leaned to the same
side. Then the
wheels slide: they keep their traction, and the friction becomes the one that gives it at their new slip.

Passive wheels: encoders on undriven wheels, which roll at the robot's speed.

They are the best speed available, so the filter follows their common innovation. An innovation inside the gate to the
same side for some tenths of a second is a force that the model lacks, such as that of a drawbar or of a steep slope:
the disturbance is widened for it, before the estimate lags so far that the gate excludes the wheels. If all are outside
their gates and agree, it is no glitch, and the speed is widened for them.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters import extended, kalman
from ohmward.filters.belief import Belief, Correction, Function
from ohmward.filters.gate import choose, correct_gated, inflate, time_rejected, widen
from ohmward.filters.sanitize import every, some
from ohmward.trace import Scalar, clip, exp, isfinite, linearize, log, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.motion.outside_speed import ROCKS_M_S
from ohmward.traction.motion.sample import LEAST_DIVISOR, CleanSample, History, change_since
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.encoders import SPIKE_S, friction_unknown
from ohmward.traction.speed_observer.model import Model

#: Standard deviation of the zero speed and yaw rate of a robot that stands [m/s, rad/s].
STANDSTILL_STD = 0.003


class BodyTimers(NamedTuple):
    """Time [s] for which a sensor of the body has been outside its gate, and by how much."""

    speed_s: Any  #: external speed
    disputed_m_s: Any  #: innovation of the last external speed if it was outside; 0 if it was used
    innovation_sum: Any  #: fading sum of the normalised innovations of external speeds that were used
    gyro_s: Any  #: gyro
    pitch_s: Any  #: pitch
    passive_s: np.ndarray  #: (wheels - driven,) encoders of the wheels that are not driven
    passive_sum: Any  #: fading sum of the normalised innovations that these have in common


class BodyCorrection(NamedTuple):
    """Belief after measurements of the body, and conditions on them."""

    belief: Belief  #: after them
    rejected: BodyTimers  #: after the step, of the sensors that have been used
    observable: Scalar = False  #: one of them shows the speed of the body
    #: outside its gate
    gyro_rejected: Scalar = False
    speed_rejected: Scalar = False
    passive_rejected: Scalar = False
    passive_suspect: Scalar = False  #: one of the passive wheels has been outside for too long
    speed_reset: Scalar = False  #: the estimate was widened for an external speed that contradicted it again


class SensorGate(NamedTuple):
    """Settings of the gates: NIS beyond which a measurement is not used, and time [s] outside it that is too long."""

    nis: float
    reset_after_s: float


def use_gyro(body: BodyCorrection, clean: CleanSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the yaw rate; one outside its gate for too long is accepted, and the estimate widened."""
    i = model.layout.index("yaw_rate_rad_s")
    if model.noise.gyro_std_rad_s is None:
        return body
    variance = model.stds(clean).gyro_rad_s[0] ** 2
    belief, rejected, gyro_s = correct_element(
        body.belief, i, clean.yaw_rate_rad_s, variance, body.rejected.gyro_s, clean.dt_s, gate
    )
    return body._replace(belief=belief, gyro_rejected=rejected, rejected=body.rejected._replace(gyro_s=gyro_s))


def use_pitch(body: BodyCorrection, clean: CleanSample, model: Model, gate: SensorGate) -> BodyCorrection:
    """Correct with the pitch, which is the grade under a stiff robot.

    A pitch outside its gate for longer than a glitch shows the edge of a slope, and the grade is widened for it: what
    the wheels attribute to a grade may be their slip.
    """
    std = model.noise.pitch_std_rad
    if std is None or not model.states.grade:
        return body
    i = model.layout.index("grade_rad")
    soon = gate._replace(reset_after_s=min(SPIKE_S, gate.reset_after_s))
    belief, _, pitch_s = correct_element(
        body.belief, i, clean.pitch_rad, std**2, body.rejected.pitch_s, clean.dt_s, soon
    )
    return body._replace(belief=belief, rejected=body.rejected._replace(pitch_s=pitch_s))


def use_standstill(body: BodyCorrection, resting: Scalar, model: Model) -> BodyCorrection:
    """Correct with the zero speed and yaw rate of a robot at rest."""
    belief = body.belief
    for i in range(model.scene.robot.freedoms):
        belief = kalman.correct_state(belief, i, 0.0, STANDSTILL_STD**2, resting)
    return body._replace(belief=belief, observable=some([body.observable, resting]))


def use_held(body: BodyCorrection, held: Scalar, clean: CleanSample, model: Model) -> BodyCorrection:
    """Correct with the zero speed of a robot that is held while its wheels turn, whatever speed they suggest.

    It rocks, with errors that last for a second.
    """
    if model.noise.speed_std_m_s is None:
        return body
    nu = body.belief.mean[0]
    opened = widen(body.belief, 0, nu * nu)
    lasts = 1.0 / clip(clean.dt_s, LEAST_DIVISOR, 1.0)
    belief = kalman.correct_state(choose(held, opened, body.belief), 0, 0.0, ROCKS_M_S**2 * lasts, held)
    return body._replace(belief=belief, observable=some([body.observable, held]))


def correct_sensor(belief: Belief, y: Scalar, h: Function, variance: Scalar, gate: float) -> tuple[Belief, Scalar]:
    """The belief after y = h(x) (1,) with noise of this variance, and the condition that the measurement was used."""

    def correct(measured: np.ndarray) -> Correction:
        return extended.correct(belief, measured, h, np.array([[variance]]))

    return correct_gated(belief, y, correct, gate)


def correct_element(
    belief: Belief, i: int, y: Scalar, variance: Scalar, rejected_s: Scalar, dt_s: Scalar, gate: SensorGate
) -> tuple[Belief, Scalar, Scalar]:
    """The belief after y = x_i + noise, widened for it if y has been outside its gate for too long.

    Also returns the condition that y is outside its gate, and the time for which it has been.
    """
    nu = where(isfinite(y), y - belief.mean[i], 0.0)
    prior = choose(rejected_s > gate.reset_after_s, inflate(belief, i, nu * nu), belief)
    belief, accepted = correct_sensor(prior, y, lambda x: x[i : i + 1], variance, gate.nis)
    rejected = isfinite(y) & logical_not(accepted)
    return belief, rejected, time_rejected(rejected_s, dt_s, rejected, isfinite(y))


#: Time [s] in which a disturbance that the model lacks may have caused an innovation of the speed.
OPENED_S = 0.2

#: Innovations that lean to one side for long are a contradiction too: decay factor of their sum at each one, and
#: squared sum over its variance from which they are one; with white noise 16 occurs once in 16,000.
LASTS, LASTING_NIS = 0.8, 16.0

#: Largest disturbance, in sigmas of the grade, that a late speed may have missed.
LATE_GRADES = 1.5

#: If an external speed shows that wheels slide: smallest share to which the friction falls, relative standard deviation
#: of the friction by the motors' force, and a negligible force [N].
LEAST_SHARE, SLIDING_STD, TINY_N = 0.01, 0.3, 1e-3

#: Two external speeds in a row agree if the innovation of the second is at least this share of the first's.
AGREES = 0.5


class ReceivedSpeed(NamedTuple):
    """External speed compared with the belief."""

    credible: Scalar  #: the condition that there is one
    speed_m_s: Scalar  #: predicted to now; nan without one
    variance: Scalar  #: of that
    innovation_m_s: Scalar  #: against the belief; 0 without one


class Dispute(NamedTuple):
    """Disagreement of wheels and external speeds."""

    innovation_sum: Scalar  #: as in `BodyTimers`, with this speed
    reset: Scalar  #: the condition that the speed is used although it contradicts
    open_m_s: Scalar  #: standard deviation that the speed keeps at least until the next one comes


def use_speed(
    body: BodyCorrection,
    clean: CleanSample,
    history: History,
    fastest_m_s: Scalar,
    model: Model,
    gate: SensorGate,
) -> BodyCorrection:
    """Correct with the external speed, or widen the estimate for it; one impossible for the robot is not used.

    fastest_m_s: greatest speed that the body can have, by its wheels and the longest possible slide.
    """
    if model.noise.speed_std_m_s is None:
        return body
    y = external_speed(clean, body.belief, history, model.noise.speed_std_m_s, fastest_m_s, model)
    dispute = disputed(y, body.belief, body.rejected, clean.dt_s, gate)
    opened = opened_for(body.belief, y.innovation_m_s, model)
    held = widen(body.belief, 0, dispute.open_m_s**2)
    prior = choose(dispute.reset, sliding_for(opened, y.innovation_m_s, model), held)
    belief, accepted = correct_sensor(prior, y.speed_m_s, lambda x: x[:1], y.variance, gate.nis)
    rejected = isfinite(y.speed_m_s) & logical_not(accepted)
    last = body.rejected
    return body._replace(
        belief=choose(rejected, opened, belief),
        observable=some([body.observable, accepted]),
        speed_rejected=some([rejected, every([isfinite(clean.speed_m_s), logical_not(y.credible)])]),
        speed_reset=dispute.reset,
        rejected=last._replace(
            speed_s=time_rejected(last.speed_s, clean.dt_s, rejected, y.credible, sparse=True),
            disputed_m_s=where(y.credible, where(rejected, y.innovation_m_s, 0.0), last.disputed_m_s),
            innovation_sum=where(rejected | dispute.reset, 0.0, dispute.innovation_sum),
        ),
    )


def external_speed(
    clean: CleanSample, belief: Belief, history: History, std_m_s: float, fastest_m_s: Scalar, model: Model
) -> ReceivedSpeed:
    """The external speed of a sample, y = v - (predicted change since) + noise, or none where |y| > fastest_m_s.

    A disturbance of the grade's sigma may have acted over its age.

    std_m_s: of a source that does not give its own.
    """
    own_std = where(isfinite(clean.speed_std_m_s), clean.speed_std_m_s, std_m_s)
    grade_std = minimum(model.std_of("grade_rad", belief.cov), LATE_GRADES * model.noise.grade_std_rad)
    drift = GRAVITY * maximum(model.noise.grade_std_rad, grade_std) * clean.speed_age_s
    y = clean.speed_m_s + change_since(history, clean.speed_age_s)
    credible = every([isfinite(clean.speed_m_s), abs(y) <= fastest_m_s])
    innovation_m_s = where(credible, y, belief.mean[0]) - belief.mean[0]
    return ReceivedSpeed(credible, where(credible, y, np.nan), own_std * own_std + drift * drift, innovation_m_s)


def disputed(y: ReceivedSpeed, belief: Belief, last: BodyTimers, dt_s: Scalar, gate: SensorGate) -> Dispute:
    """The dispute after this speed, by it and by those before it; last: before the step."""
    since_s = time_rejected(last.speed_s, dt_s, True, False, sparse=True)
    too_long = since_s > gate.reset_after_s
    confirmed = y.innovation_m_s * last.disputed_m_s > AGREES * last.disputed_m_s**2
    normalised, most = y.innovation_m_s / sqrt(belief.cov[0, 0] + y.variance), math.sqrt(gate.nis)
    innovation_sum = LASTS * last.innovation_sum + clip(normalised, -most, most)
    leans = (1.0 - LASTS**2) * innovation_sum**2 > LASTING_NIS
    return Dispute(
        innovation_sum=where(y.credible, innovation_sum, last.innovation_sum),
        reset=every([y.credible, some([confirmed, leans, too_long])]),
        open_m_s=where(some([y.credible, too_long]), 0.0, last.disputed_m_s),
    )


def opened_for(belief: Belief, nu_m_s: Scalar, model: Model) -> Belief:
    """The belief with a speed as uncertain as this innovation, and a ground as uncertain as at first."""
    belief = inflate(belief, 0, nu_m_s * nu_m_s)
    if model.states.grade:  # it stands for every disturbance that the model lacks
        least_rad = nu_m_s / (GRAVITY * OPENED_S)
        variance = maximum(model.noise.grade_std_rad**2, least_rad**2)
        belief = widen(belief, model.layout.index("grade_rad"), variance)
    return friction_unknown(belief, model)


def sliding_for(belief: Belief, nu_m_s: Scalar, model: Model) -> Belief:
    """The belief with a ground on which the wheels slide as they do if the speed is off by this innovation.

    They keep their traction, so the friction ratio falls to that traction over the one they would have had.
    """
    if not model.states.friction:
        return belief
    slipped, mean, cov = belief.mean.copy(), belief.mean.copy(), belief.cov.copy()
    slipped[0] = slipped[0] + nu_m_s
    most_N = model.traction_N(slipped)
    shares = model.traction_N(belief.mean) * most_N / maximum(most_N * most_N, TINY_N**2)
    i = model.layout.index("log_friction")
    mean[i] = mean[i] + reduce(maximum, [log(clip(share, LEAST_SHARE, 1.0)) for share in shares])
    cov[i, :] = cov[:, i] = 0.0
    cov[i, i] = SLIDING_STD**2
    return Belief(mean, cov)


#: Time constant [s] with which a common innovation of the passive wheels is forgotten.
COMMON_LASTS_S = 0.2


class CommonInnovation(NamedTuple):
    """Innovation that all passive wheels have in common: the smallest one where all lean to the same side, else 0."""

    speed_m_s: Scalar  #: of the speed of the body
    normalised: Scalar  #: over its standard deviation; 0 where a wheel is outside its gate or not measured
    confirmed: Scalar  #: the condition that there are several wheels and they agree


def use_passive_wheels(
    body: BodyCorrection, lag: np.ndarray, clean: CleanSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """Correct with the speeds of the wheels that are not driven; lag: (wheels,) as of `Model.encoder_lag`.

    Where they agree and one is outside its gate, none is used: their common innovation is the speed's, and a single one
    of them would turn the robot for it.
    """
    if model.noise.passive_std_rad_s is None or len(lag) == model.driven:
        return body
    common = common_innovation(body, lag, clean, model, gate)
    body = opened_for_passive(body, common, clean, model, gate)
    belief, used = body.belief, []
    for k in range(model.driven, len(lag)):
        belief, accepted = use_passive_wheel(belief, k, lag[k], clean, model, gate)
        used.append(accepted)
    measured = clean.wheel_measured[model.driven :]
    refused = common.confirmed & logical_not(every(used))
    used = [accepted & logical_not(refused) for accepted in used]
    rejected = measured & logical_not(np.array(used))
    times = zip(body.rejected.passive_s, stands_for_s(clean, model), rejected, measured, strict=True)
    return body._replace(
        belief=choose(refused, body.belief, belief),
        observable=some([body.observable, *used]),
        passive_rejected=some(rejected),
        rejected=body.rejected._replace(passive_s=np.array([time_rejected(*of_wheel) for of_wheel in times])),
    )


def opened_for_passive(
    body: BodyCorrection, common: CommonInnovation, clean: CleanSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """The correction with a speed widened for passive wheels that all contradict it; one that does so is at fault.

    Where they are outside their gates, the driven wheels slide: else these would draw the speed back until the next
    value of passive wheels that are slower than the samples.
    """
    times_s, last_sum = body.rejected.passive_s, body.rejected.passive_sum
    measured = every(clean.wheel_measured[model.driven :])
    lasts = exp(-reduce(maximum, stands_for_s(clean, model)) / COMMON_LASTS_S)
    innovation_sum = where(measured, lasts * last_sum + common.normalised, last_sum)
    leans = measured & ((1.0 - lasts * lasts) * innovation_sum**2 > LASTING_NIS)
    wrong_after_s = where(common.confirmed, minimum(SPIKE_S, gate.reset_after_s), gate.reset_after_s)
    wrong = measured & every(time_s > wrong_after_s for time_s in times_s)
    opened = opened_for(body.belief, common.speed_m_s, model)
    sliding = sliding_for(opened, common.speed_m_s, model)
    return body._replace(
        belief=choose(wrong, sliding, choose(leans, opened, body.belief)),
        passive_suspect=some(time_s > gate.reset_after_s for time_s in times_s),
        rejected=body.rejected._replace(passive_sum=where(leans, 0.0, innovation_sum)),
    )


def use_passive_wheel(
    belief: Belief, k: int, lag_rad_s: Scalar, clean: CleanSample, model: Model, gate: SensorGate
) -> tuple[Belief, Scalar]:
    """The belief after the speed of wheel k, and the condition that it was used."""
    y = where(clean.wheel_measured[k], clean.wheel_speed_rad_s[k] + lag_rad_s, np.nan)
    variance = model.stds(clean).encoder_rad_s[k] ** 2
    return correct_sensor(belief, y, model.passive_speed(k), variance, gate.nis)


def stands_for_s(clean: CleanSample, model: Model) -> np.ndarray:
    """Time [s] (passive,) that a value of each passive wheel stands for, which may be slower than the samples."""
    return maximum(clean.interval_s[model.driven :], clean.dt_s)


def common_innovation(
    body: BodyCorrection, lag: np.ndarray, clean: CleanSample, model: Model, gate: SensorGate
) -> CommonInnovation:
    """The innovation that the passive wheels have in common, against the belief before all of them."""
    x, P = body.belief
    innovations, normalised = [], []
    for k in range(model.driven, len(lag)):
        predicted, H = linearize(model.passive_speed(k), x)
        nu = where(clean.wheel_measured[k], clean.wheel_speed_rad_s[k] + lag[k] - predicted[0], 0.0)
        S = H[0] @ P @ H[0] + model.stds(clean).encoder_rad_s[k] ** 2
        innovations.append(model.scene.robot.wheel.radius_m * nu)
        normalised.append(where(nu * nu <= gate.nis * S, nu / sqrt(S), 0.0))
    least_m_s = in_common(innovations)
    most_m_s = reduce(maximum, [abs(nu) for nu in innovations])
    confirmed = (abs(least_m_s) > AGREES * most_m_s) if len(innovations) > 1 else False
    return CommonInnovation(least_m_s, in_common(normalised), confirmed)


def in_common(values: list[Scalar]) -> Scalar:
    """The value nearest to zero where all have the same sign, else 0."""
    return maximum(reduce(minimum, values), 0.0) + minimum(reduce(maximum, values), 0.0)
