"""Currents that come less often than the samples of a log."""

from dataclasses import replace

import numpy as np

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.speed_observer.estimator import held, observe
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

from .examples import RLMA_ON_FLOOR

NAN = np.nan
TIME_S = np.arange(8.0)


def test_the_last_value_holds_for_the_usual_interval():
    slow = np.array([NAN, 1.0, NAN, NAN, 4.0, NAN, NAN, NAN])
    assert np.array_equal(held(TIME_S, slow[:, None])[:, 0], [NAN, 1, 1, 1, 4, 4, 4, NAN], equal_nan=True)


def test_a_value_that_fails_is_missed():
    steady = np.arange(8.0)
    steady[3:5] = NAN
    columns = np.column_stack([steady, np.full(8, NAN)])
    assert np.array_equal(held(TIME_S, columns), columns, equal_nan=True)


def test_a_slow_current_leaves_the_speed_known():
    time_s = np.arange(0.0, 4.0, 0.01)
    speed = 0.3 * np.minimum(time_s, 1.0) / RLMA.wheel.radius_m
    wheels = np.column_stack([speed, speed, np.full((len(speed), 2), NAN)])
    current_A = np.where(time_s < 1.0, 42.0 * 0.3 * RLMA.wheel.radius_m / 2 / 0.517, 0.0)
    fast = DriveLog("fast", time_s, wheels, np.column_stack([current_A, current_A]))
    seldom = (np.arange(len(time_s)) % 15 == 0)[:, None]
    few = replace(fast, wheel_speed_rad_s=np.where(seldom, wheels, NAN))
    observer = SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise())
    known = observe(observer, few).estimates
    slow = observe(observer, replace(few, motor_current_A=np.where(seldom, fast.motor_current_A, NAN))).estimates
    assert np.max(slow.speed_std_m_s[:-15] / known.speed_std_m_s[:-15]) < 1.2
    assert np.abs(slow.speed_m_s - known.speed_m_s).max() < 0.02
