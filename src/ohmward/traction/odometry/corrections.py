"""Measurements of the odometry, each an update of its own: wheels against gyro, speeds, headings, and pose increments.

Each function takes the correction so far and returns it with one more. A measurement that is missing or outside its
gate changes no mean; a measured motion outside its gate widens the band at once, by as much as the innovation.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief, Function
from ohmward.filters.gate import choose, inflate, time_rejected, widen
from ohmward.filters.linear_algebra import TINY, mirror_lower
from ohmward.filters.sanitize import between, every, some, within
from ohmward.quantities import FASTEST_M_S
from ohmward.trace import Scalar, clip, cos, exp, isfinite, linearize, logical_not, maximum, minimum, sin, sqrt, where
from ohmward.traction.motion.outside_speed import ROLLS_SHARE, OutsideSpeed, likelihood
from ohmward.traction.motion.sample import (
    NEVER_S,
    OLDEST_S,
    SPEED_STD_M_S,
    CleanSample,
    is_usable,
    sum_since,
)
from ohmward.traction.odometry.model import (
    AHEAD,
    APART,
    DELAY,
    HEADING_ZERO,
    INCREMENT_SCALE,
    OFFSET,
    SIDE_SLIP,
    SLIP,
    SPEED_ERROR,
    SPEED_SCALE,
    TURN_SCALE,
    TURN_SLIP,
    YAW,
    MotionInput,
    OdometryNoise,
    X,
    Y,
    twist,
    vector,
    yaw_now,
)
from ohmward.traction.odometry.modes import LEAST_STEP_S
from ohmward.traction.odometry.sample import OdometrySample

#: Time [s] over which the angles of gyro and wheels are compared: quantisation enters an angle only once.
COMPARED_S = 0.5

#: Turn of the wheels [rad] beyond their quantisation, and limits of the share by which scrubbing changes it: at -1 the
#: robot does not turn at all and its wheels spin, above 0 it is an error of the track.
LEAST_TURN_RAD, SCRUBBING_SHARE = 0.01, (-0.95, 0.1)

#: Largest yaw rate [rad/s] by which wheels and gyro differ because the offset has changed: faster, wheels slip, or
#: somebody turns the robot.
MOST_DRIFT_RAD_S = 0.02

#: Number of comparisons over which the noise of the wheels' speeds is averaged, and most squared sigmas of one.
COMPARISONS, MOST_SQUARE = 20.0, 25.0

#: A robot whose wheels moved less than this [m] stood: its encoders have no quantisation error.
STOOD_M = 1e-6

#: Unnoticed turn [rad] of a standing robot, a hundredth of a count: it keeps the variance of the yaw above rounding.
STILL_TURN_RAD = 1e-5

#: Least and longest length [s] of a pose increment.
INCREMENT_S = (1e-3, 10.0)

#: A larger pose increment [m, rad] is its source's fault.
MOST_INCREMENT = 100.0

#: Share of a pose increment's length that the stored steps must cover.
REMEMBERED = 0.99

#: Limits [m, rad] of the standard deviation of a pose increment that its source gives.
INCREMENT_STD = (1e-5, 10.0)

#: Limits [rad] of the standard deviation of a heading that its source gives; a larger heading is its source's fault.
HEADING_STD, MOST_HEADING_RAD = (1e-4, 1.0), 1e4

#: Correlation times between headings that are used: their errors are then correlated by e^-3, a twentieth.
HEADING_WAIT = 3.0

#: Largest slip, in its standard deviations, to which it is widened: beyond, rounding would spoil the covariance.
MOST_OPENED = 1e4

#: Time [s] in which outside speeds, a second apart or less, reveal a slide; its distance is then taken back.
OVERRUN_S = 3.0

#: Odds q of a change of the rims that the robot does not make.
NONE_ODDS = 0.5

#: Least standard deviation [m/s, rad/s] by which a rejected measurement is divided.
LEAST_REJECTED_STD = 1e-4


class TurnDifferences(NamedTuple):
    """Differences of gyro and wheels from comparison to comparison."""

    rejected_s: Any = 0.0  #: time for which these have been outside their gate
    rejected_rad: Any = 0.0  #: sum of the innovations in that time
    last_rad: Any = 0.0  #: last innovation of wheels that turned
    #: of the wheels' turn over time, by noise of their speeds [rad2/s]; the mean of what was seen may be below 0
    wheels_variance: Any = 0.0

    @property
    def noise_variance(self) -> Scalar:
        """The variance of the wheels' turn over time [rad2/s]."""
        return maximum(self.wheels_variance, 0.0)


