"""Passive wheels: encoders on wheels that no motor drives, which roll as fast as the robot goes.

They are the best speed that there is, so the filter follows what they have in common. An innovation inside the gate to
the same side for some tenths of a second is a force that the model lacks, as that of a drawbar or of a steep slope: the
disturbance is opened for it, before the estimate lags so far that the gate excludes the wheels. Where all are beyond
their gates and say the same, they are no glitch, and the speed is opened for them.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.filters.gate import choose, time_rejected
from ohmward.filters.sanitize import every, some
from ohmward.trace import exp, linearize, logical_not, maximum, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.speed_observer.body_sensors import BodyCorrection, SensorGate, correct_sensor
from ohmward.traction.speed_observer.encoders import SPIKE_S
from ohmward.traction.speed_observer.external_speed import AGREES, LASTING_NIS, opened_for
from ohmward.traction.speed_observer.model import Model

#: Time constant [s] with which an innovation that they have in common is forgotten.
LASTS_S = 0.2


class CommonInnovation(NamedTuple):
    """Innovation that all passive wheels have in common: the smallest one where all lean to the same side, else 0."""

    speed_m_s: Scalar  #: of the speed of the body
    normalised: Scalar  #: over its standard deviation; 0 where a wheel is outside its gate or not measured
    confirmed: Scalar  #: the condition that all of several wheels say about the same


def use_passive_wheels(
    body: BodyCorrection, lag: np.ndarray, clean: CleanSample, model: Model, gate: SensorGate
) -> BodyCorrection:
    """Correct with the speeds of the wheels that are not driven; lag: (wheels,) as of `Model.encoder_lag`.

    One that contradicts for too long is at fault; where all do, the speed is, and it is opened for them.
    """
    n, times_s = model.driven, body.rejected.passive_s
    if model.noise.passive_std_rad_s is None or not len(times_s):
        return body
    common = common_innovation(body, lag, clean, model, gate)
    lasts = exp(-clean.dt_s / LASTS_S)
    innovation_sum = lasts * body.rejected.passive_sum + common.normalised
    leans = (1.0 - lasts * lasts) * innovation_sum**2 > LASTING_NIS
    wrong_after_s = where(common.confirmed, minimum(SPIKE_S, gate.reset_after_s), gate.reset_after_s)
    wrong = every(time_s > wrong_after_s for time_s in times_s) & every(clean.wheel_measured[n:])
    opened = opened_for(body.belief, common.speed_m_s, model)
    body = body._replace(
        belief=choose(some([leans, wrong]), opened, body.belief),
        passive_doubted=some(time_s > gate.reset_after_s for time_s in times_s),
    )
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
    passive_sum = where(leans, 0.0, innovation_sum)
    return body._replace(rejected=body.rejected._replace(passive_s=np.array(after_s), passive_sum=passive_sum))


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
