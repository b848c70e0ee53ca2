"""What sensors and clocks do to the observer, and what it says then. The truth is a steady 0.5 m/s unless said."""

import numpy as np
import pytest

from ohmward.traction.observers import Flag, Noise, SpeedObserver, wheel_speeds

from .examples import DT_S, RLMA_ON_FLOOR, log, observed

OMEGA = 0.5 / 0.12
#: What rolling at 0.5 m/s takes from each motor.
CRUISE_A = 0.5 * 42.0 * 9.80665 * 0.0075 * 0.12 / 0.517
T = 400


def cruise(steps=T, **others):
    noise = 0.05 * np.random.default_rng(0).standard_normal(steps)
    return log(OMEGA * np.minimum(1.0, np.arange(steps) / 100) + noise, current(steps), **others)


def current(steps):
    """Accelerates for a second, then cruises."""
    push_A = 42.8 * 0.5 * 0.12 / 2 / 0.517
    return CRUISE_A + np.where(np.arange(steps) < 100, push_A, 0.0)


def watch(samples, **noise):
    return observed(SpeedObserver(RLMA_ON_FLOOR, noise=Noise(**noise)), samples)[1]


def has(e, flag):
    return (e.flags.astype(int) & flag) > 0


def within(e, true, sigmas=4.0):
    return abs(e.speed_m_s - true) < sigmas * e.speed_std_m_s + 1e-3


def test_without_faults():
    e = watch(cruise())
    assert e.speed_m_s[-200:] == pytest.approx(0.5, abs=0.015)
    assert not e.flags.any() and not e.slipping.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("column", ["wheel_speed_rad_s", "current_A"])
def test_numbers_that_are_none(column, value):
    samples = cruise()
    getattr(samples, column)[250:300] = value
    e = watch(samples)
    assert within(e, 0.5)[200:].all()
    flag = Flag.NO_CURRENT if column == "current_A" else Flag.NO_ENCODER
    assert has(e, flag)[250:300].all() and not has(e, flag)[300:].any()
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_clocks_that_stand_or_jump(dt_s):
    samples = cruise()
    samples.dt_s[250] = dt_s
    e = watch(samples)
    assert within(e, 0.5)[200:].all()
    assert has(e, Flag.BAD_TIME)[250] == (dt_s != 0.0)
    assert np.isfinite(e.speed_std_m_s).all()


def test_a_gap_opens_the_speed_and_gripping_wheels_close_it():
    samples = cruise()
    samples.dt_s[250] = 5.0
    e = watch(samples)
    assert has(e, Flag.GAP)[250]
    assert e.speed_std_m_s[250] > 0.05
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)
    assert within(e, 0.5)[200:].all()


def test_one_encoder_that_sticks():
    samples = cruise()
    samples.wheel_speed_rad_s[200:, 0] = 0.0
    e = watch(samples, gyro_std_rad_s=0.01)
    assert has(e, Flag.GROUND_CHANGED)[200]
    assert within(e, 0.5)[200:].all()
    assert e.slipping[230, 0] == 1.0 and e.slipping[230, 1] == 0.0


def test_a_spike_of_an_encoder_moves_the_wheel_and_not_the_body():
    samples = cruise()
    samples.wheel_speed_rad_s[250, 0] = 400.0
    e = watch(samples)
    assert within(e, 0.5)[200:].all()
    assert abs(e.speed_m_s[250:] - 0.5).max() < 0.05


def test_a_counter_that_overflows_is_no_fault():
    counts = np.cumsum(np.full((T, 1), 27), axis=0)
    time_s = DT_S * np.arange(T)
    np.testing.assert_array_equal(
        wheel_speeds(np.mod(counts, 2**16) + 2**16 - 2**16, time_s, 4096, 16), wheel_speeds(counts, time_s, 4096, 16)
    )


def test_an_external_speed_that_is_wrong_for_a_moment_is_refused():
    speed = np.full(T, np.nan)
    speed[100::10] = 0.5
    speed[250] = 5.0
    e = watch(cruise(speed_m_s=speed), speed_std_m_s=0.05)
    assert has(e, Flag.SPEED_REJECTED).nonzero()[0].tolist() == [250]
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)


def test_current_without_motion_is_a_robot_that_is_held():
    samples = log(np.zeros(T), np.full(T, 8.0))
    e = watch(samples)
    assert abs(e.speed_m_s).max() < 0.1
    assert abs(e.speed_m_s[-1]) < 0.04


def test_wheels_that_turn_on_a_robot_that_does_not_are_reported_within_two_seconds():
    spin = np.minimum(10.0, 0.5 * np.arange(T))
    held = np.full(T, np.nan)
    held[::10] = 0.0
    e = watch(log(spin, np.full(T, 4.0), speed_m_s=held), speed_std_m_s=0.05)
    first = int(np.argmax(e.immobilised > 0))
    assert 100 < first < 250
    assert e.immobilised[first:].all()
    blind = watch(log(spin, np.full(T, 4.0)))
    assert not blind.immobilised.any() and has(blind, Flag.GROUND_CHANGED).any()


def test_standstill_is_zero_speed_whatever_was_believed():
    samples = cruise(600)
    samples.wheel_speed_rad_s[300:, :2] = 0.0
    samples.current_A[300:] = 0.0
    e = watch(samples)
    assert has(e, Flag.STANDSTILL)[-1] and not has(e, Flag.STANDSTILL)[:340].any()
    assert abs(e.speed_m_s[-1]) < 1e-3 and e.speed_std_m_s[-1] < 1e-3