class TurnSums(NamedTuple):
    """Sums over the time since gyro and wheels were last compared."""

    time_s: Any = 0.0  #: time
    wheels_rad: Any = 0.0  #: turn by the wheels
    gyro_rad: Any = 0.0  #: turn by the gyro
    rim_m: Any = 0.0  #: distance covered by the rims, in any direction
    gyro_variance: Any = 0.0  #: of the gyro's angle by its noise [rad2]
    start_rad_s: Any = 0.0  #: yaw rate of the gyro at the start
    stood: Any = 0.0  #: comparisons in a row in which the wheels have not moved
    differences: TurnDifferences = TurnDifferences()  #: of all comparisons


class HeadingTimes(NamedTuple):
    """Time until the next heading is used, and time for which headings have been outside their gate [s]."""

    wait_s: Any = 0.0
    rejected_s: Any = 0.0


class Overrun(NamedTuple):
    """Distance of the pose beyond that of the outside speeds; zero if the last one is older than `OVERRUN_S`."""

    last_m_s: Any = 0.0  #: the last outside speed
    age_s: Any = NEVER_S  #: time since the last outside speed
    way_m: Any = 0.0  #: distance of the pose less that of the outside speeds, each held to the next
    slip_m_s: Any = 0.0  #: speed of the rims less the last outside speed, at the time of that


def run_over(before: Overrun, speed_m_s: Scalar, received: OutsideSpeed, slides: Scalar, dt_s: Scalar) -> Overrun:
    """The overrun after a step in which the pose moved at this speed; the part taken back for a slide is removed."""
    age_s = before.age_s + dt_s
    remaining_m = before.way_m * exp(-dt_s / OVERRUN_S) + (speed_m_s - before.last_m_s) * dt_s
    way_m = where(age_s <= OVERRUN_S, remaining_m, 0.0)
    return Overrun(
        last_m_s=where(received.measured, received.speed_m_s, before.last_m_s),
        age_s=where(received.measured, 0.0, age_s),
        way_m=where(received.measured, way_m * (1.0 - slides), way_m),
        slip_m_s=where(received.measured, received.rims_m_s - received.speed_m_s, before.slip_m_s),
    )


class Unconfirmed(NamedTuple):
    """Change of the rims' speed that no outside speed has confirmed: all wheels may slip by as much since it began."""

    low_m_s: Any = 0.0  #: least forward speed of the rims since outside speeds have confirmed it
    high_m_s: Any = 0.0  #: greatest forward speed of the rims since then
    change_m_s: Any = 0.0  #: of the rims from the farther one; 0 where no outside speed has come for seconds
    way_m: Any = 0.0  #: sum of that change over time, forgotten in seconds

    @property
    def speed_variance(self) -> Any:
        """Variance [m2/s2] of the speed about the rims': the robot makes all of the change or none, equally likely."""
        return self.change_m_s**2 / 2.0

    @property
    def way_variance(self) -> Any:
        """Variance [m2] of the distance, likewise."""
        return self.way_m**2 / 2.0


def confirm(before: Unconfirmed, rims_m_s: Scalar, received: OutsideSpeed, last: Overrun, dt_s: Scalar) -> Unconfirmed:
    """The change of the rims after a step: an outside speed y confirms as much of it as it is likelier than none.

    share = (p(y | rims) - q p(y | farther)) / (p(y | rims) + q p(y | farther)), at least 0

    rims_m_s: their forward speed. An outside speed cannot confirm its change in the age of that.
    last: the overrun before the step, with the age of the last outside speed.
    """
    then_m_s = rims_m_s - received.since_m_s
    by_rims, by_none = (
        likelihood(received.speed_m_s - v, received.std_m_s**2 + (ROLLS_SHARE * v) ** 2)
        for v in (then_m_s, farther(before.low_m_s, before.high_m_s, then_m_s))
    )
    likelier = (by_rims - NONE_ODDS * by_none) / (by_rims + NONE_ODDS * by_none)
    heard = last.age_s + dt_s <= OVERRUN_S
    share = where(heard, where(received.measured, maximum(likelier, 0.0), 0.0), 1.0)
    low_m_s = minimum(before.low_m_s + share * (then_m_s - before.low_m_s), rims_m_s)
    high_m_s = maximum(before.high_m_s + share * (then_m_s - before.high_m_s), rims_m_s)
    change_m_s = rims_m_s - farther(low_m_s, high_m_s, rims_m_s)
    way_m = before.way_m * exp(-dt_s / OVERRUN_S) + change_m_s * dt_s
    return Unconfirmed(low_m_s, high_m_s, change_m_s, (1.0 - share) * way_m)


