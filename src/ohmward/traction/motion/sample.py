"""One sample of the sensors of a robot, live or from a log, for speed observer, odometry and learnt floors; sanitised.

A value that no sensor can give counts as missing, see `ohmward.filters.sanitize`. A sensor with a rate of its own
leaves samples without a value: its last value holds for its usual interval, which is learnt as values arrive; after
that it is missing. The interval follows the gaps between values, quickly up to the longest of them and slowly down, so
that jitter makes no value missing; one gap in which the sensor failed lengthens it by a quarter at most.

An encoder that repeats a number other than zero to the last bit while another one moves has stopped. One that repeats
zero may be that of a standing wheel, unless it fell to zero faster than a robot can brake, the gyro turns the robot
the other way than the wheels that move, or these and the gyro give a wheel with rollers another speed.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ohmward.errors import InputError
from ohmward.filters.estimator import PerWheel, number, numbers
from ohmward.filters.sanitize import between, every, sanitize_step, some, within
from ohmward.logs.drive_log import DriveLog
from ohmward.quantities import FASTEST_M_S, MOST_MOTOR_A, MOST_WHEEL_RAD_S, limits_of
from ohmward.trace import Scalar, clip, exp, isfinite, logical_not, maximum, minimum, where
from ohmward.traction.robot.chassis import Steered
from ohmward.traction.robot.robot import Robot

S = TypeVar("S", bound=tuple[Any, ...])


class RobotSample(NamedTuple):
    """One sample of the sensors; nan where there is nothing new.

    >>> ow.RobotSample(0.02, wheel_speed_rad_s=np.array([2.0, 2.1]), current_A=np.array([1.5, 1.4])).dt_s
    0.02
    """

    dt_s: Any  #: time since the previous sample [s]; 0 for the first
    wheel_speed_rad_s: np.ndarray  #: (wheels,) from encoders, driven wheels first; nan for a wheel without one
    current_A: np.ndarray  #: (driven,) of the motors over the step that ends now, > 0 drives forward
    yaw_rate_rad_s: Any = math.nan  #: from a gyro, the mean over the step, > 0 to the left
    acceleration_m_s2: Any = math.nan  #: from an accelerometer along x, gravity included: at rest g sin(pitch)
    pitch_rad: Any = math.nan  #: from an attitude filter, > 0 with the nose up
    speed_m_s: Any = math.nan  #: forward, from GNSS, visual or lidar odometry, optical flow
    speed_std_m_s: Any = math.nan  #: standard deviation of that speed, if the source gives one
    speed_age_s: Any = 0.0  #: age of that speed


def no_sample(robot: Robot) -> RobotSample:
    """A sample without any measurement, to be filled with `_replace`."""
    return RobotSample(0.0, np.full(len(robot.places), math.nan), np.full(robot.driven, math.nan))


def samples_of(log: DriveLog, robot: Robot, before_s: float = math.nan) -> RobotSample:
    """The log as samples (T, ...), its first step counted from `before_s` if that is earlier.

    Raises:
        InputError: the log has other wheels or motors than the robot.
    """
    require_wheels(robot, log)
    start_s = log.time_s[0] if not before_s < log.time_s[0] else before_s
    nothing = np.full(len(log), math.nan)
    body = {name: nothing if (values := getattr(log, name)) is None else values for name in RobotSample._fields[3:]}
    return RobotSample(np.diff(log.time_s, prepend=start_s), log.wheel_speed_rad_s, log.motor_current_A, **body)


def wheel_values(robot: Robot, wheel_speed_rad_s: PerWheel | None, steering_rad: float | None) -> np.ndarray:
    """Speeds (wheels,) of a live sample; those of a steered robot from the measured one and the steering angle.

    wheel_speed_rad_s: (wheels,) or (driven,), driven wheels first; (1,) of a steered robot without encoders at both
        rear wheels.

    Raises:
        InputError: a value is not a number, there is not one for each wheel, or no wheel of the robot steers.
    """
    wheels, chassis = len(robot.places), robot.chassis
    if isinstance(chassis, Steered):
        speeds = numbers("wheel_speed_rad_s", wheel_speed_rad_s, wheels, robot.driven, 1)
        return chassis.wheel_speeds(speeds, np.asarray(number("steering_rad", steering_rad)))
    if steering_rad is not None:
        raise InputError(
            f"no wheel of robot {robot.name!r} steers; leave steering_rad out, or use a robot file of kind steered "
            "(ohmward robot --layout car or tricycle)"
        )
    return numbers("wheel_speed_rad_s", wheel_speed_rad_s, wheels, robot.driven)


def require_wheels(robot: Robot, log: DriveLog) -> None:
    """Raise InputError where a log has other wheels or motors than a robot."""
    found = log.wheel_speed_rad_s.shape[1], log.motor_current_A.shape[1]
    if found != (len(robot.places), robot.driven):
        raise InputError(
            f"log {log.name!r} has {found[0]} wheels and {found[1]} motors, robot {robot.name!r} has "
            f"{len(robot.places)} and {robot.driven}; read the log for this robot"
        )


def first_of(samples: S) -> S:
    """The first of samples (T, ...), without a step before it."""
    first: Any = type(samples)(*(first_of(v) if isinstance(v, tuple) else v[0] for v in samples))
    return first._replace(dt_s=0.0) if isinstance(samples, RobotSample) else first


#: Prevents a division by zero for a step without length, a standing robot or no samples.
LEAST_DIVISOR = 1e-9


#: Least length [s] of an entry of a history: fast samples share one, so that twenty reach back for a second.
ENTRY_S = 0.05


class History(NamedTuple):
    """The last steps, newest first, in entries (steps,) of one or more."""

    dt_s: np.ndarray  #: length of each
    change_m_s: np.ndarray  #: predicted change of the speed in each


def empty_history(steps: int) -> History:
    """History of a filter that starts."""
    return History(np.zeros(steps), np.zeros(steps))


def remember(history: History, dt_s: Scalar, change_m_s: Scalar) -> History:
    """The history with one more step: part of the newest entry while that is shorter than `ENTRY_S`, else a new one."""
    if len(history.dt_s) == 0:
        return history
    joins = history.dt_s[0] < ENTRY_S

    def recorded(before: np.ndarray, new: Scalar) -> np.ndarray:
        joined, added = np.array([before[0] + new, *before[1:]]), np.array([new, *before[:-1]])
        return np.asarray(where(joins, joined, added))

    return History(recorded(history.dt_s, dt_s), recorded(history.change_m_s, change_m_s))


def change_since(history: History, age_s: Scalar) -> Scalar:
    """Predicted change [m/s] of the speed in the last `age_s`."""
    return sum_since(history.dt_s, history.change_m_s, age_s)[0]


def sum_since(dt_s: np.ndarray, changes: np.ndarray, age_s: Scalar) -> tuple[Any, Scalar]:
    """Sum of the changes in the last `age_s`, its oldest step in part, and the time [s] that they cover.

    dt_s: (steps,) length of each, newest first.  changes: (steps, ...).
    """
    total: Any = 0.0
    known_s: Scalar = 0.0
    left_s: Scalar = maximum(age_s, 0.0)
    for step_s, change in zip(dt_s, changes, strict=True):
        share = clip(left_s / maximum(step_s, LEAST_DIVISOR), 0.0, 1.0)
        total = total + change * share
        known_s = known_s + step_s * share
        left_s = left_s - step_s
    return total, known_s


#: Age [s] of a channel that has never had a value.
NEVER_S = 1e9

#: Largest factors by which one gap between two values shortens and lengthens the usual interval.
SHORTER, LONGER = 0.99, 1.25

#: Share of the usual interval for which a value holds; below 1, so that a value that fails is missing.
HOLD_SHARE = 0.99

#: Number of values in a row that may be lost on the link from a working sensor.
LOST = 3

#: Time [s] for which the first value holds, until a second one gives the interval: sensors of 5 Hz are common.
FIRST_INTERVAL_S = 0.25


class Intervals(NamedTuple):
    """Clocks of channels, each (channels,)."""

    age_s: np.ndarray  #: time since the last value, very long before the first
    usual_s: np.ndarray  #: usual time between two values; 0 before the second


def never(channels: int) -> Intervals:
    """Clocks of channels that have not had a value."""
    return Intervals(np.full(channels, NEVER_S), np.zeros(channels))


def advance(before: Intervals, measured: np.ndarray, dt_s: Scalar) -> Intervals:
    """The clocks after a step; measured: (channels,) conditions that there is a value at its end."""
    gap_s = before.age_s + dt_s
    followed = clip(gap_s, SHORTER * before.usual_s, LONGER * before.usual_s)
    learnt = where(np.array([usual > 0.0 for usual in before.usual_s]), followed, gap_s)
    return Intervals(
        age_s=where(measured, 0.0, gap_s),
        usual_s=where(measured & was_seen(before), learnt, before.usual_s),
    )


def was_seen(intervals: Intervals) -> np.ndarray:
    """Conditions (channels,) that there has been a value."""
    return np.array([age < NEVER_S for age in intervals.age_s])


def holds(intervals: Intervals) -> np.ndarray:
    """Conditions (channels,) that the last value still holds."""
    usual_s = where(np.array([usual > 0.0 for usual in intervals.usual_s]), intervals.usual_s, FIRST_INTERVAL_S)
    return np.array([age < HOLD_SHARE * usual for age, usual in zip(intervals.age_s, usual_s, strict=True)])


def share_measured(before: Intervals, after: Intervals, dt_s: Scalar) -> np.ndarray:
    """Share (channels,) of the time since the last value that a mean covers; 0 before the second value.

    All of it if up to LOST values were lost in between, as counts run on; otherwise the usual interval.

    before, after: clocks before and after the step.
    """
    gap_s = before.age_s + dt_s
    lost = np.array([gap <= (LOST + 1) * usual for gap, usual in zip(gap_s, after.usual_s, strict=True)])
    return where(lost, 1.0, after.usual_s / maximum(gap_s, LEAST_DIVISOR))


#: Longest step [s]: a longer one is a clock that was set, not a robot that waited.
LONGEST_STEP_S = 3600.0

#: A faster turn [rad/s] or a steeper pitch [rad] is a sensor's fault.
MOST_YAW_RAD_S = limits_of("yaw_rate_rad_s").highest
STEEPEST_RAD = limits_of("pitch_rad").highest

#: An older speed [s] is not used, nor is one with a larger standard deviation [m/s]; a smaller one counts as not given.
OLDEST_S = 60.0
SPEED_STD_M_S = (1e-4, 10.0)

#: Time constant with which a motor current that is not measured fades.
CURRENT_FADES_S = 0.5


class StoppedLimits(NamedTuple):
    """Limits from which an encoder or gyro that repeats a number has stopped: live, in logs and on board."""

    contradicts_s: float = 1.0  #: time [s] for which others must contradict it
    values: int = 20  #: fewest values, of a gyro, in a log and on board
    repeats_s: float = 2.0  #: time [s] for which another encoder must move, live: a coarse one repeats numbers too
    gyro_at_zero_s: float = 10.0  #: time [s] of contradiction of a gyro at 0, which may have no noise where wheels slip
    #: least yaw rate [rad/s] by which wheels turn the robot otherwise than a gyro that has stopped, and of a gyro and
    #: of wheels that turn it against each other
    turns_rad_s: float = 0.05
    moves_rad_s: float = 0.2  #: speed [rad/s] from which another wheel moves, in a log
    #: speed [rad/s] by which an encoder must differ from what all others give, which on board agree within that
    differs_rad_s: float = 1.0


STOPPED = StoppedLimits()

#: Largest fall of the speed of a rim that grips, at once [m/s] and by braking [m/s2].
FALLS_M_S, BRAKES_M_S2 = 0.05, 5.0


class SensorStds(NamedTuple):
    """Standard deviations of sensors in a sample, given or matched."""

    encoder_rad_s: np.ndarray  #: (encoders,), driven wheels first, then passive ones where their encoders are used
    torque_Nm: np.ndarray  #: (driven,) of the torque by each motor's current
    gyro_rad_s: np.ndarray  #: (1,), or empty without a gyro


class CleanSample(NamedTuple):
    """Credible values of a sample."""

    dt_s: Scalar  #: step [s], >= 0
    modelled_s: Scalar  #: part of the step that a model describes; 0 while the robot stands
    unmodelled_s: Scalar  #: the rest, in which the speed may change by any amount; 0 while the robot stands
    current_A: np.ndarray  #: (driven,) over the step, 0 or held where it is not measured
    current_measured: np.ndarray  #: (driven,) conditions, true too where the last one still holds
    wheel_speed_rad_s: np.ndarray  #: (wheels,), 0 where it is not measured
    wheel_measured: np.ndarray  #: (wheels,) conditions
    time_credible: Scalar  #: the condition that the step is possible for a clock
    gap: Scalar  #: the condition that the step is longer than the last current holds
    #: of the body, nan where it is not measured
    yaw_rate_rad_s: Scalar = math.nan
    acceleration_m_s2: Scalar = math.nan
    pitch_rad: Scalar = math.nan
    speed_m_s: Scalar = math.nan
    speed_std_m_s: Scalar = math.nan
    speed_age_s: Scalar = 0.0  #: >= 0
    speed_refused: Scalar = False  #: the condition that a speed of the body was given that no robot can have now
    current_refused: Scalar = False  #: the condition that a current was measured that no wheel can have taken
    lag_share: Any = 1.0  #: (wheels,) share of the time since each encoder's last value over which its speed is a mean
    wheel_known: Any = False  #: (wheels,) conditions, true too where an encoder is only slower than the samples
    interval_s: Any = 0.0  #: (wheels,) usual time between two values of each encoder; 0 before the second
    rest_s: Scalar = 0.0  #: time for which wheels and motors have been at rest
    resting: Scalar = False  #: the condition that this has lasted long enough for a standstill
    stds: SensorStds | None = None  #: matched standard deviations of the sensors; None for the given ones


class EncoderWatch(NamedTuple):
    """What shows that an encoder has stopped, each (wheels,)."""

    last_rad_s: np.ndarray  #: last speed
    #: time for which it has repeated one other than zero while another encoder moved, or since then contradicted it
    repeated_s: np.ndarray
    fell: np.ndarray  #: 1 where it fell to zero faster than a robot can brake, and has repeated it since
    contradicts_s: np.ndarray  #: time for which it has repeated zero and contradicted the other wheels or the gyro
    silent_s: np.ndarray  #: time since its last value, or since it stopped

    @property
    def stopped(self) -> np.ndarray:
        """Conditions (wheels,) that an encoder has stopped."""
        times = zip(self.repeated_s, self.contradicts_s, strict=True)
        return np.array([(again_s > STOPPED.repeats_s) | (zero_s > STOPPED.contradicts_s) for again_s, zero_s in times])


def watch_encoders(robot: Robot) -> EncoderWatch:
    """The watch before the first sample."""
    nothing = np.zeros(len(robot.places))
    return EncoderWatch(nothing, nothing, nothing, nothing, nothing)


def is_usable(std: Scalar, limits: tuple[float, float]) -> Any:
    """False for a value whose source gives a standard deviation above the limits; nan is one that is not given."""
    return logical_not(std > limits[1])


def sanitize(sample: RobotSample, gap_s: float) -> CleanSample:
    """The sample without values that no sensor or clock can give; a step longer than `gap_s` is a gap."""
    time = sanitize_step(sample.dt_s, LONGEST_STEP_S, gap_s)
    measured_A = np.array([within(current, MOST_MOTOR_A) for current in sample.current_A])
    measured = np.array([within(speed, MOST_WHEEL_RAD_S) for speed in sample.wheel_speed_rad_s])
    modelled_s = minimum(time.dt_s, gap_s)
    usable = is_usable(sample.speed_std_m_s, SPEED_STD_M_S) & logical_not(sample.speed_age_s > OLDEST_S)
    credible = within(sample.speed_m_s, FASTEST_M_S) & usable
    return CleanSample(
        dt_s=time.dt_s,
        modelled_s=modelled_s,
        unmodelled_s=time.dt_s - modelled_s,
        current_A=where(measured_A, sample.current_A, 0.0),
        current_measured=measured_A,
        wheel_speed_rad_s=where(measured, sample.wheel_speed_rad_s, 0.0),
        wheel_measured=measured,
        time_credible=time.credible,
        gap=time.gap,
        yaw_rate_rad_s=where(within(sample.yaw_rate_rad_s, MOST_YAW_RAD_S), sample.yaw_rate_rad_s, math.nan),
        acceleration_m_s2=sample.acceleration_m_s2,
        pitch_rad=where(within(sample.pitch_rad, STEEPEST_RAD), sample.pitch_rad, math.nan),
        speed_m_s=where(credible, sample.speed_m_s, math.nan),
        speed_std_m_s=where(between(sample.speed_std_m_s, *SPEED_STD_M_S), sample.speed_std_m_s, math.nan),
        speed_age_s=where(between(sample.speed_age_s, 0.0, OLDEST_S), sample.speed_age_s, 0.0),
        speed_refused=isfinite(sample.speed_m_s) & logical_not(credible),
    )


def hold_currents(clean: CleanSample, last_A: np.ndarray, intervals: Intervals) -> CleanSample:
    """The sample with the last currents (driven,) where none is measured.

    Over the usual interval of its sensor the last one counts as measured; then it is missing, and fades.

    intervals: of the currents, this step included.
    """
    held = holds(intervals) & logical_not(clean.current_measured)
    known = clean.current_measured | held
    last = where(held, last_A, last_A * exp(-clean.dt_s / CURRENT_FADES_S))
    return clean._replace(current_A=where(clean.current_measured, clean.current_A, last), current_measured=known)


def hold_still(clean: CleanSample, rest_s: Scalar, hold_s: float) -> CleanSample:
    """The sample of a robot that stands after `hold_s` at rest: the model must not accelerate it, whatever holds it."""
    resting = rest_s > hold_s
    return clean._replace(
        modelled_s=where(resting, 0.0, clean.modelled_s),
        unmodelled_s=where(resting, 0.0, clean.unmodelled_s),
        rest_s=rest_s,
        resting=resting,
    )


def without_stopped(clean: CleanSample, before: EncoderWatch, robot: Robot) -> tuple[CleanSample, EncoderWatch]:
    """The sample without encoders that have stopped, and the watch after it."""
    wheels = list(zip(clean.wheel_measured, clean.wheel_speed_rad_s, before.last_rad_s, strict=True))
    moved = [good & (speed != last) for good, speed, last in wheels]
    repeats = [good & logical_not(speed != last) & (last != 0.0) for good, speed, last in wheels]
    stood = [last == 0.0 for last in before.last_rad_s]
    passed_s, differ = where(some(moved), clean.dt_s, 0.0), differ_from_others(clean, robot)
    repeated_s = np.array([
        where(again, t + where(differs & (t > 0.0), clean.dt_s, passed_s), where(some([moves, stands]), 0.0, t))
        for again, moves, stands, differs, t in zip(repeats, moved, stood, differ, before.repeated_s, strict=True)
    ])  # fmt: skip
    # A standing wheel of a robot on rollers shows as much as any other, so that it cannot contradict them for long.
    turns, rollers = turns_against(clean, robot), robot.chassis.rollers
    against = [some([turns, differs]) if rollers else turns for differs in differ]
    slowest_rad_s = (FALLS_M_S + BRAKES_M_S2 * clean.dt_s) / robot.wheel.radius_m
    fell = np.array([
        where(moves, where((speed == 0.0) & (abs(last) > slowest_rad_s), 1.0, 0.0), before_fell)
        for moves, (_, speed, last), before_fell in zip(moved, wheels, before.fell, strict=True)
    ])  # fmt: skip
    contradicts_s = np.array([
        where(moves | logical_not(stands), 0.0,
              t + where(contradicts, clean.dt_s, falling * where(differs, clean.dt_s, passed_s)))
        for moves, stands, falling, differs, contradicts, t in zip(
            moved, stood, fell, differ, against, before.contradicts_s, strict=True
        )
    ])  # fmt: skip
    last_rad_s = where(clean.wheel_measured, clean.wheel_speed_rad_s, before.last_rad_s)
    watch = EncoderWatch(last_rad_s, repeated_s, fell, contradicts_s, before.silent_s)
    measured = clean.wheel_measured & logical_not(watch.stopped)
    silent_s = where(measured, 0.0, before.silent_s + clean.dt_s)
    return clean._replace(wheel_measured=measured), watch._replace(silent_s=silent_s)


def differ_from_others(clean: CleanSample, robot: Robot) -> list[Scalar]:
    """Conditions (wheels,) that a driven wheel is far from what the others and a gyro give; none where wheels scrub."""
    n, known, measured = robot.driven, isfinite(clean.yaw_rate_rad_s), clean.wheel_measured
    rims_m_s = robot.wheel.radius_m * clean.wheel_speed_rad_s[:n]
    least_m_s = STOPPED.differs_rad_s * robot.wheel.radius_m
    found: list[Scalar] = [False for _ in robot.places]
    for k in range(0 if robot.chassis.scrubs else n):
        given_m_s = rim_by_others(k, rims_m_s, clean.yaw_rate_rad_s, robot)
        if given_m_s is not None:
            others = every([measured[i] for i in range(n) if i != k])
            found[k] = known & others & (abs(rims_m_s[k] - given_m_s) > least_m_s)
    return found


def rim_by_others(k: int, rims_m_s: np.ndarray, yaw_rate_rad_s: Scalar, robot: Robot) -> Scalar | None:
    """Rim speed [m/s] of a driven wheel by those of all others (driven,) and a gyro; None if these leave it open."""
    rows = np.vstack([robot.rolling[: robot.driven], np.eye(robot.freedoms)[-1]])
    others = [i for i in range(len(rows)) if i != k]
    if np.linalg.matrix_rank(rows[others]) < np.linalg.matrix_rank(rows):
        return None
    values = [*rims_m_s, yaw_rate_rad_s]
    return rows[k] @ np.linalg.pinv(rows[others]) @ np.array([values[i] for i in others])


def turns_against(clean: CleanSample, robot: Robot) -> Scalar:
    """The condition that the gyro turns the robot the other way than the wheels."""
    by_wheels = robot.motion_by_rims[-1] @ (robot.wheel.radius_m * clean.wheel_speed_rad_s[: robot.driven])
    both = minimum(abs(by_wheels), abs(clean.yaw_rate_rad_s)) > STOPPED.turns_rad_s
    return isfinite(clean.yaw_rate_rad_s) & both & (by_wheels * clean.yaw_rate_rad_s < 0.0)
