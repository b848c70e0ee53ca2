"""Wheels that no motor drives: followed where they agree, not where one of them is at fault."""

import numpy as np
import pytest

from ohmward.traction import RLMA
from ohmward.traction.speed_observer.body_sensors import in_common
from ohmward.traction.speed_observer.estimate import SlipFlag
from ohmward.traction.speed_observer.noise import ObserverNoise
from ohmward.traction.speed_observer.speed_observer import SpeedObserver

from .examples import DT_S, RLMA_ON_FLOOR, log, observed

OBSERVER = SpeedObserver(RLMA_ON_FLOOR, noise=ObserverNoise(passive_std_rad_s=0.07), rest_hold_s=np.inf)
RADIUS_M = RLMA.wheel.radius_m


@pytest.mark.parametrize(
    ("values", "common"),
    [((3.0, 1.0), 1.0), ((-3.0, -1.0), -1.0), ((3.0, -1.0), 0.0), ((2.0,), 2.0), ((0.0, 5.0), 0.0)],
)
def test_in_common_is_the_value_nearest_to_zero_of_one_sign(values, common):
    assert in_common(list(values)) == common


def drives(body_m_s, driven_m_s=None, current_A=0.0, wrong=None):
    """Estimates (T,) of a drive with this speed of the body, (T,); wrong: (T, 2) instead of the passive wheels."""
    driven = body_m_s if driven_m_s is None else driven_m_s
    samples = log(driven / RADIUS_M, np.full(len(body_m_s), current_A))
    passive = np.column_stack([body_m_s, body_m_s]) / RADIUS_M if wrong is None else wrong
    wheels = np.column_stack([samples.wheel_speed_rad_s[:, :2], passive])
    return observed(OBSERVER, samples._replace(wheel_speed_rad_s=wheels))[1]


def slower(body_m_s, every):
    """Speeds (T, 2) of two passive wheels whose encoders give a mean every so many samples."""
    given = np.full(len(body_m_s), np.nan)
    given[every - 1 :: every] = body_m_s[: len(body_m_s) // every * every].reshape(-1, every).mean(axis=1)
    return np.column_stack([given, given]) / RADIUS_M


def flagged(estimates, flag):
    return (estimates.flags.astype(int) & flag).astype(bool)


def test_a_force_that_the_model_lacks_is_followed():
    """From rest on a slope of 0.3 rad, 17 standard deviations steeper than believed, without any current."""
    time_s = DT_S * np.arange(1, 151)
    speed = 9.81 * np.sin(0.3) * time_s
    e = drives(speed)
    error = np.abs(e.speed_m_s - speed)[50:]
    assert np.mean(error < 1.96 * e.speed_std_m_s[50:]) > 0.9
    assert e.grade_rad[-1] == pytest.approx(-0.3, abs=0.05)


def test_wheels_that_all_say_the_same_are_believed_within_a_tenth_of_a_second():
    """The driven wheels go on at 1 m/s while the body is at 0.4 m/s at once."""
    body = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(100, 1.0), np.full(100, 0.4)])
    driven = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(200, 1.0)])
    e = drives(body, driven)
    assert np.all(np.abs(e.speed_m_s - body)[311:] < 0.05)


def test_one_stuck_wheel_beside_a_good_one_changes_nothing():
    body = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(200, 1.0)])
    wheels = np.column_stack([body, body]) / RADIUS_M
    wheels[250:, 1] = 0.0
    e = drives(body, wrong=wheels)
    assert np.all(np.abs(e.speed_m_s - body)[100:] < 0.02)
    assert flagged(e, SlipFlag.ENCODER_SPIKE)[260:].all()
    assert flagged(e, SlipFlag.ENCODER_REJECTED)[360:].all()


@pytest.mark.parametrize("every", [2, 5, 10])
def test_slow_encoders_are_believed_as_soon_as_three_values_say_the_same(every):
    """The driven wheels go on at 1 m/s while the body is at 0.4 m/s at once, and stays there."""
    body = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(100, 1.0), np.full(200, 0.4)])
    driven = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(300, 1.0)])
    e = drives(body, driven, wrong=slower(body, every))
    soon = 300 + max(3 * every, 10)
    assert np.all(np.abs(e.speed_m_s - body)[soon + every :] < 0.05)


@pytest.mark.parametrize("every", [1, 2, 5])
def test_wheels_that_slide_ever_faster_neither_hold_the_speed_nor_turn_the_robot(every):
    """The driven wheels go on at 1 m/s without current while the body slows to 0.3 m/s in a second."""
    body = np.concatenate(
        [np.linspace(0.0, 1.0, 200), np.full(100, 1.0), np.linspace(1.0, 0.3, 100), np.full(100, 0.3)]
    )
    driven = np.concatenate([np.linspace(0.0, 1.0, 200), np.full(300, 1.0)])
    e = drives(body, driven, wrong=slower(body, every))
    settled = np.abs(e.speed_m_s - body)[350:]
    assert np.all(settled < 0.2)
    assert np.mean(settled) < 0.02
    assert np.all(np.abs(e.yaw_rate_rad_s)[350:] < 0.02)