def farther(low: Scalar, high: Scalar, value: Scalar) -> Scalar:
    """The one of two that is farther from the value."""
    return where(value - low > high - value, low, high)


class PoseCorrection(NamedTuple):
    """Belief after measurements, and conditions on them."""

    belief: Belief  #: after them
    sums: TurnSums  #: angles of gyro and wheels since they were last compared
    heading: HeadingTimes  #: times of headings
    turn_apart_rad_s: Any = 0.0  #: yaw rate by which gyro and wheels differ
    #: see `OdometryFlag`
    turn_rejected: Any = False
    speed_rejected: Any = False
    heading_rejected: Any = False
    increment_rejected: Any = False
    increment_too_old: Any = False


def add_turn(sums: TurnSums, u: MotionInput, rim_m: Scalar) -> TurnSums:
    """The sums with one more step; reset if gyro and wheels are not comparable in it.

    rim_m: distance covered by the rims in it, in any direction.
    """
    added = sums._replace(
        time_s=sums.time_s + u.dt_s,
        wheels_rad=sums.wheels_rad + u.way[2],
        gyro_rad=sums.gyro_rad + u.gyro_rad_s * u.dt_s,
        rim_m=sums.rim_m + rim_m,
        gyro_variance=sums.gyro_variance + u.gyro_variance * u.dt_s,
        start_rad_s=where(sums.time_s > 0.0, sums.start_rad_s, u.gyro_rad_s),
    )
    return choose(u.comparable, added, TurnSums(differences=sums.differences))


def use_turn(body: PoseCorrection, u: MotionInput, fresh: Scalar, gate: float, reset_after_s: float) -> PoseCorrection:
    """Correct with the angles that wheels and gyro have turned, once a comparison is due; new sums then.

    Wheels that turned:   0 = d - (t_g + t_w) w + e,                            e a part of a count
    wheels that stood:    0 = (t_g + t_w) (w - w_0) - (theta_g - b T) + e

    The noise of the gyro over the time T at rest is in the yaw and in d too, Cov(yaw, e) = -N^2 T = -Cov(d, e), so that
    the wheels remove from both the turn of a bad gyro. That of its samples is in w and w_0, with the variance N^2 / dt
    each. A robot whose counts stay may still turn by a part of one; in the n-th comparison at rest by 1 / n of it, as
    it has turned by less in all those before, and w = w_0 from the second on.

    If a standing robot has turned by its gyro for longer than `reset_after_s`, the offset has changed, and so it has if
    the gyro differs by less than `MOST_DRIFT_RAD_S`, at once from standing wheels and after that time from others. If
    wheels and gyro disagree, d is unknown.

    fresh: the condition that the step ended with a value of the wheels.
    """
    sums = body.sums
    due = fresh & (sums.time_s >= COMPARED_S)
    stood = sums.rim_m <= STOOD_M
    rests = where(stood, sums.stood + 1.0, 0.0)
    counted = u.count_rad * u.count_rad / maximum(rests * rests, 1.0)
    by_noise = where(stood, sums.gyro_variance, 0.0)
    behind = where(rests > 1.0, 0.0, 1.0)
    behind_s = behind * (body.belief.mean[DELAY] + body.belief.mean[AHEAD])
    of_rates = where(stood, 2.0, 1.0) * u.gyro_variance / maximum(u.dt_s, LEAST_STEP_S)
    variance = counted + by_noise + behind_s * behind_s * of_rates + STILL_TURN_RAD**2
    shared = vector({YAW: -by_noise, APART: by_noise})

    def difference(x: np.ndarray) -> np.ndarray:
        late_s = x[DELAY] + x[AHEAD]
        moving = x[APART] - late_s * (u.gyro_rad_s - x[OFFSET])
        turned = behind * (u.gyro_rad_s - sums.start_rad_s)
        at_rest = late_s * turned - (sums.gyro_rad - x[OFFSET] * sums.time_s)
        return np.array([where(stood, at_rest, moving)])

    y_hat, H = linearize(difference, body.belief.mean)
    nu, S = -y_hat[0], H[0] @ body.belief.cov @ H[0] + variance
    apart, time_s = sums.differences, maximum(sums.time_s, COMPARED_S)
    rate = (apart.rejected_rad + nu) / (apart.rejected_s + time_s)
    drifts = abs(rate) < MOST_DRIFT_RAD_S
    after_s = where(stood, where(drifts, 0.0, reset_after_s), where(drifts, reset_after_s, np.inf))
    diverged = due & (apart.rejected_s > after_s)
    apart_s = apart.rejected_s + time_s
    prior = choose(diverged, with_other_offset(body.belief, rate, apart_s, time_s), body.belief)
    belief, accepted = correct_scalar(prior, where(due, 0.0, np.nan), difference, variance, gate, shared)
    rejected = due & logical_not(accepted)
    belief = choose(rejected, forget(scrubbing(belief, sums), APART, u.count_rad * u.count_rad), belief)
    # An offset that changes faster than gyros drift: somebody may have turned the robot instead.
    belief = inflate(belief, YAW, where(diverged & logical_not(drifts), (rate * apart_s) ** 2, 0.0))
    apart = choose(due, compared(apart, nu, S, time_s, stood, rejected), apart)
    sums = choose(due, TurnSums(stood=rests, differences=apart), sums)
    return body._replace(belief=belief, sums=sums, turn_apart_rad_s=abs(nu) / time_s, turn_rejected=rejected)


