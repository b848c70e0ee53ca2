"""Encoders of the driven wheels, and wheels that move as the model excludes.

Such a wheel has met other ground, or its encoder is broken. Whatever traction the ground gives, from none to its
largest, the wheel ends the step between two speeds: that of its motor alone, and that of rolling (`possible_speeds`).
An encoder that jumps beyond both is not used for SPIKE_S: a lost or spurious count is over by then. One that jumps
between them is used at first: with the square of the innovation added to the variance of the wheel's own speed, nearly
all of the jump goes there, and none of it to the body. While the innovation stays outside its gate, sigma points learn
the friction from it; after `reset_after_s` the encoder is at fault. It is used again once it agrees.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.checks import require_positive
from ohmward.errors import InputError
from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose, inflate, time_rejected, widen
from ohmward.filters.kalman import correct_state
from ohmward.filters.linear_algebra import TINY, std
from ohmward.filters.sanitize import some
from ohmward.trace import Condition, Scalar, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.speed_observer.model import Model
from ohmward.traction.speed_observer.slip_step import SlipStep

#: Least error [m/s^2] of the acceleration by a wheel whose encoder is not used.
ENCODER_GROWTH_M_S2 = 0.1

#: A jump beyond what motor and ground can do is a spike if it lasts for less than this [s].
SPIKE_S = 0.05

#: Standard deviations of encoder, wheel and travel that the possible speeds leave room for, and the share by which the
#: torque of a motor may differ from its current and its data sheet.
POSSIBLE_SIGMAS, TORQUE_SHARE = 5.0, 0.5


class EncoderGate(NamedTuple):
    """Settings of the gate of an encoder."""

    nis: float  #: NIS beyond which its wheel has met other ground
    reset_after_s: float  #: time outside the gate after which the encoder is at fault
    jumps_informative: bool  #: friction is learnt from a jump: sigma points can, a slope at grip cannot


class FreeWheels(NamedTuple):
    """Wheels that only their motors turn, each (driven,) [rad/s]."""

    start_rad_s: np.ndarray  #: speed at the last value of the encoder
    motor_rad_s: np.ndarray  #: change since then, the sum of dt tau / J_w


class EncoderValue(NamedTuple):
    """Speed of a driven wheel by its encoder."""

    k: int  #: number of the wheel
    measured: Condition
    y: Scalar  #: speed [rad/s] at the end of the step
    R: Scalar  #: variance of the encoder
    torque_noise: Scalar  #: standard deviation of the predicted speed by the error of the torque


class RejectedFor(NamedTuple):
    """Time [s] for which an encoder, or each one (driven,), has shown what the model excludes."""

    gate_s: Any  #: outside its gate, without spikes
    impossible_s: Any  #: beyond the possible speeds of its wheel


class WheelCorrection(NamedTuple):
    """Update by one encoder."""

    belief: Belief  #: after it
    used: Scalar  #: the condition that the encoder is measured, not at fault and inside its gate
    ground_changed: Scalar  #: the condition that the wheel moved as the model excludes
    spike: Scalar  #: the condition that the encoder jumped as no wheel can, and was not used
    rejected: RejectedFor  #: how long it has been outside its gate


class EncoderCorrection(NamedTuple):
    """Update by all encoders."""

    belief: Belief  #: after it
    wheels: list[WheelCorrection]  #: each driven wheel's
    ground_changed: Scalar  #: the condition that one of them moved as the model excludes
    spike: Scalar  #: the condition that one of the encoders jumped as no wheel can
    suspect: Scalar  #: the condition that one of the encoders is at fault
    rejected: RejectedFor  #: how long each has been outside its gate, (driven,)


class PossibleSpeeds(NamedTuple):
    """Least and greatest speed [rad/s] that a wheel can have at the end of a step."""

    least: Scalar
    most: Scalar


def correct_wheels(
    free: FreeWheels,
    prior: Belief,
    lag: np.ndarray,
    step: SlipStep,
    clean: CleanSample,
    rejected: RejectedFor,
    model: Model,
    gate: EncoderGate,
) -> EncoderCorrection:
    """The prior corrected with the speeds of the driven wheels, one after the other.

    free: the wheels as their motors alone would turn them, this step included.
    lag: (wheels,) [rad/s], `Model.encoder_lag`.
    step: of the mean of the belief.
    rejected: before the step.
    """
    belief = prior
    wheels: list[WheelCorrection] = []
    torque_noise = model.torque_noise_rad_s(step, clean)
    for k in range(model.driven):
        y = clean.wheel_speed_rad_s[k] + lag[k]
        R = model.stds(clean).encoder_rad_s[k] ** 2
        encoder = EncoderValue(k, clean.wheel_measured[k], y, R, torque_noise[k])
        possible = possible_speeds(encoder, free, belief, model)
        earlier = RejectedFor(rejected.gate_s[k], rejected.impossible_s[k])
        wheels.append(correct_wheel(belief, encoder, possible, earlier, clean, model, gate))
        belief = wheels[-1].belief
    ground_changed = some(wheel.ground_changed for wheel in wheels)
    suspect = some(s > gate.reset_after_s for s in rejected.gate_s)
    spike = some(wheel.spike for wheel in wheels)
    times_s = zip(*(wheel.rejected for wheel in wheels), strict=True)
    return EncoderCorrection(belief, wheels, ground_changed, spike, suspect, RejectedFor(*map(np.array, times_s)))


def correct_wheel(
    prior: Belief,
    encoder: EncoderValue,
    possible: PossibleSpeeds,
    before: RejectedFor,
    clean: CleanSample,
    model: Model,
    gate: EncoderGate,
) -> WheelCorrection:
    """The prior corrected with the speed of a driven wheel; an encoder that is not used only widens it.

    possible: speeds that the wheel can have.
    before: time for which the encoder has been outside its gate before.
    """
    k, measured, y, R, _ = encoder
    i = model.layout.wheel(k)
    nu = y - prior.mean[i]
    S = prior.cov[i, i] + R
    rejected = nu * nu > gate.nis * S
    impossible = rejected & ((y < possible.least) | (y > possible.most))
    spike = measured & impossible & (before.impossible_s < SPIKE_S)
    diverged = before.gate_s > gate.reset_after_s
    used_now = measured & logical_not(diverged) & logical_not(spike)

    jumped = where(before.gate_s <= 0.0, nu, 0.0) if gate.jumps_informative else nu
    opened = choose(used_now & rejected, ground_unknown(prior, k, jumped, model), prior)
    posterior = correct_speed(opened, encoder, used_now, model)
    slower = clean.wheel_known[k] & logical_not(measured)
    added_variance = where(used_now, 0.0, unmeasured_variance(prior, k, slower, clean.modelled_s, model))
    return WheelCorrection(
        belief=inflate(posterior, 0, added_variance),
        used=used_now & (nu * nu <= gate.nis * S),
        ground_changed=used_now & rejected,
        spike=spike,
        rejected=RejectedFor(
            time_rejected(before.gate_s, clean.dt_s, rejected, measured & logical_not(spike)),
            time_rejected(before.impossible_s, clean.dt_s, impossible, measured),
        ),
    )


def correct_speed(belief: Belief, encoder: EncoderValue, used: Condition, model: Model) -> Belief:
    """The belief corrected with the speed of a wheel; the stiffness gets its true share of it."""
    i = model.layout.wheel(encoder.k)
    posterior = correct_state(belief, i, encoder.y, encoder.R, used)
    if not model.states.stiffness:
        return posterior
    j = model.layout.index("log_stiffness")
    return with_part_of_gain(belief, posterior, j, true_share(belief, i, j, encoder.torque_noise))


def true_share(belief: Belief, i: int, j: int, noise: Scalar) -> Scalar:
    """Share in [0, 1] of the squared regressor of state j that is signal, not noise.

    The speed of wheel i depends on the stiffness j by h = P_ij / P_jj: the slip that the currents predict, less what
    the speed of the body follows. It contains their noise, so it is a regressor with errors: its square is too large by
    their variance, and learning from it makes wheels look stiffer than they are.
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


