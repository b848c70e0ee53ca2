"""Sanitise a sample for the speed observer, see `ohmward.filters.sanitize`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.sanitize import hold, sanitize_step, within
from ohmward.trace import minimum, where
from ohmward.trace.expression import Scalar
from ohmward.traction.speed_observer.estimate import SlipSample

#: A longer step is a clock that was set, not a robot that waited.
LONGEST_STEP_S = 3600.0

#: Time constant with which a motor current that is not measured fades.
HOLD_S = 0.5


class CleanSlipSample(NamedTuple):
    """A sample with every number finite that is used.

    dt_s: step [s], >= 0.
    modelled_s: part of the step that the model describes; 0 while the robot stands.
    unmodelled_s: the rest, in which the speed may have changed by anything; 0 while the robot stands.
    current_A: (driven,) over the step, held where it is not measured.
    current_measured: (driven,) conditions.
    wheel_speed_rad_s: (wheels,), 0 where it is not measured.
    wheel_measured: (wheels,) conditions.
    pitch_rad: as measured.
    time_credible: the condition that the clock can have shown the step.
    gap: the condition that the step is longer than the last current is believed.
    rest_s: time for which wheels and motors have been at rest.
    resting: the condition that this has lasted long enough for a standstill.
    """

    dt_s: Scalar
    modelled_s: Scalar
    unmodelled_s: Scalar
    current_A: np.ndarray
    current_measured: np.ndarray
    wheel_speed_rad_s: np.ndarray
    wheel_measured: np.ndarray
    pitch_rad: Scalar
    time_credible: Scalar
    gap: Scalar
    rest_s: Scalar = 0.0
    resting: Scalar = False


def sanitize(
    sample: SlipSample, before_A: np.ndarray, gap_s: float, current_limit_A: float, wheel_speed_limit_rad_s: float
) -> CleanSlipSample:
    """The sample with what no sensor and no clock can have shown replaced.

    before_A: (driven,) the last currents.
    gap_s: a longer step says nothing about the current in between.
    current_limit_A, wheel_speed_limit_rad_s: beyond these a sensor is at fault.
    """
    time = sanitize_step(sample.dt_s, LONGEST_STEP_S, gap_s)
    measured_A = [within(current, current_limit_A) for current in sample.current_A]
    currents = zip(sample.current_A, measured_A, before_A, strict=True)
    measured = [within(speed, wheel_speed_limit_rad_s) for speed in sample.wheel_speed_rad_s]
    modelled_s = minimum(time.dt_s, gap_s)
    return CleanSlipSample(
        dt_s=time.dt_s,
        modelled_s=modelled_s,
        unmodelled_s=time.dt_s - modelled_s,
        current_A=np.array([hold(now, known, last, time.dt_s, HOLD_S) for now, known, last in currents]),
        current_measured=np.array(measured_A),
        wheel_speed_rad_s=where(np.array(measured), sample.wheel_speed_rad_s, 0.0),
        wheel_measured=np.array(measured),
        pitch_rad=sample.pitch_rad,
        time_credible=time.credible,
        gap=time.gap,
    )


def hold_still(clean: CleanSlipSample, rest_s: Scalar, hold_s: float) -> CleanSlipSample:
    """The sample of a robot that stands after `hold_s` at rest: the model must not accelerate it, whatever holds it."""
    resting = rest_s > hold_s
    return clean._replace(
        modelled_s=where(resting, 0.0, clean.modelled_s),
        unmodelled_s=where(resting, 0.0, clean.unmodelled_s),
        rest_s=rest_s,
        resting=resting,
    )