def compared(
    before: TurnDifferences, nu: Scalar, S: Scalar, time_s: Scalar, stood: Scalar, rejected: Scalar
) -> TurnDifferences:
    """The differences after a comparison over this time with the innovation nu of expected variance S.

    (nu_1 - nu_0)^2 / 2 is the variance of white noise alone, since a difference that lasts is in both: what it exceeds
    the variance of all else by is that of noisy speeds. Errors of counts do not add up, but those of speeds do.
    """
    others = S - before.noise_variance * time_s
    scatter = minimum((nu - before.last_rad) ** 2 / 2.0, MOST_SQUARE * S)
    learnt = before.wheels_variance + ((scatter - others) / time_s - before.wheels_variance) / COMPARISONS
    return TurnDifferences(
        rejected_s=time_rejected(before.rejected_s, time_s, rejected),
        rejected_rad=where(rejected, before.rejected_rad + nu, 0.0),
        last_rad=where(stood, before.last_rad, nu),
        wheels_variance=where(stood, before.wheels_variance, learnt),
    )


def with_other_offset(belief: Belief, rad_s: Scalar, rejected_s: Scalar, time_s: Scalar) -> Belief:
    """The belief with an offset that may have differed by this much since wheels and gyro last agreed.

    time_s: since their last comparison.
    """
    change = vector({OFFSET: rad_s, YAW: -rejected_s * rad_s, APART: time_s * rad_s})
    return Belief(belief.mean, belief.cov + np.outer(change, change))


def forget(belief: Belief, i: int, variance: Scalar, value: Scalar = 0.0) -> Belief:
    """The belief with element i reset to this value and variance."""
    keep = np.array([0.0 if k == i else 1.0 for k in range(len(belief.mean))])
    mean = np.array([value if k == i else x for k, x in enumerate(belief.mean)])
    return inflate(Belief(mean, belief.cov * np.outer(keep, keep)), i, variance)


def scrubbing(belief: Belief, sums: TurnSums) -> Belief:
    """The belief of a robot that may drag its wheels sideways, where wheels have turned farther than the gyro.

    Fixed wheels that scrub turn the robot by less than they show, theta_g = theta_w (1 + k_w) with k_w in (-1, 0): in
    simulation, a long robot with only its front wheels driven turns by a tenth of it.
    """
    gyro_rad = sums.gyro_rad - belief.mean[OFFSET] * sums.time_s
    share = gyro_rad / where(abs(sums.wheels_rad) > LEAST_TURN_RAD, sums.wheels_rad, np.inf) - 1.0
    apart = share - belief.mean[TURN_SCALE]
    return choose(between(share, *SCRUBBING_SHARE), widen(belief, TURN_SCALE, apart * apart), belief)


