"""Sanitise a sample for the speed observer, see `ohmward.filters.sanitize`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ohmward.filters.sanitize import sanitize_step, within
from ohmward.trace import exp, logical_not, minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.speed_observer.estimate import SlipSample
from ohmward.traction.speed_observer.intervals import Intervals, holds
from ohmward.traction.speed_observer.noise import SensorStds

#: A longer step is a clock that was set, not a robot that waited.
LONGEST_STEP_S = 3600.0

#: Time constant with which a motor current that is not measured fades.
CURRENT_FADES_S = 0.5


class CleanSlipSample(NamedTuple):
    """A sample with every number finite that is used."""

    dt_s: Scalar  #: step [s], >= 0
    modelled_s: Scalar  #: part of the step that the model describes; 0 while the robot stands
    unmodelled_s: Scalar  #: the rest, in which the speed may have changed by anything; 0 while the robot stands
    current_A: np.ndarray  #: (driven,) over the step, held where it is not measured
    current_measured: np.ndarray  #: (driven,) conditions, true too where the last one still holds
    wheel_speed_rad_s: np.ndarray  #: (wheels,), 0 where it is not measured
    wheel_measured: np.ndarray  #: (wheels,) conditions
    pitch_rad: Scalar  #: as measured
    time_credible: Scalar  #: the condition that the clock can have shown the step
    gap: Scalar  #: the condition that the step is longer than the last current is believed
    current_refused: Scalar = False  #: the condition that a current was measured which no wheel can have taken
    lag_share: Any = 1.0  #: (wheels,) share of the time since each encoder's last value over which its speed is a mean
    rest_s: Scalar = 0.0  #: time for which wheels and motors have been at rest
    resting: Scalar = False  #: the condition that this has lasted long enough for a standstill
    stds: SensorStds | None = None  #: matched standard deviations of the sensors; None where the given ones hold


class CredibleLimits(NamedTuple):
    """Limits of credible samples: a longer gap [s], a larger current [A] and a faster wheel [rad/s] are faults."""

    gap_s: float
    current_A: float
    wheel_rad_s: float


def sanitize(sample: SlipSample, limits: CredibleLimits) -> CleanSlipSample:
    """The sample with what no sensor and no clock can have shown replaced by zero."""
    time = sanitize_step(sample.dt_s, LONGEST_STEP_S, limits.gap_s)
    measured_A = np.array([within(current, limits.current_A) for current in sample.current_A])
    measured = np.array([within(speed, limits.wheel_rad_s) for speed in sample.wheel_speed_rad_s])
    modelled_s = minimum(time.dt_s, limits.gap_s)
    return CleanSlipSample(
        dt_s=time.dt_s,
        modelled_s=modelled_s,
        unmodelled_s=time.dt_s - modelled_s,
        current_A=where(measured_A, sample.current_A, 0.0),
        current_measured=measured_A,
        wheel_speed_rad_s=where(measured, sample.wheel_speed_rad_s, 0.0),
        wheel_measured=measured,
        pitch_rad=sample.pitch_rad,
        time_credible=time.credible,
        gap=time.gap,
    )


def hold_currents(clean: CleanSlipSample, last_A: np.ndarray, intervals: Intervals) -> CleanSlipSample:
    """The sample with the last currents (driven,) where none is measured.

    Over the usual interval of its sensor the last one counts as measured; then it is missing, and fades.

    intervals: of the currents, this step included.
    """
    held = holds(intervals) & logical_not(clean.current_measured)
    known = clean.current_measured | held
    last = where(held, last_A, last_A * exp(-clean.dt_s / CURRENT_FADES_S))
    return clean._replace(current_A=where(clean.current_measured, clean.current_A, last), current_measured=known)


def hold_still(clean: CleanSlipSample, rest_s: Scalar, hold_s: float) -> CleanSlipSample:
    """The sample of a robot that stands after `hold_s` at rest: the model must not accelerate it, whatever holds it."""
    resting = rest_s > hold_s
    return clean._replace(
        modelled_s=where(resting, 0.0, clean.modelled_s),
        unmodelled_s=where(resting, 0.0, clean.unmodelled_s),
        rest_s=rest_s,
        resting=resting,
    )
