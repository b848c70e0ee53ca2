"""Motion over a step from the wheels, the gyro or a speed observer; sensors slower than the samples are held."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.belief import Belief
from ohmward.filters.gate import choose
from ohmward.filters.linear_algebra import std
from ohmward.filters.sanitize import every, some, within
from ohmward.trace import Scalar, exp, isfinite, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.motion.outside_speed import (
    IS_HELD,
    ROCKS_M_S,
    TURNS_M_S,
    Held,
    OutsideSpeed,
    SpeedErrors,
    receive,
    weigh_held,
)
from ohmward.traction.motion.sample import (
    LOST,
    MOST_YAW_RAD_S,
    NEVER_S,
    CleanSample,
    History,
    Intervals,
    advance,
    empty_history,
    holds,
    never,
    remember,
    rim_by_others,
    was_seen,
)
from ohmward.traction.odometry.model import (
    OFFSET,
    SLIP,
    TURN_SCALE,
    USUAL_TURN_S,
    MotionInput,
    OdometryNoise,
)
from ohmward.traction.odometry.modes import (
    LEAST_STEP_S,
    ModeSpeed,
    ModeState,
    Turning,
    by_wheels,
    each_shows_forward,
    first_modes,
    weigh,
)
from ohmward.traction.odometry.sample import Observed
from ohmward.traction.robot.chassis import PLANAR, Differential, Steered
from ohmward.traction.robot.robot import Robot
from ohmward.traction.speed_observer.speed_evidence import LOST_M_S

#: Largest change of a rim's speed: by quantisation of its distance [m], or by this number of counts once their size is
#: known, in no less than the usual time, which stamps of a burst do not show, and by an acceleration of 2 g [m/s2].
JUMP_M, JUMP_COUNTS, JUMP_M_S2 = 0.004, 2.0, 20.0

#: Angles [rad] that differ by less are the same: rounding of a file.
SAME_RAD = 1e-4

#: Wheels with less grip than this show no turn.
LEAST_TURN_GRIP = 0.5

#: Share of the radius's standard deviation that undriven wheels have: that of a ruler, without creep.
FREE_SHARE = 0.7

#: Channels whose usual interval is learnt.
WHEELS, GYRO, OBSERVER, PASSIVE, OUTSIDE = range(5)


#: Largest values of an observer.
CREDIBLE = Observed(LOST_M_S, LOST_M_S, LOST_M_S, MOST_YAW_RAD_S, MOST_YAW_RAD_S, 1.0, 1.0)


#: Number of differences from which a count is known, and largest count of an encoder [rad].
FEWEST_DIFFERENCES, MOST_COUNT_RAD = 20.0, 0.5


class CountOfEncoder(NamedTuple):
    """Angle of one count, by which the steps of a wheel with a counting encoder differ."""

    least_rad: Any = MOST_COUNT_RAD  #: smallest difference of two steps in a row
    differences: Any = 0.0  #: number of differences


class MotionState(NamedTuple):
    """The last values of the sensors and their clocks."""

    wheel_speed_rad_s: np.ndarray  #: (driven,) last speed of each wheel
    wheel_age_s: np.ndarray  #: (driven,) age of that speed
    passive_rad_s: np.ndarray  #: (passive,) last speed of each wheel that is not driven
    gyro_rad_s: Any  #: yaw rate of the gyro
    modes: ModeState  #: which wheels roll
    rims: History  #: recent changes of the rims' forward speed, for outside speeds that are late
    rim_m_s: Any  #: that speed
    outside: SpeedErrors  #: rims, and errors of outside speeds
    held: Held  #: whether the robot is held while they turn
    #: (3,) displacement reckoned by the wheels since their last values [m, m, rad]
    reckoned: np.ndarray
    turned_rad: np.ndarray  #: (driven,) angles of the last steps
    encoder: CountOfEncoder  #: count, as far as the steps have shown it
    usual_turn_rad_s: Any  #: recent average of the yaw rate by the driven wheels
    dragged_s: Any  #: time for which they have stood while the gyro turned: the robot slides, or is lifted
    observed: Observed  #: of the speed observer, or of an outside speed in place of the wheels
    intervals: Intervals  #: of `WHEELS`, `GYRO`, `OBSERVER`, `PASSIVE` and `OUTSIDE`


class Sources(NamedTuple):
    """Conditions that the last values of the sensors hold, in the order of their channels, `WHEELS` to `OUTSIDE`."""

    driven: Any  #: wheels
    gyro: Any
    estimated: Any  #: by a speed observer
    free: Any  #: wheels that are not driven
    outside: Any  #: an outside speed in place of wheels

    @property
    def speed_known(self) -> Scalar:
        """The condition that wheels or a speed observer show the speed."""
        return self.driven | self.free | self.estimated

    @property
    def by_outside(self) -> Scalar:
        """The condition that nothing but an outside speed shows it."""
        return self.outside & logical_not(self.speed_known)

    @property
    def observed(self) -> Scalar:
        """The condition that the speed is observed, and not measured by wheels."""
        return self.estimated | self.by_outside

    @property
    def driven_alone(self) -> Scalar:
        """The condition that only the driven wheels can give the motion."""
        return logical_not(self.observed | self.free)

    @property
    def turn_observed(self) -> Scalar:
        """The condition that a speed observer gives the turn."""
        return self.estimated & logical_not(self.gyro)


class MeasuredMotion(NamedTuple):
    """Motion over a step, and conditions on its sensors."""

    input: MotionInput  #: of the model
    white_variance: np.ndarray  #: (3,) of the twist, by quantisation and by the gyro's noise over one step
    rims_m_s: np.ndarray  #: (driven,) speeds of the rims
    rim_forward_m_s: Scalar  #: forward speed by the wheels that roll, whether or not the robot is held
    rim_m: Scalar  #: distance covered by the driven rims in any direction, their mean
    sensors: MotionState  #: after the step
    speed: ModeSpeed  #: forward speed of the rims, and which of them slip
    is_held: Any  #: the condition that the robot is more likely held than not
    outside: OutsideSpeed  #: forward
    turns: Any  #: the condition that the wheels would move it
    by_driven: Scalar  #: the condition that the driven wheels give it, not an observer or free wheels
    #: see `OdometryFlag`
    no_wheels: Scalar
    no_gyro: Scalar
    jump: Scalar


def no_motion(robot: Robot, late_steps: int) -> MotionState:
    """State before the first sample; late_steps: steps of `MotionState.rims`."""
    driven, passive = np.zeros(robot.driven), np.zeros(len(passive_wheels(robot)))
    return MotionState(
        driven,
        driven + NEVER_S,
        passive,
        0.0,
        first_modes(robot),
        empty_history(late_steps),
        0.0,
        SpeedErrors(),
        Held(),
        np.zeros(3),
        driven,
        CountOfEncoder(),
        0.0,
        0.0,
        Observed(0.0, 0.0, 0.0, 0.0, 0.0),
        never(5),
    )


def rim_matrix(robot: Robot) -> np.ndarray:
    """B (3, driven): forward, left and turning motion of a robot from the speeds of its rims, none of which slips."""
    return planar(robot, robot.motion_by_rims)


def planar(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """A motion (freedoms, ...) of a robot as one of `PLANAR` (3, ...)."""
    B = np.zeros((3, *motion.shape[1:]))
    B[[PLANAR.index(name) for name in robot.chassis.freedoms]] = motion
    return B


def passive_wheels(robot: Robot) -> np.ndarray:
    """Indices (passive,) of the wheels that roll freely in a direction of their own; casters swivel and have none."""
    return np.arange(robot.driven, len(robot.places) if isinstance(robot.chassis, Differential) else robot.driven)


def may_scrub(robot: Robot) -> bool:
    """True where wheels drag sideways in a turn, so that the robot may turn by a tenth of what they show."""
    return robot.chassis.scrubs or len(passive_wheels(robot)) > 0


def with_silent_wheels(
    clean: CleanSample, before: MotionState, x: np.ndarray, robot: Robot
) -> tuple[CleanSample, Scalar]:
    """The sample with speeds of driven wheels that are not measured, by the others and the gyro; whether there are any.

    x: (n,) state of the odometry before the step.
    """
    n, measured = robot.driven, clean.wheel_measured[: robot.driven]
    if n < 2 or isinstance(robot.chassis, Steered):
        return clean, False
    turned = isfinite(clean.yaw_rate_rad_s)
    silent = some(measured) & logical_not(every(measured)) & (turned | holds(before.intervals)[GYRO])
    gyro_rad_s = where(turned, clean.yaw_rate_rad_s, before.gyro_rad_s)
    rate = by_wheels(gyro_rad_s - x[OFFSET], x[TURN_SCALE])
    rims_m_s = robot.wheel.radius_m * clean.wheel_speed_rad_s[:n]
    count = sum(where(measured, 1.0, 0.0))
    if each_shows_forward(robot):
        turning_m_s = robot.rolling[:n, -1] * rate
        by_others = sum(where(measured, rims_m_s - turning_m_s, 0.0)) / maximum(count, 1.0) + turning_m_s
    else:
        given = [rim_by_others(k, rims_m_s, rate, robot) for k in range(n)]
        open_ones = [measured[k] for k in range(n) if given[k] is None]
        silent = every([silent, count > n - 1.5, *open_ones])
        by_others = np.array([0.0 if rim_m_s is None else rim_m_s for rim_m_s in given])
    filled = where(measured, clean.wheel_speed_rad_s[:n], by_others / robot.wheel.radius_m)
    speeds = [*where(silent, filled, clean.wheel_speed_rad_s[:n]), *clean.wheel_speed_rad_s[n:]]
    known = [*(good | silent for good in measured), *clean.wheel_measured[n:]]
    return clean._replace(wheel_speed_rad_s=np.array(speeds), wheel_measured=np.array(known)), silent


def in_place_of_wheels(
    clean: CleanSample, before: MotionState, robot: Robot, noise: OdometryNoise
) -> tuple[CleanSample, Observed]:
    """The sample, and the motion by an outside speed where no wheel shows one any more; that speed is then used up."""
    held = holds(before.intervals)
    rolls = some([every(clean.wheel_measured[: robot.driven]), held[WHEELS], held[PASSIVE]])
    speed_m_s = where(rolls, np.nan, clean.speed_m_s)
    std_m_s = where(isfinite(clean.speed_std_m_s), clean.speed_std_m_s, noise.speed_std_m_s)
    left = clean._replace(speed_m_s=where(rolls, clean.speed_m_s, np.nan))
    return left, Observed(speed_m_s, std_m_s, left_m_s=0.0, scale=0.0)


def sense(
    before: MotionState, clean: CleanSample, silent: Scalar, new: Observed, outside: Observed, robot: Robot
) -> tuple[MotionState, Scalar]:
    """The state with the sample's values, and the condition that wheels have jumped.

    silent: the condition that wheels have the speed that others and the gyro give them.
    new: of a speed observer.
    outside: of an outside speed `in_place_of_wheels`.
    """
    speed_rad_s, dt_s = clean.wheel_speed_rad_s[: robot.driven], clean.dt_s
    passive_rad_s = clean.wheel_speed_rad_s[passive_wheels(robot)]
    measured = every(clean.wheel_measured[: robot.driven])
    turned_rad = where(measured, speed_rad_s * (before.wheel_age_s + dt_s), before.turned_rad)
    encoder = choose(measured & logical_not(silent), count_seen(before, turned_rad), before.encoder)
    usual_s = before.intervals.usual_s[WHEELS]
    jumps = jumped(speed_rad_s, before.wheel_speed_rad_s, before.wheel_age_s + dt_s, usual_s, encoder, robot)
    jump = measured & some(jumps)
    # With a gyro for the turn, the wheels that have not jumped still give the speed.
    rolled = measured & logical_not(some([jump & logical_not(holds(before.intervals)[GYRO]), every(jumps)]))
    taken = np.array([rolled & logical_not(bad) for bad in jumps])
    free = passive_rolled(before, clean, robot)
    turned = isfinite(clean.yaw_rate_rad_s)
    given = isfinite(outside.speed_m_s)
    new = choose(given, outside, new)
    credible = [within(value, limit) for value, limit in zip(new, CREDIBLE, strict=True)]
    observed = credible[0] & credible[1] & (new.speed_std_m_s >= 0.0)
    latest = [
        where(observed & good, value, last) for good, value, last in zip(credible, new, before.observed, strict=True)
    ]
    seen = np.array([rolled, turned, observed & logical_not(given), free, given])
    after = before._replace(
        wheel_speed_rad_s=where(taken, speed_rad_s, before.wheel_speed_rad_s),
        wheel_age_s=where(taken, 0.0, before.wheel_age_s + dt_s),
        passive_rad_s=where(free, passive_rad_s, before.passive_rad_s),
        gyro_rad_s=where(turned, clean.yaw_rate_rad_s, before.gyro_rad_s),
        turned_rad=turned_rad,
        encoder=encoder,
        observed=Observed(*latest),
        intervals=advance(before.intervals, seen, dt_s),
    )
    return after, jump


def count_seen(before: MotionState, turned_rad: np.ndarray) -> CountOfEncoder:
    """The count after a step in which the wheels turned by these angles (driven,)."""
    least, differences = before.encoder
    for new, old, age_s in zip(turned_rad, before.turned_rad, before.wheel_age_s, strict=True):
        apart = abs(new - old)
        differs = (apart > SAME_RAD) & (age_s < NEVER_S)
        least = where(differs, minimum(least, apart), least)
        differences = differences + where(differs, 1.0, 0.0)
    return CountOfEncoder(least, minimum(differences, FEWEST_DIFFERENCES))


def jumped(
    now: np.ndarray, last: np.ndarray, since_s: np.ndarray, usual_s: Scalar, encoder: CountOfEncoder, robot: Robot
) -> list[Scalar]:
    """Conditions (wheels,) that a rim's speed changed since its last value, so long ago, faster than any robot's.

    usual_s: usual time between two values; 0 before the second.
    """
    least_s = maximum(usual_s, LEAST_STEP_S)
    counted_m = maximum(JUMP_M, JUMP_COUNTS * robot.wheel.radius_m * count_rad(encoder))
    changes = zip(now, last, since_s, strict=True)
    return [
        abs(new - old) * robot.wheel.radius_m > counted_m / maximum(time_s, least_s) + JUMP_M_S2 * time_s
        for new, old, time_s in changes
    ]


def passive_rolled(before: MotionState, clean: CleanSample, robot: Robot) -> Scalar:
    """The condition that there are credible speeds of the wheels that are not driven."""
    passive = passive_wheels(robot)
    if len(passive) == 0:
        return False
    usual_s = before.intervals.usual_s[PASSIVE]
    since_s = np.array([before.intervals.age_s[PASSIVE] + clean.dt_s] * len(passive))
    jumps = jumped(clean.wheel_speed_rad_s[passive], before.passive_rad_s, since_s, usual_s, before.encoder, robot)
    return every(clean.wheel_measured[passive]) & logical_not(some(jumps))


def show(
    now: MotionState,
    jump: Scalar,
    clean: CleanSample,
    since_s: Scalar,
    gyro_variance: Scalar,
    before: Belief,
    robot: Robot,
    noise: OdometryNoise,
) -> MeasuredMotion:
    """Motion over the step to this sensor state: an observer's is preferred to the wheels', a gyro's to both.

    A robot that is held neither moves nor turns with its wheels.

    since_s: time since the wheels were last measured, at its end.
    gyro_variance: of the gyro's angle over time.
    before: belief of the odometry before the step.
    """
    dt_s = clean.dt_s
    sources = Sources(*holds(now.intervals))
    fresh = now.intervals.age_s[WHEELS] <= 0.0
    rims_m_s = robot.wheel.radius_m * now.wheel_speed_rad_s
    driven = rim_matrix(robot) @ rims_m_s
    counted_m = counting_m(now.encoder, robot, noise)
    x, P = before
    turning = Turning(now.gyro_rad_s - x[OFFSET], sources.gyro, x[TURN_SCALE], std(P[TURN_SCALE, TURN_SCALE]))
    refused = np.array([age_s > 0.0 for age_s in now.wheel_age_s])
    counting_m_s = math.sqrt(2.0) * counted_m / maximum(since_s, LEAST_STEP_S)
    modes, speed = weigh(now.modes, rims_m_s, driven[0], refused, turning, fresh, since_s, counting_m_s, robot, noise)
    compared, outside = compare_outside(now, modes, speed, sources.free, clean, robot, noise)
    is_held = (compared.held.probability > IS_HELD) & sources.driven_alone
    rolled = rolled_motion(now, driven, speed, is_held, sources.free, robot, noise)
    along_m_s = hypot(rolled[0], rolled[1])
    # A speed from counts is the mean since the last value, so no distance is lost where one is late or missing.
    whole = fresh & (since_s <= (LOST + 1) * now.intervals.usual_s[WHEELS])
    way = where(whole, rolled * since_s - now.reckoned, rolled * dt_s)
    stand = every([rim_m_s == 0.0 for rim_m_s in rims_m_s])
    dragged = stand & speed.named & sources.gyro & sources.driven_alone
    dragged_s = where(dragged, now.dragged_s + dt_s, 0.0)
    # Wheels slip in any turn of the robot: one that turns on while they stand drags them.
    turn_rad_s = where(sources.gyro & (abs(turning.rad_s) > abs(rolled[2])), turning.rad_s, rolled[2])
    spins = sources.observed & (now.observed.grip <= LEAST_TURN_GRIP)
    slips = some([jump, speed.named, is_held, spins])
    by_observer = np.array([sources.observed, sources.observed, sources.turn_observed])
    observed = np.array([now.observed.speed_m_s, now.observed.left_m_s, now.observed.yaw_rate_rad_s])
    straight_std_m_s = hypot(counted_m / USUAL_TURN_S, noise.wheel_difference_std * along_m_s)
    motion = where(by_observer, observed, rolled)
    u = MotionInput(
        dt_s=dt_s,
        motion=motion,
        way=where(by_observer, observed * dt_s, way),
        motion_std=motion_std(now.observed, sources, is_held, along_m_s, motion[1], turn_rad_s, robot, noise),
        scale=where(sources.observed, now.observed.scale, where(sources.free, FREE_SHARE, 1.0)),
        gyro_rad_s=now.gyro_rad_s,
        gyro_variance=gyro_variance,
        by_gyro=sources.gyro,
        comparable=sources.gyro & (sources.free | sources.driven & logical_not(slips)),
        count_rad=turn_per_slip(robot) * counted_m,
        unobserved_s=unobserved(now.intervals, sources, clean, dragged_s, robot),
        usual_turn_rad_s=now.usual_turn_rad_s,
        straight_std_rad_s=turn_per_slip(robot) * straight_std_m_s,
        turn_scale=x[TURN_SCALE],
        slip_sigmas=x[SLIP],
    )
    counted = where(sources.gyro, speed.counted, 1.0 / robot.driven)
    count_m_s = math.sqrt(2.0) * counted_m / maximum(dt_s, LEAST_STEP_S)
    usual_turn_rad_s = now.usual_turn_rad_s + (rolled[2] - now.usual_turn_rad_s) * (1.0 - exp(-dt_s / USUAL_TURN_S))
    return MeasuredMotion(
        input=u,
        white_variance=white_variance(u, sources.observed, count_m_s, counted, robot),
        rims_m_s=rims_m_s,
        rim_forward_m_s=(1.0 - noise.creep) * speed.forward_m_s,
        rim_m=sum(abs(rims_m_s)) / robot.driven * dt_s,
        sensors=compared._replace(
            modes=modes,
            reckoned=where(fresh, 0.0, now.reckoned + way),
            usual_turn_rad_s=usual_turn_rad_s,
            dragged_s=dragged_s,
        ),
        speed=speed,
        is_held=is_held,
        outside=outside._replace(late_m_s=where(is_held, 0.0, outside.late_m_s)),
        turns=abs(speed.forward_m_s) > TURNS_M_S,
        by_driven=sources.driven & sources.driven_alone,
        no_wheels=logical_not(sources.speed_known),
        no_gyro=was_seen(now.intervals)[GYRO] & logical_not(sources.gyro),
        jump=jump,
    )


def compare_outside(
    now: MotionState,
    modes: ModeState,
    speed: ModeSpeed,
    free: Any,
    clean: CleanSample,
    robot: Robot,
    noise: OdometryNoise,
) -> tuple[MotionState, OutsideSpeed]:
    """The state after the rims' forward speed was compared with outside speeds, and the outside speed of the sample.

    modes, speed: of the driven wheels, after the step.  free: the condition that undriven wheels give the speed.
    """
    was_held = now.held.probability > IS_HELD
    rim_m_s = where(free, free_motion(now, robot)[0], speed.forward_m_s)
    rims = remember(now.rims, clean.dt_s, rim_m_s - now.rim_m_s)
    # Errors beyond the standard deviation that a source gives are slides; one that gives none may just be noisy.
    given = isfinite(clean.speed_std_m_s)
    learns = logical_not(was_held | given & (now.held.slides > IS_HELD))
    errors, y = receive(now.outside, rim_m_s, clean, learns, noise.speed_std_m_s, rims)
    by_white = y._replace(std_m_s=where(given, y.white_std_m_s, y.std_m_s))
    changed_m_s = abs((modes.forward_m_s - now.modes.forward_m_s).mean())
    held = weigh_held(now.held, by_white, speed.forward_m_s, clean.dt_s, changed_m_s)
    return now._replace(rims=rims, rim_m_s=rim_m_s, outside=errors, held=held), y


def rolled_motion(
    now: MotionState,
    driven: np.ndarray,
    speed: ModeSpeed,
    is_held: Any,
    free: Any,
    robot: Robot,
    noise: OdometryNoise,
) -> np.ndarray:
    """Motion (3,) by the wheels: the undriven ones if these give it; none of a robot that is held.

    driven: (3,) motion by the rims of the driven wheels, if none of them slips.
    """
    rolled = where(free, free_motion(now, robot), where(is_held, 0.0, driven))
    forward_m_s = where(free | is_held, rolled[0], (1.0 - noise.creep) * speed.forward_m_s)
    return np.array([forward_m_s, rolled[1], rolled[2]])


def motion_std(
    observed: Observed,
    sources: Sources,
    is_held: Scalar,
    rim_m_s: Scalar,
    left_m_s: Scalar,
    yaw_rate_rad_s: Scalar,
    robot: Robot,
    noise: OdometryNoise,
) -> np.ndarray:
    """Standard deviations (3,) of the motion: an observer's if there is one, else those of slip and scrub."""
    rolls_m_s = noise.slip_share * rim_m_s
    if noise.forward_arm_std_m:
        rolls_m_s = hypot(rolls_m_s, noise.forward_arm_std_m * yaw_rate_rad_s)
    speed_std_m_s = where(is_held, ROCKS_M_S, rolls_m_s)
    speed_std_m_s = where(sources.observed, observed.speed_std_m_s, speed_std_m_s)
    by_wheels = turn_std(rim_m_s, yaw_rate_rad_s, robot, noise)
    return np.array(
        [
            speed_std_m_s,
            side_std(speed_std_m_s, rim_m_s, left_m_s, yaw_rate_rad_s, robot, noise),
            where(sources.turn_observed, observed.yaw_rate_std_rad_s, by_wheels),
        ]
    )