def use_speeds(
    body: PoseCorrection,
    sample: OdometrySample,
    clean: CleanSample,
    u: MotionInput,
    outside: OutsideSpeed,
    slides: Scalar,
    overrun_m: Scalar,
    noise: OdometryNoise,
    gate: float,
) -> PoseCorrection:
    """Correct with external speeds forward and to the left, the first with its change since then.

    outside: the first.
    slides: probability that the robot slides, so that its wheels do not show its speed.
    overrun_m: distance by which the pose is ahead of the outside speeds, see `Overrun`.
    """
    age_s = clean.speed_age_s
    own_std = sample.speed_left_std_m_s
    usable = is_usable(own_std, SPEED_STD_M_S) & logical_not(sample.robot.speed_age_s > OLDEST_S)
    left_m_s = where(within(sample.speed_left_m_s, FASTEST_M_S) & usable, sample.speed_left_m_s, np.nan)
    left_std_m_s = where(between(own_std, *SPEED_STD_M_S), own_std, noise.speed_std_m_s)
    y = clean.speed_m_s + outside.late_m_s
    since = [u.motion_std[axis] ** 2 * forgotten(age_s, noise) for axis in (0, 1)]
    variance = outside.std_m_s**2 + since[0]
    y_slides = clean.speed_m_s
    lasting_m_s = sqrt(outside.std_m_s**2 + (noise.speed_share * outside.speed_m_s) ** 2)
    belief, rejected = use_forward_speed(body.belief, y, y_slides, variance, lasting_m_s, slides, overrun_m, u, gate)
    belief, left_rejected = use_motion(belief, left_m_s, 1, SIDE_SLIP, 1.0, left_std_m_s**2 + since[1], u, gate)
    return body._replace(belief=belief, speed_rejected=some([rejected, left_rejected]))


def use_forward_speed(
    belief: Belief,
    y: Scalar,
    y_slides: Scalar,
    variance: Scalar,
    lasting_m_s: Scalar,
    slides: Scalar,
    overrun_m: Scalar,
    u: MotionInput,
    gate: float,
) -> tuple[Belief, Scalar]:
    """The belief after an outside speed, and the condition that it excludes a rolling robot.

        y = v (1 + c_s) + sigma z + noise

    A mixture of two: the robot rolls, and y is used within its gate, or it slides with the probability p, its slip may
    be anything, and it has not covered the distance by which its pose is ahead of the outside speeds:

        x = (1 - p) x_r + p x_s,   P = (1 - p) P_r + p P_s + p (1 - p) (x_s - x_r) (x_s - x_r)'

    y_slides: y without the change of the rims since then, which a sliding robot does not make.
    lasting_m_s: standard deviation sigma of its errors that last.
    """

    def forward(x: np.ndarray) -> np.ndarray:
        return twist(x, u)[:1] * (1.0 + x[SPEED_SCALE] - u.speed_scale) + lasting_m_s * x[SPEED_ERROR]

    measured = isfinite(y)
    rolling, accepted = correct_scalar(belief, y, forward, variance, gate)
    nu = where(measured, y_slides - forward(belief.mean)[0], 0.0)
    sliding, _ = correct_scalar(opened_slip(belief, SLIP, nu, u.motion_std[0]), y_slides, forward, variance, np.inf)
    sliding = moved_back(sliding, overrun_m, u)
    p, apart = where(measured, slides, 0.0), sliding.mean - rolling.mean
    cov = rolling.cov + p * (sliding.cov - rolling.cov) + p * (1.0 - p) * np.outer(apart, apart)
    return Belief(rolling.mean + p * apart, mirror_lower(cov)), measured & logical_not(accepted)


def moved_back(belief: Belief, way_m: Scalar, u: MotionInput) -> Belief:
    """The belief moved back by this distance, which is known to within a third of it."""
    yaw = yaw_now(belief.mean, u)
    back = vector({X: way_m * cos(yaw), Y: way_m * sin(yaw)})
    return Belief(belief.mean - back, belief.cov + np.outer(back, back) / 9.0)


