"""Gyro against wheels: a wrong gyro, and an encoder that counts the other way.

The gyro's yaw rate over that of the wheels is 1, less where wheels scrub or slip.

A gyro is wrong if it is about -1, or beyond what any slip explains, for `WRONG_S` longer than it is right. Beyond, its
unit is wrong, and the wheels have turned the robot since both agreed. So it is about 0 on a robot that cannot scrub,
where it measures another axis; this takes longer, as wheels may spin. On one that scrubs it is about 0.1 at least, on
snow: there the mean over all turns decides. About -1, it is mirrored, or the wheels' sides
are exchanged: which of them cannot be known, and the turn since then is as uncertain as what lies between them.

An encoder, or those of a side, count the other way if the gyro contradicts the wheels for `REVERSED_S` longer than it
agrees, and agrees with them once those count the other way. Straight on, such a robot may as well spin on the spot
without turning, and without a gyro it may always do so: its way and speed are then open, from `SUSPECTED_S` or
`MOST_SPINS_RAD` on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.gate import choose
from ohmward.filters.sanitize import every, some
from ohmward.trace import Condition, Scalar, clip, isfinite, logical_not, maximum, minimum, where
from ohmward.traction.motion.sample import CleanSample
from ohmward.traction.motion.stuck_sensors import COUNTED_TURN_RAD_S, RIGHT_SHARE, is_share
from ohmward.traction.odometry.measured_motion import may_scrub
from ohmward.traction.odometry.modes import lever_m, slip_modes
from ohmward.traction.robot.robot import Robot

#: Times [s] after which a sensor may be wrong, a gyro is wrong and an encoder counts the other way, and longest time
#: that is counted for it and against it: a gyro that has turned with the wheels stays as it is mounted.
SUSPECTED_S, WRONG_S, REVERSED_S, MOST_WRONG_S = 0.5, 2.0, 3.0, 10.0

#: Yaw rate of the gyro over that of wheels that do not scrub, if one of them counts the other way.
ROLLING_SHARE = 0.7, 1.3

#: Least ratio of gyro and wheels that is another unit; a second of that counts for several, as no slip explains it.
OTHER_UNIT_RATIO, SCALED_COUNTS = 3.0, 4.0

#: Share by which a second counts in which the gyro does not show a turn of the wheels: these may spin.
UNSHOWN_COUNTS = 0.2

#: Least mean share of the turns of wheels that scrub which a gyro shows, either way, and least and most time [s] in the
#: mean. Before the first turn it is 1, as if over a second.
LEAST_TURN_SHARE, LEAST_TURN_SHARE_S, MOST_TURN_SHARE_S = 0.03, 30.0, 600.0

#: Turn [rad] on the spot, beyond that on the way, from which a robot without a gyro may drive straight on.
MOST_SPINS_RAD = 6.0 * np.pi


class TurnWatch(NamedTuple):
    """State from sample to sample."""

    reversed_s: np.ndarray  #: (modes,) time for which the wheels of a mode count the other way, less that of the rest
    wrong_s: Any = 0.0  #: time for which the gyro was wrong, less that for which it was right
    scaled_s: Any = 0.0  #: time for which it was too large, less that for which it was mirrored
    against_s: Any = 0.0  #: time since wheels and gyro last agreed for which they have contradicted each other
    encoder_s: Any = 0.0  #: the same, where an encoder that counts the other way explains it
    share: Any = 1.0  #: mean of the gyro over the wheels in turns, where these scrub
    share_s: Any = 1.0  #: time in that mean
    spins_rad: Any = 0.0  #: turn on the spot, less that of as much way, without a gyro
    #: since wheels and gyro last agreed
    apart_rad: Any = 0.0  #: turn by the wheels less that by the gyro
    most_rad: Any = 0.0  #: the largest size of that turn
    turned_rad: Any = 0.0  #: turn by the wheels
    way_m: Any = 0.0  #: distance covered by their rims, the mean
    agrees: Any = 0.0  #: 1 where they agreed in the last sample

    @property
    def wrong(self) -> Scalar:
        """The condition that the gyro is mirrored, or the wheels' sides are exchanged, or its unit or axis is wrong."""
        return (self.wrong_s > WRONG_S) | self.hidden

    @property
    def hidden(self) -> Scalar:
        """The condition that the gyro measures another axis than that about which wheels that scrub turn the robot."""
        return (abs(self.share) < LEAST_TURN_SHARE) & (self.share_s > LEAST_TURN_SHARE_S)

    @property
    def scaled(self) -> Scalar:
        """The condition that, if the gyro is wrong, its unit or axis is."""
        return (self.scaled_s > 0.0) | self.hidden

    @property
    def reversed(self) -> list[Scalar]:
        """Conditions (modes,) that the encoders of the wheels of a mode count the other way."""
        return [time_s > REVERSED_S for time_s in self.reversed_s]

    @property
    def some_reversed(self) -> Scalar:
        """The condition that one of these holds."""
        return some([False, *self.reversed])

    @property
    def spins(self) -> Scalar:
        """The condition that the robot may drive straight on although its wheels turn it on the spot."""
        return self.spins_rad > MOST_SPINS_RAD

    @property
    def way_open(self) -> Scalar:
        """The condition that the wheels may not show the way, as an encoder may count the other way."""
        return some([(self.encoder_s > SUSPECTED_S) & logical_not(self.some_reversed), self.spins])

    @property
    def turn_open(self) -> Scalar:
        """The condition that the turn is open, as the gyro may be wrong or is mirrored."""
        known = some([every([self.wrong, self.scaled]), self.some_reversed])
        return some([(self.against_s > SUSPECTED_S) & logical_not(known), self.spins])


