"""Currents and encoders that come less often than the samples of a log."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ohmward.logs.drive_log import DriveLog
from ohmward.traction import RLMA
from ohmward.traction.motion.sample import LONGER, advance, holds, never
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.estimator import observe
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

from .examples import RLMA_ON_FLOOR, log, observed

NAN = np.nan


def holding(values):
    """Values (T,) with the last one where the clocks of a channel let it hold."""
    clocks, last, found = never(1), NAN, []
    for value in values:
        clocks = advance(clocks, np.array([np.isfinite(value)]), 1.0)
        last = value if np.isfinite(value) else last
        found.append(last if np.isfinite(value) or holds(clocks)[0] else NAN)
    return found


def test_the_last_value_holds_for_the_usual_interval():
    slow = [NAN, 1.0, NAN, NAN, 4.0, NAN, NAN, 7.0, NAN, NAN, NAN, NAN]
    assert_array_equal(holding(slow), [NAN, 1, NAN, NAN, 4, 4, 4, 7, 7, 7, NAN, NAN])


def test_the_first_value_holds_for_a_while():
    clocks = advance(never(1), np.array([True]), 0.1)
    held = [holds(clocks := advance(clocks, np.array([False]), 0.1))[0] for _ in range(4)]
    assert held == [True, True, False, False]


def test_a_value_that_fails_is_missed():
    steady = np.arange(8.0)
    steady[3:5] = NAN
    assert_array_equal(holding(steady), steady)


def test_one_failure_lengthens_the_interval_by_a_quarter():
    clocks = never(1)
    for measured in [True, True, True, False, False, False, True]:
        clocks = advance(clocks, np.array([measured]), 1.0)
    assert_allclose(clocks.usual_s, [LONGER])


def test_intervals_that_vary_make_no_value_missing():
    gaps_s = np.random.default_rng(0).uniform(0.008, 0.012, 300)
    clocks, held = never(1), []
    for gap_s in gaps_s:
        clocks = advance(clocks, np.array([False]), 0.9 * gap_s)
        held.append(holds(clocks)[0])
        clocks = advance(clocks, np.array([True]), 0.1 * gap_s)
    assert np.mean(held[20:]) > 0.95


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


def test_an_encoder_is_missing_only_where_one_was_due():
    time_s = np.arange(0.0, 2.0, 0.01)
    wheels = np.full((len(time_s), 4), NAN)
    wheels[::2, :2] = 3.0
    wheels[100:104] = NAN
    log = DriveLog("slow", time_s, wheels, np.zeros((len(time_s), 2)), yaw_rate_rad_s=np.zeros(len(time_s)))
    track = observe(SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise(gyro_std_rad_s=0.01)), log)
    assert np.flatnonzero(track.flags & SlipFlag.NO_ENCODER).tolist() == [100, 101, 102, 103]


@pytest.mark.parametrize("every", [2, 5])
def test_wheels_that_break_away_between_two_values_do_not_carry_the_speed_with_them(every):
    """Onto ice at 0.5 m/s: the rims gain 5 m/s^2, and the body what traction the motors leave."""
    robot, radius_m = RLMA_ON_FLOOR.robot, RLMA.wheel.radius_m
    rim_m_s = np.concatenate([np.linspace(0.0, 0.5, 200), np.full(200, 0.5), 0.5 + 0.05 * np.arange(50.0)])
    current_A = np.concatenate([np.full(200, 0.8), np.full(200, 0.36), np.full(50, 2.5)])
    spinning_Nm = robot.inertia[robot.freedoms] * 5.0 / radius_m
    force_N = 2 * (robot.motor.wheel_constant_Nm_per_A * 2.5 - spinning_Nm) / radius_m
    body_m_s = 0.5 + force_N / robot.inertia[0] * 0.5
    samples = log(rim_m_s / radius_m, current_A)
    given = np.full(rim_m_s.shape, NAN)
    given[every - 1 :: every] = rim_m_s.reshape(-1, every).mean(axis=1)
    samples.wheel_speed_rad_s[:, :2] = given[:, None] / radius_m
    _, e = observed(SpeedObserver(RLMA_ON_FLOOR, rest_hold_s=np.inf), samples)
    assert e.speed_m_s[395] == pytest.approx(0.5, abs=0.02)
    assert e.speed_m_s[-1] == pytest.approx(body_m_s, abs=0.2)