def use_heading(
    body: PoseCorrection,
    sample: OdometrySample,
    u: MotionInput,
    noise: OdometryNoise,
    gate: float,
    reset_after_s: float,
) -> PoseCorrection:
    """Correct with a heading, by the shorter turn; new times then.

    heading = yaw + heading_zero + noise

    A compass disturbance lasts while the robot passes its source: one heading is used per `HEADING_WAIT` correlation
    times, so that correlated errors count once. If headings have been outside the gate for longer than `reset_after_s`,
    the local field is different, as inside a building: the zero is estimated again, and the yaw stays that of gyro and
    wheels.
    """

    def heading(x: np.ndarray) -> np.ndarray:
        return np.array([yaw_now(x, u) + x[HEADING_ZERO]])

    own, times = sample.heading_std_rad, body.heading
    std_rad = where(between(own, *HEADING_STD), own, noise.heading_std_rad)
    wait_s = maximum(times.wait_s - u.dt_s, 0.0)
    usable = is_usable(own, HEADING_STD) & (wait_s <= 0.0)
    measured = within(sample.heading_rad, MOST_HEADING_RAD) & usable
    expected_rad = heading(body.belief.mean)[0]
    turned_rad = where(measured, sample.heading_rad, expected_rad) - expected_rad + math.pi
    nu = turned_rad % (2.0 * math.pi) - math.pi
    diverged = measured & (times.rejected_s > reset_after_s)
    prior = choose(diverged, inflate(body.belief, HEADING_ZERO, nu * nu), body.belief)
    belief, accepted = correct_scalar(prior, where(measured, expected_rad + nu, np.nan), heading, std_rad**2, gate)
    rejected = measured & logical_not(accepted)
    rejected_s = time_rejected(times.rejected_s, u.dt_s, rejected, measured, sparse=True)
    times = HeadingTimes(where(accepted, HEADING_WAIT * noise.correlation_s, wait_s), rejected_s)
    return body._replace(belief=belief, heading=times, heading_rejected=rejected)


def use_increment(
    body: PoseCorrection, sample: OdometrySample, u: MotionInput, trail: Trail, noise: OdometryNoise, gate: float
) -> PoseCorrection:
    """Correct with a pose increment: its difference from dead reckoning is the error of the twist, over its time.

    Its scale multiplies the way that it shows, not the turn. The errors of the twist last for `correlation_s`; their
    change since then is noise.
    """
    if len(trail.dt_s) == 0:
        return body
    long = between(sample.increment_s, *INCREMENT_S)
    length_s = where(long, sample.increment_s, 1.0)
    age_s = where(between(sample.increment_age_s, 0.0, OLDEST_S), sample.increment_age_s, 0.0)
    seen = way(trail, length_s, age_s)
    measured = every([within(value, MOST_INCREMENT) for value in sample.increment]) & long
    remembered = seen.known_s >= REMEMBERED * length_s
    used = measured & remembered & logical_not(sample.increment_age_s > OLDEST_S)
    change = forgotten(age_s + length_s / 2.0, noise)
    rejected: Any = False
    for axis, state in ((0, SLIP), (1, SIDE_SLIP), (2, TURN_SLIP)):
        own = sample.increment_std[axis]
        std = where(between(own, *INCREMENT_STD), own, noise.increment_walk[axis] * sqrt(length_s))
        variance = std**2 + (u.motion_std[axis] * length_s) ** 2 * change
        now = twist(body.belief.mean, u)[axis] * length_s
        usable = used & is_usable(own, INCREMENT_STD)
        y = where(usable, sample.increment[axis] - seen.increment[axis] + now, np.nan)
        scaled = 0.0 if state == TURN_SLIP else seen.increment[axis]
        belief, outside = use_motion(body.belief, y, axis, state, length_s, variance, u, gate, scaled)
        body, rejected = body._replace(belief=belief), some([rejected, outside])
    return body._replace(increment_rejected=rejected, increment_too_old=measured & logical_not(remembered))


