"""External speed: from GNSS, visual or lidar odometry, optical flow; late, and at odds with the wheels at times.

Wheels that slide steadily look as if they gripped under a robot as fast as they are, and the filter is sure of that. A
speed from outside that contradicts it is outside its gate. One may be a glitch, so it is not used, but the estimate is
open until the next one comes, for `reset_after_s` at most: the wheels would close it at once, and whether they grip is
in dispute. A second one in a row that says the same is used, and so is one after others that leaned to the same side.
Then the wheels slide: they keep their traction, and the friction is the one that gives it at their new slip.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose, inflate, time_rejected
from ohmward.filters.linear_algebra import std as std_of
from ohmward.filters.sanitize import every, some
from ohmward.trace import clip, isfinite, log, logical_not, maximum, minimum, sqrt, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.intervals import History, change_since
from ohmward.traction.motion.sanitize import CleanSample
from ohmward.traction.robot.robot import GRAVITY
from ohmward.traction.speed_observer.body_sensors import (
    BodyCorrection,
    BodyTimers,
    SensorGate,
    correct_sensor,
    disturbance_unknown,
)
from ohmward.traction.speed_observer.model import Model

#: A disturbance that the model lacks may have made an innovation of the speed within this time [s].
OPENED_S = 0.2

#: Innovations that lean to one side for long are a contradiction, too: share of their sum that each keeps, and squared
#: sum over its variance from which on they are one; 16 is one in 16,000 where the noise is white.
LASTS, LASTING_NIS = 0.8, 16.0

#: A speed that comes late may have missed a disturbance of so many sigmas of the grade.
LATE_GRADES = 1.5

#: Where an external speed says that wheels slide: least share to which the friction falls, relative standard deviation
#: of the friction by the force that the motors give, and a force that is nearly none [N].
LEAST_SHARE, SLIDING_STD, TINY_N = 0.01, 0.3, 1e-3

#: Two external speeds in a row say the same where the second is off by this share of what the first was off by.
AGREES = 0.5


class ReceivedSpeed(NamedTuple):
    """An external speed against the belief."""

    credible: Scalar  #: the condition that there is one
    speed_m_s: Scalar  #: what it says of now; nan where there is none
    variance: Scalar  #: of that
    innovation_m_s: Scalar  #: against the belief; 0 where there is none


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
    """Correct with the external speed, or open the estimate for it; one that no such robot can have is not used.

    fastest_m_s: greatest speed that the body can have, by its wheels and by how long it can have slid.
    """
    if model.noise.speed_std_m_s is None:
        return body
    received = external_speed(clean, body.belief, history, model.noise.speed_std_m_s, model)
    y = within_reach(received, fastest_m_s)
    dispute = disputed(y, body.belief, body.rejected, clean.dt_s, gate)
    opened = opened_for(body.belief, y.innovation_m_s, model)
    held = inflate(body.belief, 0, dispute.open_m_s**2 - body.belief.cov[0, 0])
    prior = choose(dispute.reset, sliding_for(opened, y.innovation_m_s, model), held)
    belief, accepted = correct_sensor(prior, y.speed_m_s, lambda x: x[:1], y.variance, gate.nis)
    rejected = isfinite(y.speed_m_s) & logical_not(accepted)
    last = body.rejected
    return body._replace(
        belief=choose(rejected, opened, belief),
        observable=some([body.observable, accepted]),
        speed_rejected=some([rejected, every([received.credible, logical_not(y.credible)])]),
        speed_reset=dispute.reset,
        rejected=last._replace(
            speed_s=time_rejected(last.speed_s, clean.dt_s, rejected, y.credible, sparse=True),
            disputed_m_s=where(y.credible, where(rejected, y.innovation_m_s, 0.0), last.disputed_m_s),
            innovation_sum=where(rejected | dispute.reset, 0.0, dispute.innovation_sum),
        ),
    )


def external_speed(clean: CleanSample, belief: Belief, history: History, std_m_s: float, model: Model) -> ReceivedSpeed:
    """The external speed of a sample: y = v - (predicted change since) + noise.

    A disturbance of the grade's sigma may have acted over its age.

    std_m_s: of a source that does not give its own.
    """
    own_std = where(isfinite(clean.speed_std_m_s), clean.speed_std_m_s, std_m_s)
    grade_std = minimum(grade_std_rad(belief, model), LATE_GRADES * model.noise.grade_std_rad)
    drift = GRAVITY * maximum(model.noise.grade_std_rad, grade_std) * clean.speed_age_s
    credible = isfinite(clean.speed_m_s)
    y = clean.speed_m_s + change_since(history, clean.speed_age_s)
    innovation_m_s = where(credible, y, belief.mean[0]) - belief.mean[0]
    return ReceivedSpeed(credible, y, own_std * own_std + drift * drift, innovation_m_s)


def within_reach(y: ReceivedSpeed, fastest_m_s: Scalar) -> ReceivedSpeed:
    """The external speed, or none where the body cannot have it: |y| > fastest_m_s."""
    reachable = every([y.credible, abs(y.speed_m_s) <= fastest_m_s])
    return y._replace(
        credible=reachable,
        speed_m_s=where(reachable, y.speed_m_s, np.nan),
        innovation_m_s=where(reachable, y.innovation_m_s, 0.0),
    )


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
    """The belief as uncertain of the speed as this innovation, on a ground as unknown as at first."""
    belief = disturbance_unknown(inflate(belief, 0, nu_m_s * nu_m_s), model, nu_m_s / (GRAVITY * OPENED_S))
    if model.states.friction == "known":
        return belief
    for i in sorted({model.layout.friction(k) for k in range(model.driven)}):
        belief = inflate(belief, i, model.noise.friction_std**2 - belief.cov[i, i])
    return belief


def sliding_for(belief: Belief, nu_m_s: Scalar, model: Model) -> Belief:
    """The belief with a ground that lets the wheels slide as they do where the speed is off by this innovation.

    They keep their traction, so the friction ratio falls to that traction over the one they would have had.
    """
    if model.states.friction == "known":
        return belief
    slipped, mean, cov = belief.mean.copy(), belief.mean.copy(), belief.cov.copy()
    slipped[0] = slipped[0] + nu_m_s
    most_N = model.traction_N(slipped)
    shares = model.traction_N(belief.mean) * most_N / maximum(most_N * most_N, TINY_N**2)
    logs = [log(clip(share, LEAST_SHARE, 1.0)) for share in shares]
    places = [model.layout.friction(k) for k in range(model.driven)]
    for i in sorted(set(places)):
        mean[i] = mean[i] + reduce(maximum, [x for x, place in zip(logs, places, strict=True) if place == i])
        cov[i, :] = cov[:, i] = 0.0
        cov[i, i] = SLIDING_STD**2
    return Belief(mean, cov)


def grade_std_rad(belief: Belief, model: Model) -> Scalar:
    """Standard deviation [rad] of the grade; 0 where it is no state."""
    i = model.layout.index("grade_rad") if model.states.grade else None
    return 0.0 if i is None else std_of(belief.cov[i, i])
