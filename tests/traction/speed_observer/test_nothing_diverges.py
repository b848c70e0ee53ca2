"""Glitches, gaps, impossible currents, and samples made to destroy: the estimate stays one that the robot can have."""

from functools import cache

import numpy as np
import pytest

from kernels import kernel_of
from ohmward.filters.belief import pack, unpack
from ohmward.logs import DriveLog
from ohmward.traction import Motor, Robot, SkidSteer, Wheel
from ohmward.traction.motion.sample import RobotSample
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.estimator import SlipEstimator
from ohmward.traction.speed_observer.make_observer import FILTERS, default_observer
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from traction.examples import plant

from .examples import DT_S, RLMA_ON_FLOOR, at_rest, log, observed

FAST_RAD_S = 20.0


def has(e, flag):
    return (e.flags.astype(int) & flag) > 0


@cache
def drive(steps=1500):
    """Encoders (T, 2), currents (T, 2) and true states (T, 4) of a robot that starts, weaves and brakes."""
    time_s, rng = DT_S * np.arange(steps), np.random.default_rng(1)
    pace = 3.0 * np.sin(0.8 * time_s) + 0.5
    steer = 1.5 * np.sin(2 * time_s)
    current_A = pace[:, None] + steer[:, None] * np.array([-1.0, 1.0])
    _, x = plant(RLMA_ON_FLOOR).scan(np.zeros(4), current_A)
    return x[:, 2:] + 0.05 * rng.standard_normal((steps, 2)), current_A, x


def watch(encoders, current_A, x, method="ukf", **others):
    samples = log(encoders[:, 0], current_A[:, 0], yaw_rate_rad_s=x[:, 1], **others)
    samples.wheel_speed_rad_s[:, 1] = encoders[:, 1]
    samples.current_A[:] = current_A
    noise = ObserverNoise(gyro_std_rad_s=0.01)
    return observed(SpeedObserver(RLMA_ON_FLOOR, noise=noise, method=method), samples)[1]


def rmse_and_coverage(e, x):
    error = e.speed_m_s - x[:, 0]
    return np.sqrt(np.mean(error**2)), np.mean(np.abs(error) <= 1.96 * e.speed_std_m_s)


@pytest.mark.parametrize("method", ["ekf", "ukf"])
@pytest.mark.parametrize(("share", "most_rmse", "least_covered"), [(0.005, 1.5, 0.95), (0.01, 2, 0.93), (0.05, 4, 0.9)])
def test_one_sample_spikes_of_the_encoders_are_gated_and_flagged(share, most_rmse, least_covered, method):
    encoders, current_A, x = drive()
    rng = np.random.default_rng(5)
    hit = rng.random(encoders.shape) < share
    spoilt = encoders + np.where(hit, FAST_RAD_S * rng.choice([-1, 1], hit.shape), 0.0)
    clean, _ = rmse_and_coverage(watch(encoders, current_A, x, method), x)
    e = watch(spoilt, current_A, x, method)
    found, covered = rmse_and_coverage(e, x)
    assert found < most_rmse * clean
    assert covered >= least_covered
    flagged = has(e, SlipFlag.ENCODER_SPIKE)
    assert flagged[hit.any(axis=1)].mean() > 0.95
    assert flagged[~hit.any(axis=1)].mean() < 0.01


def test_an_encoder_that_lies_for_longer_than_a_glitch_is_taken_for_the_ground_then_doubted():
    encoders, current_A, x = drive()
    spoilt = encoders.copy()
    spoilt[500:900, 0] += FAST_RAD_S
    e = watch(spoilt, current_A, x)
    assert has(e, SlipFlag.ENCODER_SPIKE)[500] and has(e, SlipFlag.GROUND_CHANGED)[500:520].any()
    assert has(e, SlipFlag.GROUND_CHANGED | SlipFlag.ENCODER_REJECTED | SlipFlag.GYRO_REJECTED)[520:880].mean() > 0.5
    assert np.abs(e.speed_m_s).max() < 3.0


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_currents_that_neither_ground_nor_wheel_can_have_taken_are_refused(method):
    encoders, current_A, x = drive()
    rng = np.random.default_rng(6)
    hit = rng.random(current_A.shape) < 0.2
    e = watch(encoders, np.where(hit, 100.0 * rng.choice([-1, 1], hit.shape), current_A), x, method)
    assert has(e, SlipFlag.NO_CURRENT)[hit.any(axis=1)].mean() > 0.95
    found, covered = rmse_and_coverage(e, x)
    assert found < 0.05 and covered > 0.9


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_a_speed_from_outside_that_the_wheels_exclude_is_refused_however_often_it_comes(method):
    encoders, current_A, x = drive()
    wrong = np.where(np.arange(len(x)) % 10 == 0, -20.0, np.nan)
    samples = log(encoders[:, 0], current_A[:, 0], yaw_rate_rad_s=x[:, 1], speed_m_s=wrong)
    samples.wheel_speed_rad_s[:, 1] = encoders[:, 1]
    samples.current_A[:] = current_A
    noise = ObserverNoise(gyro_std_rad_s=0.01, speed_std_m_s=0.05)
    e = observed(SpeedObserver(RLMA_ON_FLOOR, noise=noise, method=method), samples)[1]
    assert has(e, SlipFlag.SPEED_REJECTED)[::10].all() and not has(e, SlipFlag.SPEED_RESET).any()
    assert np.abs(e.speed_m_s - x[:, 0]).max() < 0.1


