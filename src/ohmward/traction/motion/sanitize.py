"""Sanitise a sample of a robot, see `ohmward.filters.sanitize`: what no sensor can have shown counts as missing.

An encoder that repeats one number to the last bit, and not that of a wheel that stands, while another one moves, has
stopped. One that stops at zero cannot be told from a wheel that stands.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import between, sanitize_step, some, within
from ohmward.quantities import FASTEST_M_S, MOST_MOTOR_A, MOST_WHEEL_RAD_S
from ohmward.trace import exp, isfinite, logical_not, minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.motion.intervals import Intervals, holds
from ohmward.traction.motion.sample import RobotSample

#: A longer step is a clock that was set, not a robot that waited.
LONGEST_STEP_S = 3600.0

#: A faster turn [rad/s] is a gyro's fault: the range of those that robots carry is 2000 degrees a second.
MOST_YAW_RAD_S = 35.0

#: A steeper pitch [rad] is a sensor's fault.
STEEPEST_RAD = 1.5

#: An older speed [s] is no measurement; a standard deviation [m/s] outside of these limits is not its source's.
OLDEST_S = 60.0
SPEED_STD_M_S = (1e-4, 10.0)

#: Time constant with which a motor current that is not measured fades.
CURRENT_FADES_S = 0.5

#: An encoder has stopped when it has repeated itself for so long [s] while another one moved.
STOPPED_AFTER_S = 2.0


class CredibleLimits(NamedTuple):
    """Limits of credible samples: a longer gap [s], a larger current [A] and a faster wheel [rad/s] are faults."""

    gap_s: float
    current_A: float = MOST_MOTOR_A
    wheel_rad_s: float = MOST_WHEEL_RAD_S


class SensorStds(NamedTuple):
    """Standard deviations of sensors in a sample, given or matched."""

    encoder_rad_s: np.ndarray  #: (encoders,), driven wheels first, then passive ones where their encoders are used
    torque_Nm: np.ndarray  #: (driven,) of the torque by each motor's current
    gyro_rad_s: np.ndarray  #: (1,), or empty without a gyro


class CleanSample(NamedTuple):
    """A sample of what is credible."""

    dt_s: Scalar  #: step [s], >= 0
    modelled_s: Scalar  #: part of the step that a model describes; 0 while the robot stands
    unmodelled_s: Scalar  #: the rest, in which the speed may have changed by anything; 0 while the robot stands
    current_A: np.ndarray  #: (driven,) over the step, 0 or held where it is not measured
    current_measured: np.ndarray  #: (driven,) conditions, true too where the last one still holds
    wheel_speed_rad_s: np.ndarray  #: (wheels,), 0 where it is not measured
    wheel_measured: np.ndarray  #: (wheels,) conditions
    time_credible: Scalar  #: the condition that the clock can have shown the step
    gap: Scalar  #: the condition that the step is longer than the last current is believed
    #: of the body, nan where it is not measured
    yaw_rate_rad_s: Scalar = math.nan
    acceleration_m_s2: Scalar = math.nan
    pitch_rad: Scalar = math.nan
    speed_m_s: Scalar = math.nan
    speed_std_m_s: Scalar = math.nan
    speed_age_s: Scalar = 0.0  #: >= 0
    speed_refused: Scalar = False  #: the condition that there is a speed of the body which no robot has now
    current_refused: Scalar = False  #: the condition that a current was measured which no wheel can have taken
    lag_share: Any = 1.0  #: (wheels,) share of the time since each encoder's last value over which its speed is a mean
    rest_s: Scalar = 0.0  #: time for which wheels and motors have been at rest
    resting: Scalar = False  #: the condition that this has lasted long enough for a standstill
    stds: SensorStds | None = None  #: matched standard deviations of the sensors; None where the given ones hold


class EncoderWatch(NamedTuple):
    """Last speeds (wheels,) of the encoders [rad/s], and time (wheels,) for which each has repeated itself [s]."""

    last_rad_s: np.ndarray
    repeated_s: np.ndarray


def sanitize(sample: RobotSample, limits: CredibleLimits) -> CleanSample:
    """The sample without what no sensor and no clock can have shown."""
    time = sanitize_step(sample.dt_s, LONGEST_STEP_S, limits.gap_s)
    measured_A = np.array([within(current, limits.current_A) for current in sample.current_A])
    measured = np.array([within(speed, limits.wheel_rad_s) for speed in sample.wheel_speed_rad_s])
    modelled_s = minimum(time.dt_s, limits.gap_s)
    credible = within(sample.speed_m_s, FASTEST_M_S) & logical_not(sample.speed_age_s > OLDEST_S)
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


def without_stopped(clean: CleanSample, before: EncoderWatch) -> tuple[CleanSample, EncoderWatch, Scalar]:
    """The sample without encoders that have stopped, the watch after it, and the condition that one has."""
    wheels = list(zip(clean.wheel_measured, clean.wheel_speed_rad_s, before.last_rad_s, strict=True))
    moved = [good & (speed != last) for good, speed, last in wheels]
    repeats = [good & logical_not(speed != last) & (last != 0.0) for good, speed, last in wheels]
    stood = [last == 0.0 for last in before.last_rad_s]
    passed_s = where(some(moved), clean.dt_s, 0.0)
    repeated_s = np.array([
        where(again, t + passed_s, where(some([moves, stands]), 0.0, t))
        for again, moves, stands, t in zip(repeats, moved, stood, before.repeated_s, strict=True)
    ])  # fmt: skip
    stopped = np.array([time_s > STOPPED_AFTER_S for time_s in repeated_s])
    watch = EncoderWatch(where(clean.wheel_measured, clean.wheel_speed_rad_s, before.last_rad_s), repeated_s)
    return clean._replace(wheel_measured=clean.wheel_measured & logical_not(stopped)), watch, some(stopped)
