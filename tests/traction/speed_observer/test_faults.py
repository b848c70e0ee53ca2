"""What sensors and clocks do to the observer, and what it says then. The truth is a steady 0.5 m/s unless said."""

from functools import cache

import numpy as np
import pytest

from ohmward.traction.speed_observer.encoders import wheel_speeds
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from traction.examples import plant

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
    accelerating_A = 42.8 * 0.5 * 0.12 / 2 / 0.517
    return CRUISE_A + np.where(np.arange(steps) < 100, accelerating_A, 0.0)


def watch(samples, **noise):
    return observed(SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise(**noise)), samples)[1]


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
    flag = SlipFlag.NO_CURRENT if column == "current_A" else SlipFlag.NO_ENCODER
    assert has(e, flag)[250:300].all() and not has(e, flag)[300:].any()
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("dt_s", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_clocks_that_stand_or_jump(dt_s):
    samples = cruise()
    samples.dt_s[250] = dt_s
    e = watch(samples)
    assert within(e, 0.5)[200:].all()
    assert has(e, SlipFlag.BAD_TIME)[250] == (dt_s != 0.0)
    assert np.isfinite(e.speed_std_m_s).all()


def test_a_gap_opens_the_speed_and_gripping_wheels_close_it():
    samples = cruise()
    samples.dt_s[250] = 5.0
    e = watch(samples)
    assert has(e, SlipFlag.GAP)[250]
    assert e.speed_std_m_s[250] > 0.05
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)
    assert within(e, 0.5)[200:].all()


def test_one_encoder_that_sticks():
    samples = cruise()
    samples.wheel_speed_rad_s[200:, 0] = 0.0
    e = watch(samples, gyro_std_rad_s=0.01)
    spike = has(e, SlipFlag.ENCODER_SPIKE)
    assert spike[200:205].all() and not spike[206:].any()  # no wheel stops within 10 ms: at first it is not believed
    assert has(e, SlipFlag.GROUND_CHANGED)[206]
    assert within(e, 0.5)[200:].all()
    assert e.slipping[230, 0] == 1.0 and e.slipping[230, 1] == 0.0


def test_a_spike_of_an_encoder_moves_the_wheel_and_not_the_body():
    samples = cruise()
    samples.wheel_speed_rad_s[250, 0] = 400.0
    e = watch(samples)
    assert within(e, 0.5)[200:].all()
    assert abs(e.speed_m_s[250:] - 0.5).max() < 0.05


def test_a_counter_that_overflows_is_no_fault():
    counts = np.mod(65_000 + 27 * np.arange(T)[:, None], 2**16)
    speeds = wheel_speeds(counts, DT_S * np.arange(T), 4096, 16)
    np.testing.assert_allclose(speeds[1:], 2 * np.pi * 27 / 4096 / DT_S)


def test_an_external_speed_that_is_wrong_for_a_moment_is_refused():
    speed = np.full(T, np.nan)
    speed[100::10] = 0.5
    speed[250] = 5.0
    e = watch(cruise(speed_m_s=speed), speed_std_m_s=0.05)
    assert has(e, SlipFlag.SPEED_REJECTED).nonzero()[0].tolist() == [250]
    assert e.speed_m_s[-1] == pytest.approx(0.5, abs=0.02)


def test_the_band_opens_the_moment_a_possible_speed_is_refused_and_not_for_one_that_no_wheel_has():
    speed = np.full(T, np.nan)
    speed[100::10] = 0.5
    speed[250] = 0.25
    possible = watch(cruise(speed_m_s=speed), speed_std_m_s=0.05)
    speed[250] = 5.0
    impossible = watch(cruise(speed_m_s=speed), speed_std_m_s=0.05)
    for e in (possible, impossible):
        assert has(e, SlipFlag.SPEED_REJECTED).nonzero()[0].tolist() == [250]
        assert within(e, 0.5, 2.0)[200:].all()
    assert possible.speed_std_m_s[250] > 0.2 and possible.speed_std_m_s[-1] < 0.05
    assert impossible.speed_std_m_s[250] < 1.1 * impossible.speed_std_m_s[249]


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
    assert not blind.immobilised.any() and has(blind, SlipFlag.GROUND_CHANGED).any()


def test_an_outside_speed_of_zero_is_stuck_where_the_robot_turns_with_its_wheels():
    steps = 1000
    rim_rad_s = OMEGA * np.minimum(1.0, np.arange(steps) / 100)
    turn_rad_s = 0.12 * 0.2 * rim_rad_s / 0.3
    outside = np.full(steps, np.nan)
    outside[::10] = np.where(np.arange(steps) < 300, 0.12 * rim_rad_s, 0.0)[::10]
    samples = log(rim_rad_s, current(steps), speed_m_s=outside, yaw_rate_rad_s=turn_rad_s)
    samples.wheel_speed_rad_s[:, :2] *= [0.9, 1.1]
    e = watch(samples, speed_std_m_s=0.05, gyro_std_rad_s=0.01)
    assert not e.immobilised[-100:].any() and e.speed_m_s[-100:] == pytest.approx(0.5, abs=0.03)