def possible_speeds(encoder: EncoderValue, free: FreeWheels, prior: Belief, model: Model) -> PossibleSpeeds:
    """Speeds [rad/s] that a driven wheel can have at the end of a step, with room for their uncertainty.

    Without traction the motor turns the wheel alone, by dt tau/J_w in each step since its encoder's last value; with
    full traction the wheel rolls, at v/r. Every other ground, and the estimated one, ends in between.

    prior: belief at the end of the step.
    """
    robot = model.scene.robot
    k = encoder.k
    i = model.layout.wheel(k)
    motor = free.motor_rad_s[k]
    alone = free.start_rad_s[k] + motor
    G = robot.rolling[k]
    rolling = G @ prior.mean[: robot.freedoms] / robot.wheel.radius_m
    rolling_variance = G @ prior.cov[: robot.freedoms, : robot.freedoms] @ G / robot.wheel.radius_m**2
    room = POSSIBLE_SIGMAS * sqrt(maximum(prior.cov[i, i], rolling_variance) + encoder.torque_noise**2 + encoder.R)
    room = room + TORQUE_SHARE * abs(motor)
    least = minimum(minimum(alone, rolling), prior.mean[i])
    most = maximum(maximum(alone, rolling), prior.mean[i])
    return PossibleSpeeds(least - room, most + room)


