"""Encoders of the driven wheels, and a wheel that moves as the model excludes.

Such a wheel has met other ground, or its encoder is broken. At first the encoder is believed: with the square of the
innovation added to the variance of the wheel's own speed, nearly all of the jump goes there, and none of it to the
body. While the innovation stays outside its gate, sigma points learn the friction from it; after `reset_after_s` the
encoder is at fault. It is used again once it agrees.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose, inflate, time_rejected
from ohmward.filters.kalman import correct_state
from ohmward.filters.linear_algebra import TINY, std
from ohmward.filters.sanitize import some
from ohmward.trace import logical_not, maximum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.speed_observer.clean_sample import CleanSlipSample
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.slip_step import SlipStep

#: Least error [m/s^2] of the acceleration by a wheel whose encoder is not believed.
DOUBT_M_S2 = 0.1

#: No ground gives more than so many times the load; an innovation that would need more is a spike, if it lasts for less
#: than SPIKE_S.
MOST_ADHESION = 2.0
SPIKE_S = 0.05

#: Standard deviations of encoder noise that a possible jump leaves room for.
NOISE_SIGMAS = 10.0


class EncoderGate(NamedTuple):
    """Settings of the gate of an encoder.

    nis: NIS beyond which its wheel has met other ground.
    reset_after_s: time outside the gate after which the encoder is at fault.
    jumps_teach: the prior tells what a jump says of the friction: sigma points do, a slope at grip does not.
    """

    nis: float
    reset_after_s: float
    jumps_teach: bool


class MatchedNoise(NamedTuple):
    """Residuals that R of the encoders is matched to ([T] 3.50), each (driven,).

    square: mean of squared residuals plus variances P_yy after the update [rad^2/s^2].
    samples: number of them, at most the window.
    """

    square: np.ndarray
    samples: np.ndarray


class WheelCorrection(NamedTuple):
    """Update by one encoder.

    belief: after it.
    square: squared residual plus variance after it.
    used: the condition that the encoder is measured, believed and inside its gate.
    ground_changed: the condition that the wheel moved as the model excludes.
    rejected_s: time outside the gate.
    """

    belief: Belief
    square: Scalar
    used: Scalar
    ground_changed: Scalar
    rejected_s: Scalar


class EncoderCorrection(NamedTuple):
    """Update by all encoders.

    belief: after it.
    wheels: each driven wheel's.
    ground_changed: the condition that one of them moved as the model excludes.
    doubted: the condition that one of the encoders is at fault.
    """

    belief: Belief
    wheels: list[WheelCorrection]
    ground_changed: Scalar
    doubted: Scalar


def correct_wheels(
    prior: Belief,
    lag: np.ndarray,
    step: SlipStep,
    clean: CleanSlipSample,
    matched: MatchedNoise,
    rejected_s: np.ndarray,
    model: Model,
    gate: EncoderGate,
) -> EncoderCorrection:
    """The prior corrected with the speeds of the driven wheels, one after the other.

    lag: (wheels,) [rad/s], `Model.encoder_lag`.
    step: that the mean of the belief made.
    rejected_s: (driven,) time for which each encoder has been outside its gate.
    """
    belief = prior
    wheels: list[WheelCorrection] = []
    torque_noise = model.torque_noise_rad_s(step, clean)
    for k in range(model.driven):
        y = clean.wheel_speed_rad_s[k] + lag[k]
        R = maximum(model.noise.encoder_std_rad_s**2, matched.square[k])
        wheels.append(correct_wheel(belief, k, y, R, torque_noise[k], rejected_s[k], clean, model, gate))
        belief = wheels[-1].belief
    ground_changed = some(wheel.ground_changed for wheel in wheels)
    doubted = some(s > gate.reset_after_s for s in rejected_s)
    return EncoderCorrection(belief, wheels, ground_changed, doubted)


def correct_wheel(
    prior: Belief,
    k: int,
    y: Scalar,
    R: Scalar,
    torque_noise: Scalar,
    rejected_s: Scalar,
    clean: CleanSlipSample,
    model: Model,
    gate: EncoderGate,
) -> WheelCorrection:
    """The prior corrected with the speed y of driven wheel k; an encoder that is not believed only widens it.

    R: variance of the encoder.
    torque_noise: standard deviation of the predicted speed by the error of the torque.
    rejected_s: time for which the encoder has been outside its gate before.
    """
    i = model.layout.wheel(k)
    nu = y - prior.mean[i]
    S = prior.cov[i, i] + R
    rejected = nu * nu > gate.nis * S
    spike = (abs(nu) > possible_jump(k, clean, model)) & (rejected_s < SPIKE_S)
    diverged = rejected_s > gate.reset_after_s
    believed = clean.wheel_measured[k] & logical_not(diverged) & logical_not(spike)

    jumped = where(rejected_s <= 0.0, nu, 0.0) if gate.jumps_teach else nu
    opened = choose(believed & rejected, ground_unknown(prior, k, jumped, model), prior)
    posterior = correct_state(opened, i, y, R, believed)
    if model.states.stiffness:
        j = model.layout.index("log_stiffness")
        share = true_share(opened, i, j, torque_noise)
        posterior = with_part_of_gain(opened, posterior, j, share)
    square = (y - posterior.mean[i]) ** 2 + posterior.cov[i, i]
    doubt = where(believed, 0.0, doubted_variance(prior, k, clean.modelled_s, model))
    return WheelCorrection(
        belief=inflate(posterior, 0, doubt),
        square=square,
        used=believed & (nu * nu <= gate.nis * S),
        ground_changed=clean.wheel_measured[k] & rejected & logical_not(diverged),
        rejected_s=time_rejected(rejected_s, clean.dt_s, rejected, clean.wheel_measured[k]),
    )


def true_share(belief: Belief, i: int, j: int, noise: Scalar) -> Scalar:
    """Share in [0, 1] of the squared regressor of state j that is signal, not noise.

    The speed of wheel i shows the stiffness j by h = P_ij / P_jj: the slip that the currents predict, less what the
    speed of the body follows. It has their noise, so it is a regressor with errors: its square is too large by their
    variance, and what is learnt from them makes wheels look stiffer than they are.
    """
    h = belief.cov[i, j] / maximum(belief.cov[j, j], TINY)
    return maximum(0.0, 1.0 - noise * noise / maximum(h * h, TINY))


def with_part_of_gain(before: Belief, after: Belief, i: int, share: Scalar) -> Belief:
    """A correction by one number in which state i has only the share c of its gain K_i; c = 0 is Schmidt's filter.

    Joseph's form for such a gain changes one element of the covariance: P_ii- - c (2 - c) K_i^2 S.
    """
    mean, cov = after.mean.copy(), after.cov.copy()
    mean[i] = before.mean[i] + share * (after.mean[i] - before.mean[i])
    cov[i, i] = before.cov[i, i] + share * (2.0 - share) * (after.cov[i, i] - before.cov[i, i])
    return Belief(mean, cov)


def possible_jump(k: int, clean: CleanSlipSample, model: Model) -> Scalar:
    """Largest innovation [rad/s] of driven wheel k that motor and ground can cause in this step."""
    robot = model.scene.robot
    ground_Nm = MOST_ADHESION * robot.wheel.radius_m * model.static_load_N[k]
    motor_Nm = robot.motor.wheel_constant_Nm_per_A * abs(clean.current_A[k])
    noise = NOISE_SIGMAS * model.noise.encoder_std_rad_s
    return noise + clean.dt_s * (motor_Nm + ground_Nm) / robot.inertia[robot.freedoms + k]


def match(matched: MatchedNoise, wheels: list[WheelCorrection], window: float) -> MatchedNoise:
    """The matched noise with the residuals of the encoders that were used."""
    samples = [where(w.used & (n < window), n + 1.0, n) for w, n in zip(wheels, matched.samples, strict=True)]
    square = [
        where(w.used, m + (w.square - m) / maximum(n, 1.0), m)
        for w, m, n in zip(wheels, matched.square, samples, strict=True)
    ]
    return MatchedNoise(np.array(square), np.array(samples))


def ground_unknown(belief: Belief, k: int, jump_rad_s: Scalar, model: Model) -> Belief:
    """The belief after driven wheel k may have jumped so, with its friction as unknown as at first."""
    belief = inflate(belief, model.layout.wheel(k), jump_rad_s * jump_rad_s)
    if model.states.friction == "known":
        return belief
    i = model.layout.friction(k)
    return inflate(belief, i, model.noise.friction_std**2 - belief.cov[i, i])


def doubted_variance(belief: Belief, k: int, dt_s: Scalar, model: Model) -> Scalar:
    """Variance [m^2/s^2] that the speed gains in `dt_s` while the traction of driven wheel k is not known."""
    force_N = abs(model.traction_N(belief.mean)[k])
    growth = maximum(force_N / model.scene.robot.inertia[0], DOUBT_M_S2) * dt_s
    return growth * (growth + 2 * std(belief.cov[0, 0]))