class YawRates(NamedTuple):
    """Yaw rates of a sample by gyro and by wheels."""

    gyro_rad_s: Scalar
    measured: Condition  #: the condition that the gyro was measured
    wheels_rad_s: Scalar  #: of the wheels, corrected for encoders that are known to count the other way
    rolled: Condition  #: the condition that all driven wheels were measured
    encoders_rad_s: Scalar  #: of the wheels as their encoders count
    reversed_rad_s: list[Scalar]  #: (modes,) of the wheels if the encoders of a mode count the other way
    rims_m_s: np.ndarray  #: (driven,) speeds of the rims as their encoders count


class TurnEvidence(NamedTuple):
    """Conditions of a sample in which gyro and wheels were both measured."""

    turning: Condition  #: the gyro shows a turn
    right: Condition  #: and the wheels show the same
    encoder: Condition  #: they contradict each other, and may agree if encoders of a mode count the other way
    #: (modes,) the encoders as they count contradict a turn by the gyro, and those of a mode reversed agree with it
    explains: list[Condition]
    mirrored: Condition  #: the gyro shows the opposite turn, and no encoder explains it; likewise the two below
    scaled: Condition  #: the gyro shows far more than the wheels
    unshown: Condition  #: the gyro shows no turn of wheels that cannot scrub


def watch_of_turn(robot: Robot) -> TurnWatch:
    """The watch before the first sample."""
    return TurnWatch(np.zeros(len(slip_modes(robot))))


def watch_turn(
    before: TurnWatch, clean: CleanSample, since_s: Scalar, average_rad_s: Scalar, robot: Robot
) -> TurnWatch:
    """The watch after a sample, which comes so long after the last speeds of all wheels.

    average_rad_s: yaw rate by the wheels, averaged so that quantisation does not count.
    """
    rates = yaw_rates(before, clean, robot)
    evidence = compare(rates, robot)
    counted = count_evidence(before, evidence, since_s)
    if may_scrub(robot):
        counted = average_share(counted, rates, evidence, average_rad_s, since_s)
    after = count_turn(counted, rates, where(rates.rolled, since_s, 0.0), robot)
    agrees = evidence.right & (after.against_s <= 0.0)
    since_now = after._replace(scaled_s=0.0, apart_rad=0.0, most_rad=0.0, turned_rad=0.0, way_m=0.0, agrees=1.0)
    return choose(agrees, since_now, after._replace(agrees=0.0))


