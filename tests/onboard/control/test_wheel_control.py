"""The compiled step of the wheels' controllers against the same step with NumPy."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ohmward.onboard.control.operator_command import DriveLimits, OperatorCommand
from ohmward.onboard.control.wheel_control import WheelControl
from ohmward.traction.control import Measurement, SlipCommand, SpeedCommand
from ohmward.traction.robot.packaged import RLMA
from ohmward.traction.speed_observer.estimator import SlipEstimator

FIRST = SlipEstimator(RLMA).update(0.0, [0.0] * 4, [0.0] * 2)


@pytest.mark.parametrize("kind", [SpeedCommand, SlipCommand])
def test_the_compiled_step_is_that_of_the_controller(kind):
    control, rng, n = WheelControl(RLMA, DriveLimits()), np.random.default_rng(1), RLMA.driven
    each = control._speed if kind is SpeedCommand else control._slip
    state: Any = None
    for k in range(500):
        travel = 0.4 * np.sin(0.02 * k + np.arange(n))
        wheels = (travel + 0.1 * rng.standard_normal(n)) / RLMA.wheel.radius_m
        std = np.full(n, 0.5 if 200 < k < 210 else 0.01)
        measured = Measurement(wheels, travel, np.full(n, 0.005), std, np.full(n, np.nan), np.full(n, np.nan))
        asked = kind(np.array([0.3, -0.2]) if kind is SpeedCommand else np.array([0.2, -0.1]), np.array([0.1, 0.2]))
        if state is None:
            state = each._controller.init(measured)._replace(torque_Nm=np.array([0.5, -0.5]))
            each.begin(measured, np.array([0.5, -0.5]))
        state, torque_Nm, report = each._controller.step(state, asked, measured, 0.01)
        found_Nm, found = each.step(asked, measured, 0.01)
        assert_allclose(found_Nm, torque_Nm, rtol=1e-9, atol=1e-12)
        for one, other in zip(found, report, strict=True):
            assert_allclose(one, np.broadcast_to(other, (n,)), rtol=1e-9, atol=1e-12)


def test_a_change_between_speed_and_slip_keeps_the_torque():
    limits = DriveLimits()
    control, dt_s = WheelControl(RLMA, limits), 0.01
    estimate = FIRST._replace(speed_m_s=0.2, wheel_speed_rad_s=np.full(2, 0.22 / RLMA.wheel.radius_m))
    for _ in range(30):
        before = control.step(OperatorCommand(True, 0.5), estimate, 0.005, dt_s).torque_Nm
    after = control.step(OperatorCommand(True, 0.5, slip_ratio=0.15), estimate, 0.005, dt_s).torque_Nm
    assert abs(before).min() > 0.0
    assert abs(after - before).max() <= limits.torque_rate_Nm_per_s * dt_s + 1e-9
