"""State of the speed observer from sample to sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief, PackedBelief, pack
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.held import Held
from ohmward.traction.motion.intervals import History, Intervals, empty_history, never
from ohmward.traction.speed_observer.apparent_inertia import ApparentInertia, untested
from ohmward.traction.speed_observer.body_sensors import BodyTimers
from ohmward.traction.speed_observer.encoders import FreeWheels, RejectedFor
from ohmward.traction.speed_observer.matched_noise import MatchedNoise, fixed, unmatched
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.restart import Reach


class ObserverState(NamedTuple):
    """State of the observer from sample to sample: plain numbers."""

    belief: PackedBelief  #: mean (n,) and lower triangle of the covariance
    matched: MatchedNoise  #: noise of the sensors; empty without matching
    current_A: np.ndarray  #: (driven,) last credible ones
    current_intervals: Intervals  #: of the motor currents, each (driven,)
    encoder_intervals: Intervals  #: of the encoders, each (wheels,)
    lag_rad_s: np.ndarray  #: (wheels,) `Model.encoder_lag` since each encoder's last value
    free: FreeWheels  #: the wheels as their motors alone would turn them
    history: History  #: predicted changes of the speed of late, for speeds that come late
    rest_s: Scalar  #: time for which wheels and motors have been at rest
    rejected: RejectedFor  #: for how long each encoder has been outside its gate, (driven,)
    body_rejected: BodyTimers  #: the same of the sensors of the body
    unexplained_m_s: Scalar  #: change of the speed of late without a force, see `gross_slip`
    inertia: ApparentInertia  #: test whether the wheels carry the robot
    held: Held  #: whether the robot is held while its wheels turn
    #: as in `MotionTimers`
    unobserved_s: Scalar
    stuck_s: Scalar
    reach: Reach  #: speeds that the body can have reached


def started(
    belief: Belief, model: Model, late_steps: int, matching: bool, before: ObserverState | None = None
) -> ObserverState:
    """State of an observer that has this belief and no past, but for the clocks and the noise of the sensors before."""
    n, wheels = model.driven, len(model.scene.robot.places)
    return ObserverState(
        belief=pack(belief),
        matched=before.matched if before else unmatched(model) if matching else fixed(),
        current_A=before.current_A if before else np.zeros(n),
        current_intervals=before.current_intervals if before else never(n),
        encoder_intervals=before.encoder_intervals if before else never(wheels),
        lag_rad_s=np.zeros(wheels),
        free=FreeWheels(belief.mean[model.layout.wheel(0) : model.layout.robot_states], np.zeros(n)),
        history=empty_history(0 if model.noise.speed_std_m_s is None else late_steps),
        rest_s=0.0,
        rejected=RejectedFor(np.zeros(n), np.zeros(n)),
        body_rejected=BodyTimers(0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(wheels - n), 0.0),
        unexplained_m_s=0.0,
        inertia=untested(),
        held=before.held if before else Held(),
        unobserved_s=0.0,
        stuck_s=0.0,
        reach=Reach(0.0, 0.0),
    )