def yaw_rates(before: TurnWatch, clean: CleanSample, robot: Robot) -> YawRates:
    """Yaw rates of a sample; before: the watch after the last one."""
    to_yaw_rate = robot.motion_by_rims[-1]
    rims_m_s = robot.wheel.radius_m * clean.wheel_speed_rad_s[: robot.driven]
    encoders_rad_s = to_yaw_rate @ rims_m_s
    wheels_rad_s = encoders_rad_s
    reversed_rad_s: list[Scalar] = []
    for mode, is_reversed in zip(slip_modes(robot), before.reversed, strict=True):
        of_mode_rad_s = sum(to_yaw_rate[i] * rims_m_s[i] for i in mode)
        reversed_rad_s.append(encoders_rad_s - 2.0 * of_mode_rad_s)
        wheels_rad_s = where(is_reversed, reversed_rad_s[-1], wheels_rad_s)
    measured = isfinite(clean.yaw_rate_rad_s)
    rolled = every(clean.wheel_measured[: robot.driven])
    return YawRates(clean.yaw_rate_rad_s, measured, wheels_rad_s, rolled, encoders_rad_s, reversed_rad_s, rims_m_s)


def compare(rates: YawRates, robot: Robot) -> TurnEvidence:
    """The evidence of a sample."""
    gyro_rad_s, wheels_rad_s = rates.gyro_rad_s, rates.wheels_rad_s
    compared = rates.rolled & rates.measured
    turning = compared & (abs(gyro_rad_s) > COUNTED_TURN_RAD_S)
    wheels_alone = compared & logical_not(turning) & (abs(wheels_rad_s) > OTHER_UNIT_RATIO * COUNTED_TURN_RAD_S)

    share = RIGHT_SHARE if robot.chassis.scrubs else ROLLING_SHARE
    alike = [turning & is_share(gyro_rad_s, rate, share) for rate in rates.reversed_rad_s]
    straight = [wheels_alone & (abs(rate) < COUNTED_TURN_RAD_S) for rate in rates.reversed_rad_s]
    may_be_reversed = some([False, *alike, *straight])
    contradicted = logical_not(is_share(abs(gyro_rad_s), abs(rates.encoders_rad_s), RIGHT_SHARE))

    right = turning & is_share(gyro_rad_s, wheels_rad_s, RIGHT_SHARE)
    encoder = may_be_reversed & logical_not(right)
    too_large = (abs(wheels_rad_s) > COUNTED_TURN_RAD_S) & (abs(gyro_rad_s) > OTHER_UNIT_RATIO * abs(wheels_rad_s))
    return TurnEvidence(
        turning=turning,
        right=right,
        encoder=encoder,
        explains=[contradicted & condition for condition in alike],
        mirrored=turning & is_share(-gyro_rad_s, wheels_rad_s, RIGHT_SHARE) & logical_not(encoder),
        scaled=turning & too_large & logical_not(encoder),
        unshown=wheels_alone & logical_not(some([may_be_reversed, may_scrub(robot)])),
    )


