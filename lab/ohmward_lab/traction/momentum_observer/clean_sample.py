"""Sanitise a sample for the momentum observer, see `ohmward.filters.sanitize`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ohmward.filters.sanitize import every, hold, is_step, within
from ohmward.trace import isfinite, where
from ohmward.trace.expression import Scalar
from ohmward.traction.robot.motor import Motor, wheel_torque
from ohmward_lab.traction.momentum_observer.estimate import AngleSample


class CleanAngleSample(NamedTuple):
    """A sample for the prediction, with every number finite."""

    dt_s: Scalar  #: step [s], >= 0
    time_credible: Scalar  #: the condition that the clock can have shown the step
    pitch_rad: Scalar  #: 0 where it is not measured
    pitch_measured: Scalar  #: the condition that it is
    torque_Nm: np.ndarray  #: (driven,) at the wheels over the step, the last one where no current came
    currents_measured: Scalar  #: the condition that all currents came
    rest_s: Scalar = 0.0  #: time for which counts and motors have been still
    resting: Scalar = False  #: the condition that this has lasted long enough for a standstill


def sanitize(
    sample: AngleSample,
    motor: Motor,
    wheel_speed_rad_s: np.ndarray,
    last_Nm: np.ndarray,
    gap_s: float,
    current_limit_A: float,
) -> CleanAngleSample:
    """The sample with what no sensor and no clock can have shown replaced.

    wheel_speed_rad_s: (driven,) believed ones.
    last_Nm: (driven,) torques of the sample before.
    gap_s: after a longer step nothing is known of the speed.
    current_limit_A: beyond it a sensor is at fault.
    """
    time_credible = is_step(sample.dt_s, gap_s)
    measured = [within(current, current_limit_A) for current in sample.current_A]
    currents = [where(good, current, 0.0) for good, current in zip(measured, sample.current_A, strict=True)]
    given = [wheel_torque(motor, i, w) for i, w in zip(currents, wheel_speed_rad_s, strict=True)]
    torque_Nm = [hold(now, good, last) for now, good, last in zip(given, measured, last_Nm, strict=True)]
    return CleanAngleSample(
        dt_s=where(time_credible, sample.dt_s, 0.0),
        time_credible=time_credible,
        pitch_rad=where(isfinite(sample.pitch_rad), sample.pitch_rad, 0.0),
        pitch_measured=isfinite(sample.pitch_rad),
        torque_Nm=np.array(torque_Nm),
        currents_measured=every(measured),
    )
