"""Hypotheses on which driven wheels roll, tested by wheels and gyro, and the forward speed that they agree on.

A gyro gives the turn's share in each rim's speed, so every driven wheel measures a forward speed of its own:

    v_i = r w_i - g_i w_g / (1 + k_w)

Either all roll, or the wheels of one mode slip, one wheel or those of a side, and the others give the speed. A mode is
likely if its rolling wheels agree (sigma), the slip of the others is usual (s), and its speed changes little:

    log L = -1/2 [sum_rolling (v_i - v)^2 / sigma^2 + n_rolling log sigma^2
                  + sum_slipping log (s^2 + (v_i - v)^2) + (v - v_before)^2 / q]

q is the squared mean change of all wheels, the same for all modes: a wheel that starts to slip changes its speed alone.
Modes begin and end as a Markov chain (the interacting multiple models of Blom and Bar-Shalom 1988, mixed in the
probabilities only, as the speed of each mode is measured at every step). Only disagreement between sensors is evidence:
nothing counts without a gyro or in a gap, and innovations within `EVIDENCE_S` count as one. If all wheels slip alike,
wheels and gyro cannot detect it; the speed then changes no faster than friction allows.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ohmward.trace import Scalar, clip, exp, log, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.motion.outside_speed import MET_S
from ohmward.traction.odometry.model import OdometryNoise
from ohmward.traction.robot.chassis import PLANAR, Steered
from ohmward.traction.robot.robot import GRAVITY, Robot

#: Standard deviation of the forward speeds of rolling wheels about their mean: [m/s], and over the speed.
ROLLING_M_S, ROLLING_SHARE = 0.02, 0.02

#: Standard deviation of the slip of slipping wheels: [m/s], and over the speed.
SLIPPING_M_S, SLIPPING_SHARE = 0.3, 0.3

#: Mean duration [s] of a mode of slip; each mode begins once in `MET_S` on average.
SLIP_LASTS_S = 2.0

#: Time [s] within which innovations count as one piece of evidence, and largest squared sigmas that one counts for.
EVIDENCE_S, MOST_SQUARE = 0.1, 25.0

#: Smallest share of the wheels' turn that the robot makes, and shortest step [s] over which counts give a speed and a
#: turn changes.
LEAST_SCALE, LEAST_STEP_S = 0.05, 1e-3

#: Time constant [s] of the averaged speeds that changes are measured from.
BEFORE_S = 0.3

#: Number of the turn's variances beyond which wheels differ by more than it explains.
UNEXPLAINED = 9.0

#: Smallest change [m/s] of the speed that counts.
LEAST_CHANGE_M_S = 1e-4

#: Largest change of a robot's speed [m/s2]: the friction of rubber is 1, and no wheel on the ground exceeds it.
MOST_M_S2 = GRAVITY

#: Sigmas of the rolling wheels' speed by which rims may exceed the change that friction allows.
LOOSE_SIGMAS = 4.0


class ModeState(NamedTuple):
    """State from step to step."""

    probability: np.ndarray  #: (modes,) of all wheels rolling, then of each mode of slip
    forward_m_s: np.ndarray  #: (driven,) recent average of the forward speed as each wheel showed it
    turn_rad_s: Any = 0.0  #: yaw rate of the gyro at the wheels' last value
    followed_m_s: Any = 0.0  #: forward speed, changed no faster than friction can


class ModeSpeed(NamedTuple):
    """Forward speed from the wheels."""

    forward_m_s: Scalar  #: mean of the modes
    std_m_s: Scalar  #: of the modes about it, and of rims that change faster than friction can
    slips: np.ndarray  #: (driven,) probability that each wheel slips
    named: Any  #: the condition that one mode of slip is more likely than all others together
    loose_m_s: Scalar  #: largest slip of a wheel that still counts as rolling
    counted: Scalar  #: variance of the forward speed by quantisation, over that of one rim


class ModeEvidence(NamedTuple):
    """Speeds by the wheels if those of one mode slip."""

    slipping: tuple[int, ...]  #: wheels that slip
    rolling: list[int]  #: the others
    forward_m_s: Scalar  #: mean of the speeds of the rolling wheels
    change_m_s: Scalar  #: mean change of these speeds from their recent average
    apart: list[Scalar]  #: (driven,) squares of the distances of each wheel's speed from that mean [m2/s2]

    @property
    def rolling_apart(self) -> Scalar:
        """Sum of these squares over the rolling wheels."""
        return sum(self.apart[i] for i in self.rolling)


class Variances(NamedTuple):
    """Variances [m2/s2] of forward speeds by single wheels about their mean."""

    known: Scalar  #: by the turn and by quantisation
    rolling: Scalar  #: of rolling wheels
    slipping: Scalar  #: of slipping wheels


class Turning(NamedTuple):
    """Turn of the robot by the gyro."""

    rad_s: Scalar  #: yaw rate
    holds: Any  #: the condition that it is known
    scale: Scalar  #: k_w, by which the robot turns more than its wheels show
    scale_std: Scalar  #: of that


def by_wheels(turn_rad_s: Scalar, scale: Scalar) -> Scalar:
    """Yaw rate that wheels show where the robot turns at `turn_rad_s`; scale: k_w, by which it turns more."""
    return turn_rad_s / (1.0 + maximum(scale, LEAST_SCALE - 1.0))


def slip_modes(robot: Robot) -> list[tuple[int, ...]]:
    """Driven wheels that slip in each mode: each one, and those of a side; empty where none shows a slip by itself."""
    n = robot.driven
    if n < 2 or not each_shows_forward(robot):
        return []
    sides = [tuple(i for i in range(n) if (robot.places[i].y_m > 0.0) is left) for left in (True, False)]
    return list(dict.fromkeys([*((i,) for i in range(n)), *(side for side in sides if 0 < len(side) < n)]))


def each_shows_forward(robot: Robot) -> bool:
    """True where each driven wheel, with the turn of a gyro, shows the forward speed by itself.

    Not where wheels roll sideways too, nor where the speeds of two follow from one, and a steering angle.
    """
    axes = robot.chassis.freedoms
    rolls_sideways = PLANAR[1] in axes and bool(np.any(robot.rolling[: robot.driven, axes.index(PLANAR[1])]))
    return not (rolls_sideways or isinstance(robot.chassis, Steered))


def first_modes(robot: Robot) -> ModeState:
    """State before the first sample."""
    modes = len(slip_modes(robot))
    share = SLIP_LASTS_S / MET_S
    return ModeState(np.array([1.0 - modes * share, *[share] * modes]), np.zeros(robot.driven))


def weigh(
    before: ModeState,
    rims_m_s: np.ndarray,
    mean_m_s: Scalar,
    refused: np.ndarray,
    turning: Turning,
    fresh: Scalar,
    since_s: Scalar,
    count_m_s: Scalar,
    robot: Robot,
    noise: OdometryNoise,
) -> tuple[ModeState, ModeSpeed]:
    """State and forward speed after a step.

    rims_m_s: (driven,) speeds of the rims.
    mean_m_s: their mean forward speed; used alone without a gyro, and where not `each_shows_forward`.
    refused: (driven,) conditions that a wheel has jumped and its speed is an older one.
    fresh: the condition that the step ended with a new value of the wheels.
    since_s: time since the previous value.
    count_m_s: standard deviation of a rim's speed by quantisation.
    """
    turning = turning._replace(scale=maximum(turning.scale, LEAST_SCALE - 1.0))
    rate = by_wheels(turning.rad_s, turning.scale)
    along_m_s = np.asarray(rims_m_s - robot.rolling[: robot.driven, -1] * rate)
    modes = [evidence(slipping, along_m_s, mean_m_s, before, robot) for slipping in [(), *slip_modes(robot)]]
    by_rims = robot.motion_by_rims[-1] @ rims_m_s
    widths = variances(before, rate, by_rims, turning, since_s, count_m_s, robot, noise)
    change_variance = maximum(modes[0].change_m_s * modes[0].change_m_s + count_m_s * count_m_s, LEAST_CHANGE_M_S**2)
    logs = np.array([log_likelihood(mode, refused, widths, change_variance) for mode in modes])
    chain = mixed(before.probability, since_s)
    likely = chain * exp(minimum(since_s / EVIDENCE_S, 1.0) * (logs - reduce(maximum, logs)))
    judged = fresh & turning.holds & (since_s < SLIP_LASTS_S)
    forgets = fresh & logical_not(turning.holds)
    probability = where(judged, likely / likely.sum(), where(forgets, chain, before.probability))
    speed = speed_of(modes, probability, mean_m_s, turning.holds, before.followed_m_s, since_s, widths, robot)
    follows = 1.0 - exp(-since_s / BEFORE_S)
    most_m_s = MOST_M_S2 * since_s
    after = ModeState(
        probability=probability,
        forward_m_s=where(fresh, before.forward_m_s + (along_m_s - before.forward_m_s) * follows, before.forward_m_s),
        turn_rad_s=where(fresh, turning.rad_s, before.turn_rad_s),
        followed_m_s=before.followed_m_s + clip(speed.forward_m_s - before.followed_m_s, -most_m_s, most_m_s),
    )
    return after, speed


def evidence(
    slipping: tuple[int, ...], along_m_s: np.ndarray, mean_m_s: Scalar, before: ModeState, robot: Robot
) -> ModeEvidence:
    """Speeds by the wheels if these slip; along_m_s: (driven,) forward speed by each wheel, mean_m_s: of the rims."""
    rolling = [i for i in range(robot.driven) if i not in slipping]
    alone = each_shows_forward(robot)
    forward_m_s = along_m_s[rolling].mean() if alone else mean_m_s
    apart = [(v - forward_m_s) ** 2 for v in along_m_s]
    change_m_s = (along_m_s - before.forward_m_s)[rolling].mean()
    return ModeEvidence(slipping, rolling, forward_m_s, change_m_s, apart)


def log_likelihood(mode: ModeEvidence, refused: np.ndarray, widths: Variances, change_variance: Scalar) -> Scalar:
    """Log likelihood of a mode, up to a constant; refused: (driven,) conditions that a wheel has jumped."""
    disagreement = minimum(mode.rolling_apart / widths.rolling, MOST_SQUARE)
    changes = minimum(mode.change_m_s * mode.change_m_s / change_variance, MOST_SQUARE)
    return -0.5 * (
        disagreement
        + (len(mode.rolling) - 1) * log(widths.rolling)
        + sum(log(widths.slipping + mode.apart[i]) for i in mode.slipping)
        + changes
        + MOST_SQUARE * sum(where(refused[i], 1.0, 0.0) for i in mode.rolling)
    )


def speed_of(
    modes: list[ModeEvidence],
    probability: np.ndarray,
    mean_m_s: Scalar,
    turn_known: Scalar,
    before_m_s: Scalar,
    since_s: Scalar,
    widths: Variances,
    robot: Robot,
) -> ModeSpeed:
    """Forward speed of the modes together, each of which changes the speed before only as far as friction can."""
    loose_m_s = LOOSE_SIGMAS * sqrt(widths.rolling)
    wide_m_s = MOST_M_S2 * since_s + loose_m_s
    speeds = np.array([mode.forward_m_s for mode in modes])
    possible = clip(speeds, before_m_s - wide_m_s, before_m_s + wide_m_s)
    of_mean = clip(mean_m_s, before_m_s - wide_m_s, before_m_s + wide_m_s)
    forward = where(turn_known, probability @ possible, of_mean)
    changes = np.array([abs(mode.change_m_s) for mode in modes])
    escaped = where(np.array([v != w for v, w in zip(speeds, possible, strict=True)]), changes, 0.0)
    beyond = where(turn_known, probability @ escaped, abs(mean_m_s - of_mean))
    # Wheels that roll, but differ by more than their turn explains: one of them may have begun to slip.
    unexplained = [mode.rolling_apart / len(mode.rolling) - UNEXPLAINED * widths.known for mode in modes]
    within = [clip(square, 0.0, loose_m_s * loose_m_s) for square in unexplained]
    within = within if each_shows_forward(robot) else [0.0 for _ in modes]
    spread = where(turn_known, probability @ ((possible - forward) ** 2 + np.array(within)), 0.0)
    slips = [
        sum(p for p, mode in zip(probability, modes, strict=True) if i in mode.slipping) for i in range(robot.driven)
    ]
    return ModeSpeed(
        forward_m_s=forward,
        std_m_s=sqrt(spread + beyond * beyond),
        slips=np.array(slips),
        named=reduce(maximum, probability[1:]) > 0.5 if len(modes) > 1 else False,
        loose_m_s=loose_m_s,
        counted=probability @ np.array([1.0 / len(mode.rolling) for mode in modes]),
    )


def mixed(probability: np.ndarray, time_s: Scalar) -> np.ndarray:
    """Probabilities (modes,) after a time in which modes begin and end: between slips the wheels roll."""
    time_s = minimum(time_s, SLIP_LASTS_S)
    ends, begins = 1.0 - exp(-time_s / SLIP_LASTS_S), 1.0 - exp(-time_s / MET_S)
    slips = probability[1:] * (1.0 - ends) + probability[0] * begins
    return np.array([1.0 - sum(slips), *slips])


def variances(
    before: ModeState,
    rate_rad_s: Scalar,
    by_rims_rad_s: Scalar,
    turning: Turning,
    since_s: Scalar,
    count_m_s: Scalar,
    robot: Robot,
    noise: OdometryNoise,
) -> Variances:
    """Variances of forward speeds by single wheels.

    rate_rad_s, by_rims_rad_s: yaw rate of the robot by the gyro, and by the rims: wheels that begin to turn it slip
        first.
    """
    ahead_s = math.hypot(noise.gyro_delay_std_s, noise.wheels_ahead_std_s)
    sooner = ahead_s * (turning.rad_s - before.turn_rad_s) / maximum(since_s, LEAST_STEP_S)
    # Where the robot turns by another share than it should, its wheels scrub, each in its own way.
    other = turning.scale + noise.scrub
    scrubbing = (other * other + turning.scale_std * turning.scale_std) / (1.0 + turning.scale) ** 2
    slip_rad_s = noise.turn_share * maximum(abs(rate_rad_s), abs(by_rims_rad_s))
    turn_variance = lever_m(robot) ** 2 * (
        slip_rad_s * slip_rad_s + scrubbing * rate_rad_s * rate_rad_s + sooner * sooner
    )
    along = abs(before.followed_m_s)
    known = 2.0 * count_m_s * count_m_s + turn_variance
    rolling = known + ROLLING_M_S**2 + (ROLLING_SHARE * along) ** 2
    slipping = rolling + SLIPPING_M_S**2 + (SLIPPING_SHARE * along) ** 2
    return Variances(known, rolling, slipping)


def lever_m(robot: Robot) -> float:
    """Speed of the driven rims in a turn per yaw rate, root mean square."""
    return float(np.sqrt(np.mean(robot.rolling[: robot.driven, -1] ** 2)))
