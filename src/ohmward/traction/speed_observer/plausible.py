"""Samples against the belief before the step: first values of encoders, and currents that nothing can have taken."""

from __future__ import annotations

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import some
from ohmward.trace import logical_not, maximum, where
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample
from ohmward.traction.speed_observer.encoders import POSSIBLE_SIGMAS
from ohmward.traction.speed_observer.intervals import TINY_S, Intervals, was_seen
from ohmward.traction.speed_observer.model import Model

#: No ground takes more than so many times the load.
MOST_ADHESION = 2.0


def first_sight(belief: Belief, clean: CleanSlipSample, encoders: Intervals, model: Model) -> Belief:
    """The belief, or where an encoder shows its first value one of a body that moves as the wheels do.

    encoders: clocks before the step.
    """
    n, layout = model.driven, model.layout
    measured = clean.wheel_measured[:n]
    believed = belief.mean[layout.wheel(0) : layout.robot_states]
    first = measured & logical_not(was_seen(encoders)[:n])
    speeds = where(measured, clean.wheel_speed_rad_s[:n], believed)
    return choose(some(first), model.first_belief(speeds), belief)


def without_impossible_currents(clean: CleanSlipSample, before: Belief, model: Model) -> CleanSlipSample:
    """The sample without currents whose torque neither the ground nor the wheel can have taken.

    K_m n |I| <= MOST_ADHESION r N + J_w (|change of the wheel's speed| + its uncertainty) / dt
    """
    robot, layout, n = model.scene.robot, model.layout, model.driven
    wheels = slice(layout.wheel(0), layout.robot_states)
    room = [POSSIBLE_SIGMAS * std(P + model.noise.encoder_std_rad_s**2) for P in np.diag(before.cov)[wheels]]
    change = abs(clean.wheel_speed_rad_s[:n] - before.mean[wheels]) + np.array(room)
    wheel_Nm = robot.inertia[robot.freedoms :] * change / maximum(clean.dt_s, TINY_S)
    taken_Nm = MOST_ADHESION * robot.wheel.radius_m * model.static_load_N[:n] + wheel_Nm
    given_Nm = robot.motor.wheel_constant_Nm_per_A * abs(clean.current_A)
    possible = np.array([given <= taken for given, taken in zip(given_Nm, taken_Nm, strict=True)])
    untold = logical_not(clean.wheel_measured[:n])
    refused = clean.current_measured & logical_not(possible | untold)
    return clean._replace(current_measured=clean.current_measured & logical_not(refused), current_refused=some(refused))
