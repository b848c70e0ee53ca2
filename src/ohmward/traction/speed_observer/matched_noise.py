"""White noise of encoders, motor currents and gyro, matched to their signals: the adaptive filters' R.

Three values of a sensor in a row show its white noise: the distance of the middle one from the line through the other
two, at the share a of the time between them, is

    d = y_1 - (1 - a) y_0 - a y_2,    Var d = (1 + (1 - a)^2 + a^2) R

apart from the curvature of the true signal, which is small at control rates. R is the mean of d^2 over its factor, with
exponential forgetting; each d^2 is capped at CLIP times the usual one, so that glitches and jolts are not learnt.

[T] 3.50 matches R to the filter's residuals instead. They depend on Q: where Q is generous, as that of ground and yaw
rate must be, residuals shrink with R, and every R confirms itself. Nor do they show the noise of the currents while
wheels grip: a factor of ten changes the correlation of the innovations by 0.02. The signal of each sensor needs no
model at all. It does not show errors that are not white: the gear friction in a torque, the offset of a gyro. So a
share of the given torque noise and an offset of the gyro always remain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.sanitize import every
from ohmward.trace import Scalar, clip, isfinite, logical_not, maximum, minimum, sqrt, where
from ohmward.traction.motion.sample import LEAST_DIVISOR, NEVER_S, CleanSample, SensorStds
from ohmward.traction.speed_observer.model import Model

#: Largest squared deviation, over the usual one; mean of a chi-square variable of one degree of freedom capped there.
CLIP, CLIPPED_MEAN = 4.0, 0.9205

#: Number of samples that the given noise counts for.
GIVEN_SAMPLES = 10.0

#: Greatest factor by which a matched standard deviation differs from the given one.
MOST_RATIO = 20.0

#: Share of the given torque's standard deviation that no current shows.
UNMODELLED_SHARE = 0.2

#: Offset of a gyro [rad/s] that its white noise does not show, unless the given standard deviation is less.
GYRO_OFFSET_RAD_S = 0.003

#: The signal of a sensor slower than this [s] curves too much between three values.
SLOWEST_S = 0.25


class WhiteNoise(NamedTuple):
    """White noise of the channels of a sensor, each (channels,)."""

    earlier: np.ndarray  #: value before the last one
    last: np.ndarray  #: last value
    between_s: np.ndarray  #: time between these two, very long before there are two
    age_s: np.ndarray  #: time since the last value, very long before the first
    variance: np.ndarray  #: of the noise
    samples: np.ndarray  #: number of deviations in the variance


class MatchedNoise(NamedTuple):
    """Noise of the sensors that exist: encoders [rad/s], driven wheels first, motor currents [A], gyro [rad/s]."""

    encoder: WhiteNoise
    current: WhiteNoise
    gyro: WhiteNoise


def unmatched(model: Model) -> MatchedNoise:
    """The given noise, before the first value."""
    given = model.given_stds
    current_A = given.torque_Nm / model.scene.robot.motor.wheel_constant_Nm_per_A
    return MatchedNoise(first(given.encoder_rad_s), first(current_A), first(given.gyro_rad_s))


def fixed() -> MatchedNoise:
    """Empty noise, without matching."""
    return MatchedNoise(*[first(np.empty(0))] * 3)


def first(std: np.ndarray) -> WhiteNoise:
    """The noise of channels that have not had a value; std: (channels,) that was given."""
    nothing, never = np.zeros(len(std)), np.full(len(std), NEVER_S)
    return WhiteNoise(nothing, nothing, never, never, std**2, np.full(len(std), GIVEN_SAMPLES))


def matched_stds(matched: MatchedNoise, model: Model) -> SensorStds:
    """Matched standard deviations of the sensors, plus the errors that are never white."""
    given = model.given_stds
    measured_Nm = model.scene.robot.motor.wheel_constant_Nm_per_A * sqrt(matched.current.variance)
    offset_rad_s = np.minimum(given.gyro_rad_s, GYRO_OFFSET_RAD_S)
    return SensorStds(
        encoder_rad_s=sqrt(matched.encoder.variance),
        torque_Nm=sqrt(measured_Nm**2 + (UNMODELLED_SHARE * given.torque_Nm) ** 2),
        gyro_rad_s=sqrt(matched.gyro.variance + offset_rad_s**2),
    )


def match(matched: MatchedNoise, clean: CleanSample, model: Model, window: float) -> MatchedNoise:
    """The matched noise after a sample.

    clean: the sample before its currents are held.
    window: effective number of samples in the mean.
    """
    given = unmatched(model)
    wheels, gyros = len(given.encoder.variance), len(given.gyro.variance)
    turns = isfinite(clean.yaw_rate_rad_s)
    yaw_rad_s = where(turns, clean.yaw_rate_rad_s, 0.0)
    values = (clean.wheel_speed_rad_s[:wheels], clean.current_A, np.array([yaw_rad_s] * gyros))
    measured = (clean.wheel_measured[:wheels], clean.current_measured, np.array([turns] * gyros))
    sensors = zip(matched, given, values, measured, strict=True)
    return MatchedNoise(*(follow(*sensor, clean.dt_s, window) for sensor in sensors))


def follow(
    white: WhiteNoise, given: WhiteNoise, y: np.ndarray, measured: np.ndarray, dt_s: Scalar, window: float
) -> WhiteNoise:
    """The white noise of a sensor after values y (channels,), where they are measured.

    Repeated values carry no information: wheels stand, or a driver holds the last value.
    """
    channels = list(zip(*white, strict=True))
    news = zip(channels, given.variance, y, measured, strict=True)
    after = [follow_channel(WhiteNoise(*old), least, value, seen, dt_s, window) for old, least, value, seen in news]
    return WhiteNoise(*(np.array(values) for values in zip(*after, strict=True))) if after else white


def follow_channel(
    white: WhiteNoise, given: Scalar, y: Scalar, measured: Scalar, dt_s: Scalar, window: float
) -> WhiteNoise:
    """The white noise of one channel after a value y; given: variance."""
    age_s = minimum(white.age_s + dt_s, NEVER_S)
    share = white.between_s / maximum(white.between_s + age_s, LEAST_DIVISOR)
    deviation = white.last - (1.0 - share) * white.earlier - share * y
    square = deviation**2 / (1.0 + (1.0 - share) ** 2 + share**2)
    repeats = (abs(y - white.last) <= 0.0) & (abs(white.last - white.earlier) <= 0.0)
    informative = every([measured, logical_not(repeats), white.between_s + age_s <= 2.0 * SLOWEST_S])
    samples = where(informative, minimum(white.samples + 1.0, window), white.samples)
    seen = minimum(square, CLIP * white.variance) / CLIPPED_MEAN
    variance = where(informative, white.variance + (seen - white.variance) / samples, white.variance)
    return WhiteNoise(
        earlier=where(measured, white.last, white.earlier),
        last=where(measured, y, white.last),
        between_s=where(measured, age_s, white.between_s),
        age_s=where(measured, 0.0, age_s),
        variance=clip(variance, given / MOST_RATIO**2, given * MOST_RATIO**2),
        samples=samples,
    )