def free_motion(now: MotionState, robot: Robot) -> np.ndarray:
    """Motion (3,) by the undriven wheels; zeros if there are none."""
    if len(now.passive_rad_s) == 0:
        return np.zeros(3)
    by_rims = planar(robot, np.linalg.pinv(robot.rolling[passive_wheels(robot)]))
    return by_rims @ (robot.wheel.radius_m * now.passive_rad_s)


def white_variance(u: MotionInput, observed: Scalar, count_m_s: Scalar, counted: Scalar, robot: Robot) -> np.ndarray:
    """Variance (3,) of the twist by counts over the step and by the gyro's noise; an observer includes its own.

    counted: variance of the forward speed over that of one rim, where wheels do not roll sideways.
    """
    rims = np.linalg.norm(rim_matrix(robot), axis=1) ** 2 * count_m_s * count_m_s
    rims[0] = rims[0] if rim_matrix(robot)[1].any() else counted * count_m_s * count_m_s
    gyro = u.gyro_variance / maximum(u.dt_s, LEAST_STEP_S)
    return np.array([where(observed, 0.0, rims[0]), where(observed, 0.0, rims[1]), where(u.by_gyro, gyro, rims[2])])


def count_rad(count: CountOfEncoder) -> Scalar:
    """Angle of one count; 0 until it is known."""
    known = (count.differences >= FEWEST_DIFFERENCES) & (count.least_rad < MOST_COUNT_RAD)
    return where(known, count.least_rad, 0.0)