def test_a_belief_that_is_no_number_starts_again_and_says_so():
    encoders, current_A, _ = drive()
    samples = log(encoders[:, 0], current_A[:, 0])
    observer = SpeedObserver(RLMA_ON_FLOOR)
    state = observer.init(at_rest(observer))
    kernel = kernel_of(observer, state, at_rest(observer))
    state, _ = kernel.scan(state, RobotSample(*(column[:500] for column in samples)))
    for spoil in (np.nan, np.inf, 1e60, 20.0):
        belief = unpack(state.belief)
        belief.mean[0] = spoil
        lost = state._replace(belief=pack(belief))
        _, e = kernel.scan(lost, RobotSample(*(column[500:600] for column in samples)))
        assert has(e, SlipFlag.RESTARTED)[0] and not has(e, SlipFlag.RESTARTED)[1:].any()
        assert np.isfinite(e.speed_m_s).all() and np.abs(e.speed_m_s).max() < 2.0
        assert e.speed_m_s[-1] == pytest.approx(0.5 * sum(samples.wheel_speed_rad_s[599, :2]) * 0.12, abs=0.1)


WARTHOG = Robot("skid", 280.0, 60.0, SkidSteer(0.457, 0.457, 1.1652), Wheel(0.3, 0.25, 0.5), Motor(1.0, 1.0, 10.0))


def test_slow_wheels_beside_a_fast_gyro_with_gaps_and_without_currents():
    """Wheels at 5 Hz, a gyro at 20 Hz, a gap of 2 s every 2 s."""
    rng, steps = np.random.default_rng(3), 4000
    time_s = 0.05 * np.arange(steps) + 2.0 * (np.arange(steps) // 40)
    speed = 2.0 * np.sin(0.9 * time_s) + 1.5 * np.sin(0.37 * time_s)
    turn = 0.8 * np.sin(0.6 * time_s)
    sides = (speed[:, None] + 0.58 * turn[:, None] * np.array([-1.6, 1.6])) / 0.3
    wheels = np.where((np.arange(steps) % 4 == 0)[:, None], np.tile(sides, 2), np.nan)
    wheels += 0.1 * rng.standard_normal(wheels.shape)
    log = DriveLog("skid", time_s, wheels, np.full((steps, 4), np.nan), turn + 0.02 * rng.standard_normal(steps))
    e = SlipEstimator(WARTHOG).run(log).estimates
    assert np.abs(e.speed_m_s).max() < 1.25 * np.nanmax(np.abs(wheels)) * 0.3
    error = e.speed_m_s - speed
    held = np.repeat(0.3 * wheels[::4].mean(axis=1), 4) - speed
    assert np.sqrt(np.mean(error**2)) < 1.1 * np.sqrt(np.mean(held**2))
    assert np.mean(np.abs(error) <= 1.96 * e.speed_std_m_s) > 0.9


ADVERSARIES = np.array([np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 1e-300, 499.0, -499.0, 20.0, -20.0, 3.0, -0.1])


@pytest.mark.slow
@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("spoilt", [0.02, 0.3, 1.0])
def test_a_million_samples_made_to_destroy(name, spoilt):
    """Every channel of a drive spoilt in a share of the samples, in bursts and one by one; steps of any length."""
    observer = default_observer("rlma", filter=name)
    kernel = SlipEstimator(observer).kernel
    rng, steps = np.random.default_rng(int(100 * spoilt)), 90_000
    state = observer.init(observer.no_sample())
    wheels, current_A, x = drive()
    for _ in range(1):
        rows = np.arange(steps) % len(wheels)
        speeds = np.column_stack([wheels[rows], wheels[rows]])
        others = [x[rows, 1], np.zeros(steps), np.zeros(steps), x[rows, 0], np.full(steps, 0.05), np.zeros(steps)]
        samples = RobotSample(np.full(steps, DT_S), speeds, current_A[rows], *others)
        for column in samples:
            hit = rng.random(column.shape) < spoilt
            burst = np.repeat(rng.random(steps // 100 + 1) < 0.3, 100)[:steps]
            hit &= burst if column.ndim == 1 else burst[:, None]
            column[hit] = rng.choice(ADVERSARIES, hit.sum())
        state, e = kernel.scan(state, samples)
        for field in ("speed_m_s", "speed_std_m_s", "yaw_rate_rad_s", "wheel_speed_rad_s", "slip_speed_std_m_s"):
            assert np.isfinite(getattr(e, field)).all(), field
        rims = 0.12 * np.abs(np.nan_to_num(np.where(np.abs(speeds) <= 500, speeds, 0.0))).max()
        assert np.abs(e.speed_m_s).max() <= max(100.0, 1.5 * rims)