def use_motion(
    belief: Belief,
    y: Scalar,
    axis: int,
    state: int,
    length_s: Scalar,
    variance: Scalar,
    u: MotionInput,
    gate: float,
    scaled: Scalar = 0.0,
) -> tuple[Belief, Scalar]:
    """The belief after y = (component of the twist) length_s + s scaled + noise, and whether it was outside its gate.

    state: slip that is widened then.
    scaled: part of y that a scale s of pose increments multiplies.
    """

    def moved(x: np.ndarray) -> np.ndarray:
        return twist(x, u)[axis : axis + 1] * length_s + x[INCREMENT_SCALE] * scaled

    nu = where(isfinite(y), y, 0.0) - moved(belief.mean)[0]
    after, accepted = correct_scalar(belief, y, moved, variance, gate)
    rejected = isfinite(y) & logical_not(accepted)
    return choose(rejected, opened_slip(belief, state, nu / length_s, u.motion_std[axis]), after), rejected


def opened_slip(belief: Belief, state: int, speed: Scalar, std: Scalar) -> Belief:
    """The belief with a slip that may be larger by this speed; std: speed of a slip of one standard deviation."""
    slip = clip(speed / maximum(abs(std), LEAST_REJECTED_STD), -MOST_OPENED, MOST_OPENED)
    return inflate(belief, state, slip * slip)


def correct_scalar(
    belief: Belief, y: Scalar, h: Function, variance: Scalar, gate: float, shared: np.ndarray | float = 0.0
) -> tuple[Belief, Scalar]:
    """The belief after y = h(x) (1,) with noise of this variance where nu^2 / S passes the gate, and that condition.

    P - C C'/S with C = P H' + M, in a third of the operations of Joseph's form. S = H C + R where H M = 0.

    shared: M (n,), covariance of the state's error and the noise, zero where h depends on the state.
    """
    y_hat, H = linearize(h, belief.mean)
    C = belief.cov @ H[0] + shared
    S = maximum(H[0] @ C + variance, TINY)
    nu = where(isfinite(y), y, y_hat[0]) - y_hat[0]
    accepted = isfinite(y) & (nu * nu <= gate * S)
    K = C * where(accepted, 1.0 / S, 0.0)
    return Belief(belief.mean + K * nu, mirror_lower(belief.cov - np.outer(K, C))), accepted


def forgotten(age_s: Scalar, noise: OdometryNoise) -> Scalar:
    """Share of the variance of a correlated error that has changed since: 1 - e^(-2 t / T)."""
    return 1.0 - exp(-2.0 * age_s / noise.correlation_s)


class Trail(NamedTuple):
    """Dead reckoning without corrections."""

    dt_s: np.ndarray  #: (steps,) length of each of the last steps, newest first
    moved: np.ndarray  #: (3, steps) change of x, y and yaw in each, in the frame of its own start
    yaw_rad: Scalar  #: at its end


class SeenWay(NamedTuple):
    """Displacement between two instants."""

    increment: np.ndarray  #: (3,) forward, left and turn, in the frame of its start
    known_s: Scalar  #: part of its time that is stored


def empty_trail(steps: int) -> Trail:
    """Trail of a filter that starts."""
    return Trail(np.zeros(steps), np.zeros((3, steps)), 0.0)


def extend(trail: Trail, twist: np.ndarray, dt_s: Scalar) -> Trail:
    """The trail with one more step of this twist (3,), the oldest forgotten."""
    if len(trail.dt_s) == 0:
        return trail
    turn = twist[2] * dt_s
    middle = trail.yaw_rad + turn / 2.0
    forward, left = twist[0] * dt_s, twist[1] * dt_s
    step = [forward * cos(middle) - left * sin(middle), forward * sin(middle) + left * cos(middle), turn]
    moved = np.array([[new, *row[:-1]] for new, row in zip(step, trail.moved, strict=True)])
    return Trail(np.array([dt_s, *trail.dt_s[:-1]]), moved, trail.yaw_rad + turn)


def way(trail: Trail, length_s: Scalar, age_s: Scalar) -> SeenWay:
    """Displacement over the `length_s` that ended `age_s` ago; steps at its ends count in part."""
    end, end_s = sum_since(trail.dt_s, trail.moved.T, age_s)
    start, start_s = sum_since(trail.dt_s, trail.moved.T, age_s + length_s)
    dx, dy, turn = start - end
    yaw = trail.yaw_rad - start[2]
    c, s = cos(yaw), sin(yaw)
    return SeenWay(np.array([c * dx + s * dy, c * dy - s * dx, turn]), start_s - end_s)
