"""Encoders of the driven wheels, and what to make of a wheel that does what the model excludes.

Such a wheel has met other ground, or its encoder is broken. At first the encoder is believed: with the square of the
surprise added to the variance of the wheel's own speed, nearly all of the jump goes there, and none of it to the body.
While it stays outside its gate, sigma points learn the friction from it; after `reset_after_s` the encoder is at
fault. It is used again once it agrees.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.kalman import correct_state
from ohmward.filters.linear_algebra import TINY
from ohmward.trace import logical_not, maximum, sqrt, where
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample, some
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.fusion import Fused, widened
from ohmward.traction.speed_observer.model import Model

#: The push of a wheel whose encoder is not believed may be wrong by this [m/s^2] at least.
DOUBT_M_S2 = 0.1

#: No ground gives more than so many times the load; what would need more is a spike, if it does not last for SPIKE_S.
MOST_ADHESION = 2.0
SPIKE_S = 0.05


class Matched(NamedTuple):
    """What R of the encoders is matched to ([T] 3.50), each (driven,).

    square: mean of the squared residuals and the variances P_yy after the update [rad^2/s^2].
    samples: how many are in it, at most the window.
    """

    square: np.ndarray
    samples: np.ndarray


class WheelUpdate(NamedTuple):
    """One wheel's encoder used.

    belief: after it.
    square: squared residual and variance after it.
    agrees: whether the encoder is measured, believed and no surprise.
    surprising: whether it is a surprise.
    """

    belief: Belief
    square: Any
    agrees: Any
    surprising: Any


def use_encoders(
    prior: Belief,
    lag: np.ndarray,
    torque_noise: np.ndarray,
    reading: CleanSlipSample,
    matched: Matched,
    rejected_s: np.ndarray,
    model: Model,
    surprise: float,
    reset_after_s: float,
    jumps_teach: bool,
) -> tuple[Fused, list[WheelUpdate]]:
    """The prior corrected with the speeds of the driven wheels, and each wheel's update.

    lag: (wheels,) [rad/s] by which the wheels are faster at the end of the step than where the encoders saw them.
    torque_noise: (driven,) [rad/s] of the predicted speeds, see `Model.torque_noise_rad_s`.
    rejected_s: (driven,) how long each encoder has been surprising.
    jumps_teach: whether the prior tells what a jump says of the friction: sigma points do, a slope at grip does not.
    """
    belief, updates = prior, []
    for k in range(model.driven):
        R = encoder_variance(matched, k, model)
        nu = reading.wheel_speed_rad_s[k] + lag[k] - belief.mean[model.layout.wheel(k)]
        spike = (abs(nu) > possible_jump(k, reading, model)) & (rejected_s[k] < SPIKE_S)
        believed = reading.measured[k] & (rejected_s[k] <= reset_after_s) & logical_not(spike)
        doubt = where(believed, 0.0, doubted_variance(belief, k, reading.moving_s, model))
        y = reading.wheel_speed_rad_s[k] + lag[k]
        jumps = (rejected_s[k] <= 0.0) if jumps_teach else True
        update = _use_encoder(belief, k, y, R, believed, jumps, torque_noise[k], model, surprise)
        belief = widened(update.belief, 0, doubt)
        updates.append(update._replace(belief=belief, surprising=update.surprising & reading.measured[k]))
    changed = some([u.surprising & (t <= reset_after_s) for u, t in zip(updates, rejected_s, strict=True)])
    doubted = some([t > reset_after_s for t in rejected_s])
    flags = where(changed, float(SlipFlag.GROUND_CHANGED), 0.0) + where(doubted, float(SlipFlag.ENCODER_DOUBTED), 0.0)
    return Fused(belief, 0.0, flags), updates


def _use_encoder(
    belief: Belief, k: int, y: Any, R: Any, believed: Any, jumps: Any, torque_noise: Any, model: Model, surprise: float
) -> WheelUpdate:
    i = model.layout.wheel(k)
    nu = y - belief.mean[i]
    surprising = nu * nu > surprise * (belief.cov[i, i] + R)
    new_ground = believed & surprising
    open_to = choose(new_ground, ground_unknown(belief, k, where(jumps, nu, 0.0), model), belief)
    after = correct_state(open_to, i, y, R, believed)
    if model.states.stiffness:
        j = model.layout.index("log_stiffness")
        after = with_part_of_gain(open_to, after, j, true_share(open_to, i, j, torque_noise))
    square = (y - after.mean[i]) ** 2 + after.cov[i, i]
    return WheelUpdate(after, square, believed & (nu * nu <= surprise * (belief.cov[i, i] + R)), surprising)


def true_share(belief: Belief, i: int, j: int, noise: Any) -> Any:
    """How much of the square of what state j is learnt from is no noise, in [0, 1].

    The speed of wheel i shows the stiffness j by h = P_ij / P_jj: the slip that the currents predict, less what the
    speed of the body follows. It has their noise, so it is a regressor with errors: its square is too large by their
    variance, and what is learnt from them makes wheels look stiffer than they are.
    """
    h = belief.cov[i, j] / maximum(belief.cov[j, j], TINY)
    return maximum(0.0, 1.0 - noise * noise / maximum(h * h, TINY))


def with_part_of_gain(before: Belief, after: Belief, i: int, share: Any) -> Belief:
    """A correction by one number of which state i keeps the share c of its gain K_i; c = 0 is Schmidt's filter.

    Joseph's form for such a gain changes one element of the covariance: P_ii- - c (2 - c) K_i^2 S.
    """
    mean, cov = after.mean.copy(), after.cov.copy()
    mean[i] = before.mean[i] + share * (after.mean[i] - before.mean[i])
    cov[i, i] = before.cov[i, i] + share * (2.0 - share) * (after.cov[i, i] - before.cov[i, i])
    return Belief(mean, cov)


def possible_jump(k: int, reading: CleanSlipSample, model: Model) -> Any:
    """By how much [rad/s] motor and ground can turn a wheel faster or slower than predicted in this step, at most."""
    robot = model.scene.robot
    ground_Nm = MOST_ADHESION * robot.wheel.radius_m * model.static_load_N[k]
    motor_Nm = robot.motor.wheel_constant_Nm_per_A * abs(reading.current_A[k])
    noise = 10.0 * model.noise.encoder_std_rad_s
    return noise + reading.dt_s * (motor_Nm + ground_Nm) / robot.inertia[robot.freedoms + k]


def encoder_variance(matched: Matched, k: int, model: Model) -> Any:
    """R of an encoder: its floor, or what the residuals say where that is more."""
    return maximum(model.noise.encoder_std_rad_s**2, matched.square[k])


def match(matched: Matched, updates: list[WheelUpdate], window: float) -> Matched:
    """With the residuals of the encoders that agreed."""
    samples = [where(u.agrees & (n < window), n + 1.0, n) for u, n in zip(updates, matched.samples, strict=True)]
    square = [
        where(u.agrees, m + (u.square - m) / maximum(n, 1.0), m)
        for u, m, n in zip(updates, matched.square, samples, strict=True)
    ]
    return Matched(np.array(square), np.array(samples))


def ground_unknown(belief: Belief, k: int, jump_rad_s: Any, model: Model) -> Belief:
    """The belief with the wheel free to have jumped so, and its friction as unknown as at first."""
    belief = widened(belief, model.layout.wheel(k), jump_rad_s * jump_rad_s)
    if model.states.friction == "known":
        return belief
    i = model.layout.friction(k)
    return widened(belief, i, model.noise.friction_std**2 - belief.cov[i, i])


def doubted_variance(belief: Belief, k: int, dt_s: Any, model: Model) -> Any:
    """Variance [m^2/s^2] that the speed gains in `dt_s` in which the traction of wheel k may have been another."""
    force_N = abs(model.traction_N(belief.mean)[k])
    growth = maximum(force_N / model.scene.robot.inertia[0], DOUBT_M_S2) * dt_s
    return growth * (growth + 2 * sqrt(maximum(belief.cov[0, 0], 0.0)))