def count_evidence(before: TurnWatch, evidence: TurnEvidence, since_s: Scalar) -> TurnWatch:
    """The watch with the times for and against a wrong gyro and encoders that count the other way."""
    scaled_s = where(evidence.unshown, UNSHOWN_COUNTS * since_s, 0.0)
    scaled_s = where(evidence.scaled, SCALED_COUNTS * since_s, scaled_s)
    scaled_s = where(evidence.mirrored, -since_s, scaled_s)
    wrong_s = where(evidence.right, -since_s, abs(scaled_s))
    # A gyro that has been right is doubted by wheels that spin only once it is wrong.
    unshown_s = where(before.wrong_s < 0.0, 0.0, since_s)
    against_s = where(evidence.unshown, unshown_s, wrong_s)
    against_s = where(evidence.encoder, since_s, against_s)
    encoder_s = where(evidence.encoder, since_s, 0.0)
    encoder_s = where(evidence.right, -since_s, encoder_s)
    reversed_s = where(np.array(evidence.explains), since_s, where(evidence.turning, -since_s, 0.0))
    return before._replace(
        reversed_s=clip(before.reversed_s + reversed_s, -REVERSED_S, 2.0 * REVERSED_S),
        wrong_s=clip(before.wrong_s + wrong_s, -MOST_WRONG_S, MOST_WRONG_S),
        scaled_s=clip(before.scaled_s + scaled_s, -MOST_WRONG_S, MOST_WRONG_S),
        against_s=clip(before.against_s + against_s, 0.0, MOST_WRONG_S),
        encoder_s=clip(before.encoder_s + encoder_s, 0.0, MOST_WRONG_S),
    )


def average_share(
    before: TurnWatch, rates: YawRates, evidence: TurnEvidence, average_rad_s: Scalar, since_s: Scalar
) -> TurnWatch:
    """The watch with the share of a turn by wheels that scrub which the gyro shows.

    Noise and offset of a gyro that shows none cancel in turns to both sides; one that shows a turn may be mirrored.
    """
    turns = rates.rolled & rates.measured & (abs(average_rad_s) > OTHER_UNIT_RATIO * COUNTED_TURN_RAD_S)
    turns = turns & logical_not(some([evidence.encoder, before.some_reversed]))
    share = where(turns, rates.gyro_rad_s, 0.0) / where(turns, average_rad_s, 1.0)
    share = where(evidence.turning, abs(share), share)
    counted_s = where(turns, since_s, 0.0)
    share_s = before.share_s + counted_s
    mean = before.share + counted_s / share_s * (share - before.share)
    return before._replace(share=mean, share_s=minimum(share_s, MOST_TURN_SHARE_S))


def count_turn(before: TurnWatch, rates: YawRates, dt_s: Scalar, robot: Robot) -> TurnWatch:
    """The watch with the turn and the way of a step in which the wheels rolled for this time."""
    wheels_rad_s = rates.wheels_rad_s
    turns_rad_s = abs(wheels_rad_s)
    along_rad_s = abs(robot.motion_by_rims[0] @ rates.rims_m_s) / lever_m(robot)
    spins_rad_s = where(turns_rad_s > along_rad_s, turns_rad_s, -along_rad_s) if rates.reversed_rad_s else 0.0
    spins_rad = clip(before.spins_rad + spins_rad_s * dt_s, 0.0, 2.0 * MOST_SPINS_RAD)
    apart_rad = before.apart_rad + where(rates.measured, wheels_rad_s - rates.gyro_rad_s, 0.0) * dt_s
    return before._replace(
        spins_rad=where(rates.measured, 0.0, spins_rad),
        apart_rad=apart_rad,
        most_rad=maximum(before.most_rad, abs(apart_rad)),
        turned_rad=before.turned_rad + wheels_rad_s * dt_s,
        way_m=before.way_m + sum(abs(rates.rims_m_s)) / robot.driven * dt_s,
    )


def without_wrong(clean: CleanSample, watch: TurnWatch, robot: Robot) -> CleanSample:
    """The sample without the yaw rate of a wrong gyro and encoders that count the other way; watch: after it."""
    measured = list(clean.wheel_measured)
    for mode, condition in zip(slip_modes(robot), watch.reversed, strict=True):
        for i in mode:
            measured[i] = measured[i] & logical_not(condition)
    yaw_rate_rad_s = where(watch.wrong, np.nan, clean.yaw_rate_rad_s)
    return clean._replace(wheel_measured=np.array(measured), yaw_rate_rad_s=yaw_rate_rad_s)