def turned(free: FreeWheels, clean: CleanSample, model: Model) -> FreeWheels:
    """The free wheels at the end of a step."""
    robot = model.scene.robot
    gain = robot.motor.wheel_constant_Nm_per_A / robot.inertia[robot.freedoms :]
    return free._replace(motor_rad_s=free.motor_rad_s + clean.dt_s * gain * clean.current_A)


def released(free: FreeWheels, belief: Belief, clean: CleanSample, model: Model) -> FreeWheels:
    """The free wheels for the next step: they start from the belief where an encoder has had a value."""
    layout = model.layout
    measured, omega = clean.wheel_measured[: model.driven], belief.mean[layout.wheel(0) : layout.robot_states]
    return FreeWheels(where(measured, omega, free.start_rad_s), where(measured, 0.0, free.motor_rad_s))


def ground_unknown(belief: Belief, k: int, jump_rad_s: Scalar, model: Model) -> Belief:
    """The belief after a possible jump of driven wheel k, with its friction as uncertain as at first."""
    return friction_unknown(inflate(belief, model.layout.wheel(k), jump_rad_s * jump_rad_s), model)


def friction_unknown(belief: Belief, model: Model) -> Belief:
    """The belief with the friction as uncertain as at first, if it is a state."""
    if not model.states.friction:
        return belief
    return widen(belief, model.layout.index("log_friction"), model.noise.friction_std**2)


def unmeasured_variance(belief: Belief, k: int, slower: Condition, dt_s: Scalar, model: Model) -> Scalar:
    """Variance [m^2/s^2] that the speed gains in `dt_s` while the traction of driven wheel k is not measured.

    slower: the condition that its encoder is only slower than the samples. The next value will show the traction, so
        its error is white; a lasting one would let the speed take the jump of a wheel that slides.
    """
    force_N = abs(model.traction_N(belief.mean)[k])
    growth = maximum(force_N / model.scene.robot.inertia[0], ENCODER_GROWTH_M_S2) * dt_s
    return growth * (growth + where(slower, 0.0, 2 * std(belief.cov[0, 0])))


def wheel_speeds(counts: np.ndarray, time_s: np.ndarray, counts_per_turn: float, bits: int = 32) -> np.ndarray:
    """Mean speed (T, wheels) [rad/s] of each wheel since the previous count; nan in the first row and where dt <= 0.

    counts: (T, wheels) whole numbers, of a counter that wraps around after `bits` bits, signed or not; 62 for one that
        never does.
    time_s: (T,) of each row.

    Raises:
        InputError: counts that are not (T, wheels), or impossible settings.
    """
    counts, time_s = np.asarray(counts), np.asarray(time_s, dtype=float)
    if counts.ndim != 2 or len(counts) != len(time_s):
        raise InputError(f"counts must be (T, wheels) with T = {len(time_s)} times, got shape {counts.shape}")
    require_positive("counts_per_turn", counts_per_turn)
    if not 8 <= bits <= 62:
        raise InputError(f"bits must be between 8 and 62, got {bits}")
    speeds = np.full(counts.shape, np.nan)
    dt_s = np.diff(time_s)
    good = dt_s > 0
    turns = differences(counts, bits)[good] / counts_per_turn
    speeds[1:][good] = 2 * np.pi * turns / dt_s[good, None]
    return speeds


def differences(counts: np.ndarray, bits: int) -> np.ndarray:
    """Counts (T - 1, wheels) since the previous row, by the shorter way around the counter."""
    half = 1 << (bits - 1)
    return np.mod(np.diff(counts.astype(np.int64), axis=0) + half, 2 * half) - half