def counting_m(count: CountOfEncoder, robot: Robot, noise: OdometryNoise) -> Scalar:
    """Standard deviation [m] of a rim's distance by counting, uniform within a count; at least the noise's."""
    return robot.wheel.radius_m * maximum(count_rad(count) / math.sqrt(12.0), noise.encoder_std_rad / math.sqrt(2.0))


def turn_per_slip(robot: Robot) -> float:
    """Yaw rate from independent slip of the wheels, per standard deviation of the slip [1/m]."""
    return float(np.linalg.norm(rim_matrix(robot)[2]))


def turn_std(rim_m_s: Scalar, turn_rad_s: Scalar, robot: Robot, noise: OdometryNoise) -> Scalar:
    """Standard deviation [rad/s] of the wheels' yaw rate: from slip that differs, and from slip in turns.

    Slip in turns makes them larger or smaller to both sides: where it is the larger one, the sign is that of the turn.
    """
    apart = noise.slip_difference_share * turn_per_slip(robot) * rim_m_s
    in_turns = noise.turn_share * turn_rad_s
    return where(in_turns < -apart, -1.0, 1.0) * hypot(apart, in_turns)


def side_std(
    speed_std_m_s: Scalar, rim_m_s: Scalar, left_m_s: Scalar, turn_rad_s: Scalar, robot: Robot, noise: OdometryNoise
) -> Scalar:
    """Standard deviation [m/s] of the sideways speed: from side slip, and from driven slip if wheels roll sideways.

    Rollers lose their share to both sides, so the sign is that of the sideways speed.
    """
    side = hypot(noise.side_slip_share * rim_m_s, noise.side_arm_std_m * turn_rad_s)
    side = hypot(side, speed_std_m_s) if rim_matrix(robot)[1].any() else side
    if not noise.roller_slip_std:
        return side
    return where(left_m_s < 0.0, -1.0, 1.0) * hypot(side, noise.roller_slip_std * left_m_s)