def test_standstill_is_zero_speed_whatever_was_believed():
    samples = cruise(600)
    samples.wheel_speed_rad_s[300:, :2] = 0.0
    samples.current_A[300:] = 0.0
    e = watch(samples)
    assert has(e, SlipFlag.STANDSTILL)[-1] and not has(e, SlipFlag.STANDSTILL)[:340].any()
    assert abs(e.speed_m_s[-1]) < 1e-3 and e.speed_std_m_s[-1] < 1e-3


@cache
def weaving(steps=600):
    """Encoders (T, 2), currents (T, 2) and true states (T, 4) of a robot that accelerates and weaves."""
    time_s, rng = DT_S * np.arange(steps), np.random.default_rng(0)
    steer = 3.0 * np.sin(2 * time_s)
    current_A = (CRUISE_A + np.where(time_s < 1, 2.5, 0.0))[:, None] + steer[:, None] * np.array([-1.0, 1.0])
    _, x = plant(RLMA_ON_FLOOR).scan(np.zeros(4), current_A)
    return x[:, 2:] + 0.05 * rng.standard_normal((steps, 2)), current_A, x


def watch_weaving(encoders, current_A, x, gyro=True):
    samples = log(encoders[:, 0], current_A[:, 0], yaw_rate_rad_s=x[:, 1])
    samples.wheel_speed_rad_s[:, 1] = encoders[:, 1]
    samples.current_A[:] = current_A
    return watch(samples, gyro_std_rad_s=0.01 if gyro else None)


def test_weaving_is_no_fault():
    e = watch_weaving(*weaving())
    assert not e.flags.any()


MISWIRED = {
    "encoders of left and right exchanged": lambda w, i: (w[:, ::-1], i),
    "currents of left and right exchanged": lambda w, i: (w, i[:, ::-1]),
    "one encoder counts backwards": lambda w, i: (w * np.array([-1.0, 1.0]), i),
    "currents with the wrong sign": lambda w, i: (w, -i),
    "one encoder stuck at a speed": lambda w, i: (np.column_stack([np.full(len(w), w[200, 0]), w[:, 1]]), i),
    "both encoders stuck at a speed": lambda w, i: (np.where(np.arange(len(w))[:, None] < 200, w, w[200]), i),
}


@pytest.mark.parametrize("fault", MISWIRED)
def test_wires_in_the_wrong_order_are_flagged_and_stop_nothing(fault):
    encoders, current_A, x = weaving()
    e = watch_weaving(*MISWIRED[fault](encoders, current_A), x)
    wrong = SlipFlag.GROUND_CHANGED | SlipFlag.ENCODER_REJECTED | SlipFlag.SPEED_UNOBSERVED | SlipFlag.GYRO_REJECTED
    assert has(e, wrong).mean() > 0.1
    assert_finite(e)


def test_without_a_gyro_exchanged_encoders_are_a_turn_the_other_way():
    encoders, current_A, x = weaving()
    e = watch_weaving(encoders[:, ::-1], current_A, x, gyro=False)
    assert e.yaw_rate_rad_s == pytest.approx(-x[:, 1], abs=0.3)
    assert e.speed_m_s[-1] == pytest.approx(x[-1, 0], abs=0.02)


def assert_finite(e):
    for name, values in e._asdict().items():
        if name != "slip_ratio":  # which is none at rest
            assert np.isfinite(values).all(), name
    assert (e.speed_std_m_s > 0).all()


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("seed", range(3))
def test_nothing_that_a_sensor_can_say_makes_it_stop(seed, method):
    rng, steps = np.random.default_rng(seed), 1500
    garbage = np.array([np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 1e-300, 400.0, -400.0, 5.0, -0.1])
    samples = cruise(steps, yaw_rate_rad_s=np.zeros(steps), speed_m_s=np.full(steps, 0.5), pitch_rad=np.zeros(steps))
    for column in (c for c in samples if c.shape[0] == steps):
        spoilt = rng.random(column.shape) < 0.05
        column[spoilt] = rng.choice(garbage, spoilt.sum())
    noise = ObserverNoise(gyro_std_rad_s=0.01, speed_std_m_s=0.05, pitch_std_rad=0.01)
    e = observed(SpeedObserver(RLMA_ON_FLOOR, noise=noise, method=method, matching=True), samples)[1]
    assert_finite(e)
