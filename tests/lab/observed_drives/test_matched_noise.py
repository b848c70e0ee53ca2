"""White noise of encoders, currents and gyro by their own course, and what an adaptive filter makes of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ohmward.trace import Kernel
from ohmward.traction.speed_observer.matched_noise import CLIP, MOST_RATIO, WhiteNoise, first, follow
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver
from traction.speed_observer.examples import DT_S, observed

from .mujoco_runs import believed, drive_on, samples_of

GIVEN = first(np.array([0.1]))
RIGHT = ObserverNoise(encoder_std_rad_s=0.3, torque_std_Nm=0.5, gyro_std_rad_s=0.03)


def followed(values, dt_s=None, window=100.0, given=GIVEN):
    """Standard deviation (T,) after each value."""

    def step(white: WhiteNoise, sample):
        y, dt = sample
        after = follow(white, given, np.array([y]), np.array([abs(y) < np.inf]), dt, window)
        return after, after.variance[0]

    dt_s = np.full(len(values), DT_S) if dt_s is None else dt_s
    return np.sqrt(Kernel(step, given, (0.0, 0.0)).scan(given, (np.asarray(values, dtype=float), dt_s))[1])


@pytest.mark.parametrize("true", [0.01, 0.03, 0.1, 0.3, 1.0])
def test_the_noise_is_found_within_five_seconds_from_ten_times_too_large_or_too_small(true):
    rng, time_s = np.random.default_rng(1), DT_S * np.arange(2000)
    found = followed(3.0 + 2.0 * np.sin(time_s) + true * rng.standard_normal(2000))
    assert found[500:] == pytest.approx(true, rel=0.45)
    assert np.sqrt(np.mean(found[500:] ** 2)) == pytest.approx(true, rel=0.08)


def test_a_noise_that_changes_is_found_again():
    rng = np.random.default_rng(2)
    std = np.repeat([0.1, 1.0, 0.1], 1000)
    found = followed(std * rng.standard_normal(3000))
    assert found[1300] == pytest.approx(1.0, rel=0.3)
    assert found[-1] == pytest.approx(0.1, rel=0.3)


def test_unequal_steps_and_missing_values_change_nothing():
    rng = np.random.default_rng(3)
    dt_s = rng.uniform(0.5, 1.5, 4000) * DT_S
    time_s = np.cumsum(dt_s)
    values = 5.0 * time_s + 0.2 * rng.standard_normal(4000)
    values[rng.random(4000) < 0.3] = np.nan
    assert np.sqrt(np.mean(followed(values, dt_s)[1000:] ** 2)) == pytest.approx(0.2, rel=0.08)


def test_a_ramp_without_noise_leads_to_the_least_one_and_a_constant_tells_nothing():
    assert followed(np.arange(3000.0))[-1] == pytest.approx(0.1 / MOST_RATIO)
    assert np.all(followed(np.full(3000, 1.0)) == pytest.approx(0.1))


def test_glitches_in_one_of_a_hundred_values_hardly_teach():
    rng = np.random.default_rng(4)
    values = 0.1 * rng.standard_normal(4000)
    values[rng.random(4000) < 0.01] += 20.0
    assert np.mean(followed(values)[500:]) < 0.1 * np.sqrt(1.0 + 0.06 * CLIP)


def estimates(noise, matching, sensors, seed=900):
    """Errors of speed and yaw rate over the drive of `wander`, and their standard deviations, from 1 s on."""
    truth = TRUTHS.setdefault(seed, drive_on(0.8, 0.01, wander, 6.0))
    rng = np.random.default_rng(seed)
    samples = samples_of(truth, rng)
    white = {name: std * rng.standard_normal(getattr(samples, name).shape) for name, std in sensors.items()}
    samples = samples._replace(**{name: getattr(samples, name) + noise for name, noise in white.items()})
    observer = SpeedObserver(believed(rng), noise=noise, matching=matching, rest_hold_s=np.inf)
    _, e = observed(observer, samples)
    speed = (e.speed_m_s - truth.speed_m_s[1:])[100:], e.speed_std_m_s[100:]
    yaw = (e.yaw_rate_rad_s - truth.gyro_rad_s[1:, 2])[100:], e.yaw_rate_std_rad_s[100:]
    return {"speed": speed, "yaw": yaw}


def wander(truth):
    """Torque [N m] of a robot that changes its speed and turns."""
    target = 0.6 + 0.4 * np.sin(0.7 * truth.time_s) + 0.15 * np.sin(2.3 * truth.time_s)
    turn = np.array([0.6, -0.6]) * np.sin(0.9 * truth.time_s)
    return np.clip(12.0 * (min(target, 0.5 * truth.time_s) - truth.speed_m_s), -4.0, 4.0) + turn


TRUTHS: dict = {}
SENSORS = {
    "encoder_std_rad_s": ({"wheel_speed_rad_s": 0.3}, "speed"),
    "torque_std_Nm": ({"current_A": 1.0}, "speed"),
    "gyro_std_rad_s": ({"yaw_rate_rad_s": 0.03}, "yaw"),
}


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def covered(found):
    error, std = found
    return float(np.mean(np.abs(error) < 1.96 * std))


def exact_stds(name):
    """Of the sensors, one of them as noisy as in `SENSORS`."""
    return {"encoder_std_rad_s": 0.07, "torque_std_Nm": 0.07, "gyro_std_rad_s": 0.003, name: getattr(RIGHT, name)}


@cache
def with_the_right_noise(name):
    return estimates(ObserverNoise(**exact_stds(name)), False, SENSORS[name][0])


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.1, 1.0 / 3.0, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("name", SENSORS)
def test_an_adaptive_filter_with_wrong_noise_is_as_good_as_with_the_right_one(name, factor):
    sensors, what = SENSORS[name]
    exact = exact_stds(name)
    wrong = {**exact, name: factor * exact[name]}
    right = with_the_right_noise(name)[what]
    adapted = estimates(ObserverNoise(**wrong), True, sensors)[what]
    assert rms(adapted[0]) < 1.15 * rms(right[0])
    assert covered(adapted) > min(covered(right), 0.95) - 0.05


def test_a_filter_that_does_not_match_carries_no_noise():
    observer = SpeedObserver(believed(np.random.default_rng(1)), noise=RIGHT)
    kept = observer.init(observer.no_sample()).matched
    matched = replace(observer, matching=True).init(observer.no_sample()).matched
    assert all(len(values) == 0 for white in kept for values in white)
    assert [len(white.variance) for white in matched] == [2, 2, 1]


def test_a_robot_without_a_gyro_is_matched_too():
    observer = SpeedObserver(believed(np.random.default_rng(1)), matching=True)
    state = observer.init(observer.no_sample())
    after, _ = observer.step(state, observer.no_sample()._replace(dt_s=DT_S, wheel_speed_rad_s=np.zeros(4)))
    assert len(after.matched.gyro.variance) == 0