def unobserved(
    intervals: Intervals, sources: Sources, clean: CleanSample, dragged_s: Scalar, robot: Robot
) -> np.ndarray:
    """Time (3,) [s] since each motion was last observed, at most since the start.

    Wheels that have stood for `dragged_s` while the gyro turned show no motion of the body. An outside speed shows that
    of its time, and with it the sideways one of a robot that cannot roll sideways. A sensor with missed samples gives
    the motion at both ends of the gap: half of the gap counts as unobserved.
    """
    age_s, seen = intervals.age_s[WHEELS], was_seen(intervals)[WHEELS]
    missed = [clean.gap & (usual_s > 0.0) & (clean.dt_s > (LOST + 1) * usual_s) for usual_s in intervals.usual_s]
    between_s = [where(gap, 0.5 * clean.dt_s, 0.0) for gap in missed]
    since_s = where(sources.speed_known, dragged_s, age_s - where(seen, 0.0, NEVER_S)) + between_s[WHEELS]
    forward_s = where(sources.by_outside, intervals.age_s[OUTSIDE] + between_s[OUTSIDE], since_s)
    side_s = since_s if rim_matrix(robot)[1].any() else forward_s
    return np.array([forward_s, side_s, where(sources.gyro, between_s[GYRO], since_s)])


def hypot(a: Scalar, b: Scalar) -> Scalar:
    """Root of the sum of the squares."""
    return sqrt(a * a + b * b)
